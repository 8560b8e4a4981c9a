//! The height field: a valley with a lake, a knoll for the tree, and mountains along the rim.

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use super::noise::{fbm, ridged, smoothstep};
use crate::Mesh;

/// Half the edge of the square tile, metres.
pub(super) const HALF: f64 = 100.0;
/// Height of the lake's surface.
pub(super) const WATER: f64 = 0.0;
/// Position of the tree (x, z).
pub(super) const TREE: DVec2 = DVec2::new(20.0, 6.0);
/// The lake's middle (x, z) and radius.
pub(super) const LAKE: (DVec2, f64) = (DVec2::new(-24.0, 14.0), 36.0);
/// Height of the lower end of the block's sides, metres.
const BOTTOM: f64 = -14.0;
/// Edge of one repeat of the ground's texture, metres.
const TEXTURE_METRES: f64 = 9.0;

/// Height of the ground at (x, z), metres.
pub(super) fn height(p: DVec2) -> f64 {
    // The rim rises on all sides, the more the further north (−z), where the cameras look.
    let warp = DVec2::new(fbm(p / 47.0, 3, 11), fbm(p / 47.0, 3, 23)) * 14.0;
    let q = p + warp;
    let north = smoothstep(70.0, -60.0, p.y);
    let rim = smoothstep(48.0, 104.0, q.length() + 16.0 * north);
    let peaks = ridged(q / 62.0 + DVec2::new(3.7, 1.3), 7, 41);
    let mountains = rim * (3.0 + (7.0 + 46.0 * north) * peaks);
    let meadow = 4.0 + 3.2 * fbm(p / 38.0, 4, 5) + 0.5 * fbm(p / 7.0, 3, 6);
    let land = meadow + mountains;

    let knoll = smoothstep(30.0, 3.0, (p - TREE).length());
    let land = land + (6.5 + 0.25 * fbm(p / 5.0, 2, 8) - land) * knoll * 0.9;

    let shore = (p - LAKE.0) * DVec2::new(0.92, 1.12);
    let reach = LAKE.1 + 9.0 * fbm(p / 26.0, 3, 17);
    let basin = smoothstep(reach * 1.12, reach * 0.45, shore.length()) * (1.0 - knoll);
    land + (-7.0 - land) * basin
}

/// Linear colour of the ground.
fn color(p: DVec2, height: f64, normal: DVec3) -> DVec3 {
    let broad = fbm(p / 31.0, 4, 71);
    let fine = fbm(p / 3.1, 4, 72);
    let steep = 1.0 - normal.y;

    let grass =
        DVec3::new(0.115, 0.215, 0.040).lerp(DVec3::new(0.300, 0.310, 0.085), (0.5 + broad).clamp(0.0, 1.0));
    let grass = grass * (1.0 + 0.35 * fine);
    let strata = 0.5 + 0.5 * fbm(DVec2::new(height / 2.3 + broad * 2.0, broad), 3, 73);
    let rock =
        DVec3::new(0.225, 0.190, 0.160).lerp(DVec3::new(0.430, 0.375, 0.310), strata) * (1.0 + 0.3 * fine);
    let snow = DVec3::new(0.82, 0.86, 0.92);
    let sand = DVec3::new(0.520, 0.430, 0.290) * (1.0 + 0.2 * fine);
    let bed = DVec3::new(0.100, 0.130, 0.090);

    let high = smoothstep(13.0, 25.0, height + 5.0 * broad + 3.0 * fine);
    let bare = smoothstep(0.14, 0.36, steep + 0.10 * fine + 0.12 * high);
    let ground = grass.lerp(rock, bare.max(high * 0.85));
    let ground = ground.lerp(snow, smoothstep(24.0, 33.0, height + 7.0 * broad + 4.0 * fine - 16.0 * steep));
    let ground = ground.lerp(sand, smoothstep(1.5, 0.7, height - WATER + 0.7 * fine) * (1.0 - bare));
    ground.lerp(bed, smoothstep(WATER - 0.2, WATER - 2.0, height))
}

/// The height field as 2·`cells`² triangles and its four sides as 8·`cells` more.
pub(super) fn mesh(cells: usize, material: u32) -> Mesh {
    let row = cells + 1;
    let step = 2.0 * HALF / cells as f64;
    let at = |i: usize, j: usize| DVec2::new(i as f64, j as f64) * step - HALF;
    // One more sample beyond each border, so that border normals are central differences too.
    let wide = row + 2;
    let mut heights = Vec::with_capacity(wide * wide);
    for j in 0..wide {
        for i in 0..wide {
            heights.push(height(at(i, j) - step));
        }
    }
    let mut mesh = Mesh { name: "ground".to_owned(), material, ..Mesh::default() };
    for j in 0..row {
        for i in 0..row {
            let h = |di: usize, dj: usize| heights[(j + dj) * wide + i + di];
            let normal = DVec3::new(h(0, 1) - h(2, 1), 2.0 * step, h(1, 0) - h(1, 2)).normalize();
            let (p, y) = (at(i, j), h(1, 1));
            push(&mut mesh, DVec3::new(p.x, y, p.y), normal, p, color(p, y, normal));
        }
    }
    let index = |i: usize, j: usize| (j * row + i) as u32;
    for j in 0..cells {
        for i in 0..cells {
            let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)];
            // The shorter diagonal follows ridges and valleys.
            let y = |v: u32| mesh.positions[v as usize].y;
            if (y(a) - y(d)).abs() < (y(b) - y(c)).abs() {
                mesh.indices.extend([a, c, d, a, d, b]);
            } else {
                mesh.indices.extend([a, c, b, b, c, d]);
            }
        }
    }
    sides(&mut mesh, cells);
    mesh
}

/// Closes the block: vertical sides from the border down to [`BOTTOM`], in layers of earth.
fn sides(mesh: &mut Mesh, cells: usize) {
    let row = cells + 1;
    // Start and stride of each border, anticlockwise seen from above, with its outward normal.
    let borders: [(usize, isize, DVec3); 4] = [
        (cells * row, 1, DVec3::Z),
        (row * row - 1, -(row as isize), DVec3::X),
        (cells, -1, DVec3::NEG_Z),
        (0, row as isize, DVec3::NEG_X),
    ];
    for (start, stride, normal) in borders {
        let first = mesh.positions.len() as u32;
        for k in 0..row {
            let top = mesh.positions[start.wrapping_add_signed(stride * k as isize)].as_dvec3();
            let along = top.x * normal.z.abs() + top.z * normal.x.abs();
            let earth =
                DVec3::new(0.23, 0.155, 0.095) * (1.0 + 0.3 * fbm(DVec2::new(along / 6.0, 0.5), 3, 81));
            let foot = DVec3::new(top.x, BOTTOM, top.z);
            push(mesh, top, normal, DVec2::new(along, -top.y), earth);
            push(mesh, foot, normal, DVec2::new(along, -BOTTOM), earth * 0.45);
        }
        for k in 0..cells as u32 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|corner| first + 2 * k + corner);
            mesh.indices.extend([a, b, c, c, b, d]);
        }
    }
}

fn push(mesh: &mut Mesh, position: DVec3, normal: DVec3, texture_metres: DVec2, color: DVec3) {
    mesh.positions.push(position.as_vec3());
    mesh.normals.push(normal.as_vec3());
    mesh.uvs.push((texture_metres / TEXTURE_METRES).as_vec2());
    let color: Vec3 = color.as_vec3();
    mesh.colors.push(Vec4::new(color.x, color.y, color.z, 1.0));
    debug_assert!(mesh.uvs.last().is_some_and(|uv: &Vec2| uv.is_finite()));
}
