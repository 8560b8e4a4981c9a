//! Tangents for normal maps, by MikkTSpace as in common bakers.

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec3, Vec4};

use crate::texture::transform_duv;
use crate::{Mesh, TextureRef};

/// Keeps, makes or removes tangents: a mesh has them if it has a normal map and the texture coordinates of its set. They
/// are made for the map as its transform places it. Returns the vertices whose copies were appended, in order.
pub(super) fn complete(mesh: &mut Mesh, normal_map: Option<TextureRef>) -> Vec<usize> {
    let Some(map) = normal_map.filter(|map| !mesh.uvs_of(map.uv_set).is_empty()) else {
        mesh.tangents = Vec::new();
        return Vec::new();
    };
    let copied = if mesh.tangents.is_empty() { make(mesh, map) } else { Vec::new() };
    for (tangent, normal) in mesh.tangents.iter_mut().zip(&mesh.normals) {
        let sign = if tangent.w < 0.0 { -1.0 } else { 1.0 };
        let along = tangent.truncate();
        let unit = if along.is_finite() { along.try_normalize() } else { None };
        *tangent = unit.unwrap_or_else(|| normal.any_orthonormal_vector()).extend(sign);
    }
    copied
}

/// A mesh with one tangent per corner.
struct Corners<'a> {
    mesh: &'a Mesh,
    map: TextureRef,
    tangents: Vec<Vec4>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.indices[3 * face + corner] as usize
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        transform_duv(&self.map, self.mesh.uvs_of(self.map.uv_set)[self.vertex(face, corner)]).to_array()
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, corner: usize) {
        if let Some(space) = space {
            // glTF's bitangent has the opposite sign of MikkTSpace's, where v points up.
            let [x, y, z, w] = space.tangent_encoded();
            self.tangents[3 * face + corner] = Vec4::new(x, y, z, -w);
        }
    }
}

/// Makes tangents. A vertex whose triangles disagree, as along the seam of a mirrored texture, is split. Returns the
/// vertices that were copied.
fn make(mesh: &mut Mesh, map: TextureRef) -> Vec<usize> {
    let mut corners = Corners { mesh, map, tangents: vec![Vec4::ZERO; mesh.indices.len()] };
    if generate_tangents(&mut corners).is_err() {
        corners.tangents.fill(Vec4::ZERO);
    }
    let by_corner = corners.tangents;
    let count = mesh.positions.len();
    mesh.tangents = vec![Vec4::ZERO; count];
    let mut given = vec![false; count];
    // The next copy of each vertex, including copies: a chain ended by u32::MAX.
    let mut next = vec![u32::MAX; count];
    let mut copied = Vec::new();
    for (corner, tangent) in by_corner.into_iter().enumerate() {
        let mut at = mesh.indices[corner] as usize;
        loop {
            if !given[at] {
                given[at] = true;
                mesh.tangents[at] = tangent;
                break;
            }
            if agree(mesh.tangents[at], tangent) {
                break;
            }
            if next[at] == u32::MAX {
                next[at] = mesh.positions.len() as u32;
                duplicate(mesh, at);
                copied.push(at);
                given.push(false);
                next.push(u32::MAX);
            }
            at = next[at] as usize;
        }
        mesh.indices[corner] = at as u32;
    }
    copied
}

/// Whether two tangents are equal within 2° and have the same handedness.
fn agree(a: Vec4, b: Vec4) -> bool {
    a.w == b.w && (a == b || Vec3::dot(a.truncate(), b.truncate()) > 0.9994)
}

fn duplicate(mesh: &mut Mesh, vertex: usize) {
    fn again<T: Copy>(values: &mut Vec<T>, i: usize) {
        if let Some(&value) = values.get(i) {
            values.push(value);
        }
    }
    again(&mut mesh.positions, vertex);
    again(&mut mesh.normals, vertex);
    again(&mut mesh.uvs, vertex);
    again(&mut mesh.uvs2, vertex);
    again(&mut mesh.colors, vertex);
    mesh.tangents.push(Vec4::ZERO);
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    /// A square in the xy plane, seen from +z, with u along x and v (downwards) along −y.
    fn square() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            normals: vec![Vec3::Z; 4],
            uvs: vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO],
            indices: vec![0, 1, 2, 0, 2, 3],
            ..Mesh::default()
        }
    }

    #[test]
    fn the_tangent_follows_u_and_the_bitangent_points_up_the_image() {
        let mut mesh = square();
        complete(&mut mesh, Some(TextureRef::new(0)));
        for tangent in &mesh.tangents {
            assert!((tangent.truncate() - Vec3::X).length() < 1e-5);
            // glTF: bitangent = normal × tangent · w; a normal map's green points up the image, along +y here.
            let bitangent = Vec3::Z.cross(tangent.truncate()) * tangent.w;
            assert!((bitangent - Vec3::Y).length() < 1e-5);
        }
    }

    #[test]
    fn a_mirrored_seam_splits_its_vertices() {
        let mut mesh = square();
        // A second square beyond x = 1 whose u runs backwards.
        mesh.positions.extend([Vec3::X * 2.0, Vec3::new(2.0, 1.0, 0.0)]);
        mesh.normals.extend([Vec3::Z; 2]);
        mesh.uvs.extend([Vec2::Y, Vec2::ZERO]);
        mesh.indices.extend([1, 4, 5, 1, 5, 2]);
        complete(&mut mesh, Some(TextureRef::new(0)));
        assert_eq!(mesh.positions.len(), 8);
        assert_eq!(mesh.tangents.len(), 8);
        assert!(mesh.tangents.iter().any(|t| t.w > 0.0) && mesh.tangents.iter().any(|t| t.w < 0.0));
    }

    #[test]
    fn missing_or_degenerate_texture_coordinates_do_no_harm() {
        let mut mesh = Mesh { uvs: Vec::new(), ..square() };
        complete(&mut mesh, Some(TextureRef::new(0)));
        assert!(mesh.tangents.is_empty());
        let mut mesh = Mesh { uvs: vec![Vec2::ZERO; 4], ..square() };
        complete(&mut mesh, Some(TextureRef::new(0)));
        assert!(mesh.tangents.iter().all(|t| (t.truncate().length() - 1.0).abs() < 1e-5));
    }
}
