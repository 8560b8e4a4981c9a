//! The lake: smooth water, whose look depends on the viewer.

use glam::{DVec2, DVec3, Vec2, Vec4};

use super::ground;
use super::noise::{fbm, smoothstep};
use crate::{Material, Mesh};

/// The water's surface: a grid of `cells`² squares around the lake, where it is above ground.
pub(super) fn mesh(cells: usize, material: u32) -> Mesh {
    let (center, radius) = ground::LAKE;
    let half = radius * 1.6;
    let step = 2.0 * half / cells as f64;
    let row = cells + 1;
    let at = |i: usize, j: usize| center + DVec2::new(i as f64, j as f64) * step - half;
    let mut depth = Vec::with_capacity(row * row);
    for j in 0..row {
        depth.extend((0..row).map(|i| ground::WATER - ground::height(at(i, j))));
    }
    let mut mesh = Mesh { name: "lake".to_owned(), material, ..Mesh::default() };
    let mut vertex = vec![u32::MAX; row * row];
    for j in 0..cells {
        for i in 0..cells {
            let corners = [j * row + i, j * row + i + 1, (j + 1) * row + i, (j + 1) * row + i + 1];
            if corners.iter().all(|&c| depth[c] < 0.0) {
                continue;
            }
            let [a, b, c, d] = corners.map(|k| {
                if vertex[k] == u32::MAX {
                    vertex[k] = mesh.positions.len() as u32;
                    push(&mut mesh, at(k % row, k / row), depth[k]);
                }
                vertex[k]
            });
            mesh.indices.extend([a, c, b, b, c, d]);
        }
    }
    mesh
}

fn push(mesh: &mut Mesh, p: DVec2, depth: f64) {
    mesh.positions.push(DVec3::new(p.x, ground::WATER, p.y).as_vec3());
    // Ripples tilt only the normal, by up to 3°, and are a few metres long, so that samples can resolve them.
    let ripple = |seed| fbm(p / DVec2::new(7.0, 4.5), 2, seed) * 0.07;
    mesh.normals.push(DVec3::new(ripple(91), 1.0, ripple(92)).normalize().as_vec3());
    let shallow = DVec3::new(0.070, 0.190, 0.170);
    let deep = DVec3::new(0.010, 0.050, 0.075);
    let color = shallow.lerp(deep, smoothstep(0.1, 4.0, depth)).as_vec3();
    mesh.colors.push(Vec4::new(color.x, color.y, color.z, 1.0));
    mesh.uvs.push(Vec2::ZERO);
}

/// Water: smooth, dark, with a dielectric's reflectance.
pub(super) fn material() -> Material {
    Material {
        name: "water".to_owned(),
        base_color: Vec4::ONE,
        roughness: 0.14,
        ior: 1.33,
        double_sided: false,
        ..Material::default()
    }
}
