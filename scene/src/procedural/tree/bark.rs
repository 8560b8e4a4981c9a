//! Branches as tapering tubes, the thick ones first.

use glam::{DVec2, DVec3, Vec4};

use super::Branch;
use crate::Mesh;
use crate::procedural::noise::circle;

/// Size of one repeat of the bark's texture, metres: around and along a branch.
const TEXTURE_METRES: (f64, f64) = (4.0, 16.0);

/// Sides and rings of one branch's tube.
#[derive(Clone, Copy)]
struct Tube {
    sides: usize,
    rings: usize,
}

impl Tube {
    /// The tube of a branch at a fineness; `None` where the branch is too thin to show.
    fn of(branch: &Branch, fineness: f64) -> Option<Self> {
        let sides = (fineness * branch.points[0].1.sqrt()) as usize;
        let rings = (fineness * branch.length() * 0.12) as usize;
        (sides >= 3).then(|| Self { sides: sides.min(96), rings: rings.max(2) })
    }

    fn triangles(self) -> usize {
        2 * self.sides * self.rings
    }
}

/// The tubes of all branches, as fine as `budget` triangles allow.
pub(in crate::procedural) fn mesh(branches: &[Branch], budget: usize, material: u32) -> Mesh {
    let total = |fineness: f64| -> usize {
        branches.iter().filter_map(|b| Tube::of(b, fineness)).map(Tube::triangles).sum()
    };
    // Triangles grow with fineness, in steps: bisect for the finest that fits.
    let (mut low, mut high) = (0.0, 1024.0);
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        if total(middle) <= budget {
            low = middle;
        } else {
            high = middle;
        }
    }
    let mut mesh = Mesh { name: "bark".to_owned(), material, ..Mesh::default() };
    for branch in branches {
        if let Some(tube) = Tube::of(branch, low) {
            clad(&mut mesh, branch, tube);
        }
    }
    mesh
}

fn clad(mesh: &mut Mesh, branch: &Branch, tube: Tube) {
    let first = mesh.positions.len() as u32;
    let length = branch.length();
    let repeats = (branch.points[0].1 * 6.3 / TEXTURE_METRES.0).round().max(1.0);
    let mut side = (branch.at(0.01).0 - branch.at(0.0).0).any_orthonormal_vector();
    for ring in 0..=tube.rings {
        let t = ring as f64 / tube.rings as f64;
        let (center, radius) = branch.at(t);
        let axis = (branch.at(t + 0.06).0 - branch.at(t - 0.06).0).normalize();
        // Each ring continues the last one's side, so that the tube does not twist.
        side = (side - axis * side.dot(axis)).normalize();
        let other = axis.cross(side);
        for k in 0..=tube.sides {
            let turn = k as f64 / tube.sides as f64;
            let (cos, sin) = circle(turn);
            let out = side * cos + other * sin;
            // Roots: the trunk's foot is lobed.
            let (lobes, _) = circle(turn * 5.0);
            let lobe = if branch.level == 0 { 1.0 + 0.16 * lobes * (1.0 - 6.0 * t).max(0.0) } else { 1.0 };
            push(
                mesh,
                center + out * radius * lobe,
                out,
                DVec2::new(turn * repeats, t * length / TEXTURE_METRES.1),
            );
        }
    }
    let row = tube.sides as u32 + 1;
    for ring in 0..tube.rings as u32 {
        for k in 0..tube.sides as u32 {
            let a = first + ring * row + k;
            let (b, c, d) = (a + 1, a + row, a + row + 1);
            mesh.indices.extend([a, b, c, c, b, d]);
        }
    }
}

fn push(mesh: &mut Mesh, position: DVec3, normal: DVec3, uv: DVec2) {
    mesh.positions.push(position.as_vec3());
    mesh.normals.push(normal.as_vec3());
    mesh.uvs.push(uv.as_vec2());
    let color = DVec3::new(0.36, 0.27, 0.20).as_vec3();
    mesh.colors.push(Vec4::new(color.x, color.y, color.z, 1.0));
}
