//! Converts a file's mesh to a valid [`Mesh`].

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::normals::pick;
use super::parts::Warnings;
use super::{normals, tangents};
use crate::{Mesh, TextureRef};

/// How missing normals are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MissingNormals {
    /// One normal per triangle, as glTF requires.
    Flat,
    /// Averaged around each vertex, weighted by area.
    Smooth,
}

/// A mesh as read from a file. Only the existence of its arrays has been checked.
#[derive(Debug, Default)]
pub(super) struct RawMesh {
    pub(super) name: String,
    pub(super) origin: DVec3,
    /// Relative to `origin`; may contain NaN and infinities.
    pub(super) positions: Vec<Vec3>,
    /// Ignored unless there are as many as positions; so are the next four.
    pub(super) normals: Vec<Vec3>,
    pub(super) tangents: Vec<Vec4>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) uvs2: Vec<Vec2>,
    pub(super) colors: Vec<Vec4>,
    /// Three per triangle; may be out of range.
    pub(super) indices: Vec<u32>,
    pub(super) material: u32,
}

impl RawMesh {
    /// Drops triangles that cannot be drawn and unreferenced vertices, and makes missing normals and, for a material
    /// with a normal map, missing tangents. `None` if no triangle is left.
    pub(super) fn finish(
        self,
        missing: MissingNormals,
        normal_map: Option<TextureRef>,
        warnings: &mut Warnings,
    ) -> Option<Mesh> {
        Some(self.finish_with_sources(missing, normal_map, warnings)?.0)
    }

    /// As [`Self::finish`]. Also returns for each vertex of the mesh its index in the file.
    pub(super) fn finish_with_sources(
        mut self,
        missing: MissingNormals,
        normal_map: Option<TextureRef>,
        warnings: &mut Warnings,
    ) -> Option<(Mesh, Vec<u32>)> {
        self.drop_broken_triangles(warnings);
        if self.indices.is_empty() {
            return None;
        }
        for (what, length) in [
            ("normals", self.normals.len()),
            ("tangents", self.tangents.len()),
            ("texture coordinates", self.uvs.len()),
            ("second texture coordinates", self.uvs2.len()),
            ("vertex colours", self.colors.len()),
        ] {
            if length != 0 && length != self.positions.len() {
                warnings.add(format!(
                    "mesh {:?}: its {what} are not as many as its positions: ignored",
                    self.name
                ));
            }
        }
        self.keep_matching();
        let mut sources = self.compact();
        let mut mesh = Mesh {
            name: self.name,
            origin: self.origin,
            positions: self.positions,
            normals: self.normals,
            tangents: self.tangents,
            uvs: self.uvs,
            uvs2: self.uvs2,
            colors: self.colors,
            indices: self.indices,
            material: self.material,
            deformation: None,
        };
        for uv in mesh.uvs.iter_mut().chain(&mut mesh.uvs2) {
            *uv = if uv.is_finite() { *uv } else { Vec2::ZERO };
        }
        for color in &mut mesh.colors {
            *color = if color.is_finite() { color.max(Vec4::ZERO) } else { Vec4::ONE };
        }
        match (mesh.normals.is_empty(), missing) {
            (false, _) => normals::repair(&mut mesh),
            (true, MissingNormals::Flat) => {
                pick(&mut sources, &mesh.indices);
                normals::make_flat(&mut mesh);
            }
            (true, MissingNormals::Smooth) => normals::make_smooth(&mut mesh),
        }
        let copied = tangents::complete(&mut mesh, normal_map);
        for vertex in copied {
            sources.push(sources[vertex]);
        }
        Some((mesh, sources))
    }

    fn drop_broken_triangles(&mut self, warnings: &mut Warnings) {
        let count = self.positions.len();
        let finite: Vec<bool> = self.positions.iter().map(|p| p.is_finite()).collect();
        let (mut outside, mut infinite) = (0usize, 0usize);
        let mut kept = 0;
        for triangle in 0..self.indices.len() / 3 {
            let corners = [0, 1, 2].map(|k| self.indices[3 * triangle + k]);
            if corners.iter().any(|&i| i as usize >= count) {
                outside += 1;
            } else if corners.iter().any(|&i| !finite[i as usize]) {
                infinite += 1;
            } else {
                self.indices[kept..kept + 3].copy_from_slice(&corners);
                kept += 3;
            }
        }
        if !self.indices.len().is_multiple_of(3) {
            warnings.add(format!("mesh {:?}: its last triangle is incomplete: dropped", self.name));
        }
        self.indices.truncate(kept);
        for (dropped, why) in [
            (outside, "with vertices that it does not have"),
            (infinite, "with vertices that are NaN or infinite"),
        ] {
            if dropped > 0 {
                warnings.add(format!("mesh {:?}: {dropped} triangles {why}: dropped", self.name));
            }
        }
    }

    fn keep_matching(&mut self) {
        let count = self.positions.len();
        if self.normals.len() != count {
            self.normals.clear();
        }
        if self.tangents.len() != count {
            self.tangents.clear();
        }
        for uvs in [&mut self.uvs, &mut self.uvs2] {
            if uvs.len() != count {
                uvs.clear();
            }
        }
        if self.colors.len() != count {
            self.colors.clear();
        }
    }

    /// Drops vertices that no triangle uses, including NaN ones and those of other primitives that share the arrays.
    /// Returns the previous index of each that is left.
    fn compact(&mut self) -> Vec<u32> {
        let mut new_index = vec![u32::MAX; self.positions.len()];
        let mut order = Vec::new();
        for index in &mut self.indices {
            let new = &mut new_index[*index as usize];
            if *new == u32::MAX {
                *new = order.len() as u32;
                order.push(*index);
            }
        }
        if order.len() == self.positions.len() {
            return (0..order.len() as u32).collect();
        }
        self.indices.iter_mut().for_each(|index| *index = new_index[*index as usize]);
        pick(&mut self.positions, &order);
        pick(&mut self.normals, &order);
        pick(&mut self.tangents, &order);
        pick(&mut self.uvs, &order);
        pick(&mut self.uvs2, &order);
        pick(&mut self.colors, &order);
        order
    }
}

/// Converts positions to `f32` about an origin: the middle of their box if they are far from zero compared with their
/// extent, else zero.
pub(super) fn about_an_origin(positions: &[DVec3]) -> (DVec3, Vec<Vec3>) {
    let mut bounds = crate::Bounds::EMPTY;
    positions.iter().for_each(|p| bounds.extend(*p));
    let far = bounds.center().abs().max_element() > 8.0 * bounds.size().max_element();
    let origin = if far && !bounds.is_empty() { bounds.center() } else { DVec3::ZERO };
    (origin, positions.iter().map(|p| (*p - origin).as_vec3()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> RawMesh {
        RawMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            indices: vec![0, 1, 2, 0, 2, 3],
            ..RawMesh::default()
        }
    }

    #[test]
    fn undrawable_triangles_are_dropped_with_a_warning_per_kind() {
        let mut raw = square();
        raw.positions.push(Vec3::new(f32::NAN, 0.0, 0.0));
        raw.positions.push(Vec3::new(0.0, f32::INFINITY, 0.0));
        raw.indices.extend([0, 1, 4, 0, 5, 1, 0, 1, 6, 0, 1, u32::MAX, 0, 1]);
        let mut warnings = Warnings::default();
        let mesh = raw.finish(MissingNormals::Smooth, None, &mut warnings).unwrap();
        assert_eq!(mesh.triangles(), 2);
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(warnings.into_lines().len(), 3);
    }

    #[test]
    fn attributes_of_another_length_are_ignored() {
        let raw = RawMesh { normals: vec![Vec3::Z], uvs: vec![Vec2::ONE; 5], ..square() };
        let mut warnings = Warnings::default();
        let mesh = raw.finish(MissingNormals::Smooth, Some(TextureRef::new(0)), &mut warnings).unwrap();
        assert!(mesh.uvs.is_empty() && mesh.tangents.is_empty());
        assert_eq!(mesh.normals, [Vec3::Z; 4]);
        assert_eq!(warnings.into_lines().len(), 2);
    }

    #[test]
    fn coordinates_far_from_zero_keep_their_precision() {
        let far = DVec3::new(4.0e6, 120.0, -3.0e6);
        let detail = DVec3::splat(0.001);
        let (origin, positions) = about_an_origin(&[far, far + detail, far + DVec3::X]);
        let second = origin + positions[1].as_dvec3() - (origin + positions[0].as_dvec3());
        assert!((second - detail).length() < 1e-6);
        assert_eq!(about_an_origin(&[DVec3::ZERO, DVec3::ONE]).0, DVec3::ZERO);
    }
}
