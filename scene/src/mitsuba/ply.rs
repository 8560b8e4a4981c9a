//! Triangles of an instance in world space, and their binary PLY file.

use std::fs::File;
use std::io::{BufWriter, Result, Write};
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use crate::{Instance, Mesh};

/// Triangles in world space, relative to the exported scene's origin.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Triangles {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    /// Linear; empty without vertex colours.
    pub(super) colors: Vec<Vec3>,
    pub(super) corners: Vec<[u32; 3]>,
}

impl Triangles {
    /// The triangles of an instance whose index passes `chosen`. Triangles without area, which no ray meets, are dropped.
    /// A mirrored instance gets its corners in reverse, so that its front stays the mesh's front.
    pub(super) fn of(
        mesh: &Mesh,
        instance: &Instance,
        origin: DVec3,
        chosen: impl Fn(&[u32; 3]) -> bool,
    ) -> Self {
        let matrix = instance.world_from_mesh.matrix3;
        let place = |p: &Vec3| instance.world_from_mesh.transform_point3(mesh.origin + p.as_dvec3()) - origin;
        let placed: Vec<DVec3> = mesh.positions.iter().map(place).collect();
        let normal_from_mesh = matrix.inverse().transpose();
        let turn = |n: &Vec3| (normal_from_mesh * n.as_dvec3()).normalize_or(DVec3::Y).as_vec3();
        let has_area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|i| placed[i as usize]);
            let area = (b - a).cross(c - a).length();
            area > 0.0 && area.is_finite()
        };
        let mirrored = matrix.determinant() < 0.0;
        let orient = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let (triangles, _) = mesh.indices.as_chunks::<3>();
        let kept = triangles.iter().filter(|corners| has_area(corners) && chosen(corners));
        Self {
            positions: placed.iter().map(|p| p.as_vec3()).collect(),
            normals: mesh.normals.iter().map(turn).collect(),
            uvs: mesh.uvs.clone(),
            colors: mesh.colors.iter().map(|color| color.truncate()).collect(),
            corners: kept.map(|corners| orient(*corners)).collect(),
        }
    }

    /// Triangles with front and back exchanged, moved by `distance` metres to their former back.
    pub(super) fn reversed(&self, distance: f32) -> Self {
        let behind = |(p, n): (&Vec3, &Vec3)| *p - *n * distance;
        Self {
            positions: self.positions.iter().zip(&self.normals).map(behind).collect(),
            normals: self.normals.iter().map(|n| -*n).collect(),
            corners: self.corners.iter().map(|&[a, b, c]| [a, c, b]).collect(),
            ..self.clone()
        }
    }

    /// Greatest coordinate of any vertex, without its sign.
    pub(super) fn reach(&self) -> f32 {
        self.positions.iter().map(|p| p.abs().max_element()).filter(|p| p.is_finite()).fold(0.0, f32::max)
    }

    /// Writes a binary PLY file with 32-bit floats.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        let (uvs, colors) = (!self.uvs.is_empty(), !self.colors.is_empty());
        let mut properties = vec!["x", "y", "z", "nx", "ny", "nz"];
        properties.extend(["u", "v"].iter().filter(|_| uvs));
        properties.extend(["r", "g", "b"].iter().filter(|_| colors));
        write!(
            file,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{}element face {}\n\
             property list uchar uint vertex_indices\nend_header\n",
            self.positions.len(),
            properties.iter().map(|name| format!("property float {name}\n")).collect::<String>(),
            self.corners.len(),
        )?;
        for (i, (p, n)) in self.positions.iter().zip(&self.normals).enumerate() {
            let mut vertex = vec![p.x, p.y, p.z, n.x, n.y, n.z];
            vertex.extend(self.uvs.get(i).map(Vec2::to_array).iter().flatten());
            vertex.extend(self.colors.get(i).map(Vec3::to_array).iter().flatten());
            for value in vertex {
                file.write_all(&value.to_le_bytes())?;
            }
        }
        for corners in &self.corners {
            file.write_all(&[3])?;
            for corner in corners {
                file.write_all(&corner.to_le_bytes())?;
            }
        }
        file.flush()
    }
}
