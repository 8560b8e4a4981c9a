//! Leaves: two triangles each, folded along the midrib, in autumn's colours.

use glam::{DVec2, DVec3, Vec4};

use super::Branch;
use crate::Mesh;
use crate::procedural::noise::{Random, fbm, smoothstep};

/// Leaf area of the whole tree, m², for any number of leaves.
const TOTAL_AREA: f64 = 8500.0;
/// Width of a leaf as a share of its length.
const ASPECT: f64 = 0.62;

/// Positions of the leaves.
#[derive(Debug)]
pub(in crate::procedural) struct Leaves {
    /// Their middles, metres, world space.
    pub(in crate::procedural) centers: Vec<DVec3>,
    /// Square metres of one leaf.
    pub(in crate::procedural) area: f64,
}

impl Leaves {
    /// `count` leaves around the outermost branches.
    pub(in crate::procedural) fn new(branches: &[Branch], count: usize, random: &mut Random) -> Self {
        // Twigs, and their parent branches by share of the length.
        let outermost = branches.iter().map(|b| b.level).max().unwrap_or(0);
        let twigs: Vec<&Branch> = branches.iter().filter(|b| b.level + 1 >= outermost).collect();
        let centers = (0..count)
            .map(|_| {
                let twig = twigs[random.index(twigs.len())];
                // Denser towards the tips.
                let t = random.unit().sqrt();
                twig.at(t).0 + random.in_ball() * (0.5 + 0.2 * twig.length())
            })
            .collect();
        Self { centers, area: TOTAL_AREA / count.max(1) as f64 }
    }
}

/// The leaves as triangles.
pub(in crate::procedural) fn mesh(leaves: &Leaves, random: &mut Random, material: u32) -> Mesh {
    let mut mesh = Mesh { name: "leaves".to_owned(), material, ..Mesh::default() };
    let count = leaves.centers.len();
    mesh.positions.reserve(4 * count);
    mesh.normals.reserve(4 * count);
    mesh.colors.reserve(4 * count);
    mesh.uvs.reserve(4 * count);
    mesh.indices.reserve(6 * count);
    let middle = leaves.centers.iter().sum::<DVec3>() / count.max(1) as f64 - DVec3::Y * 4.0;
    // A kite of length l and width w covers l·w/2.
    let length = (2.0 * leaves.area / ASPECT).sqrt();
    for &center in &leaves.centers {
        let outward = (center - middle).normalize_or(DVec3::Y);
        // The face looks outward: its front is seen from outside, and its normal is not flipped.
        let mut face = (outward + random.direction() * 0.8).normalize_or(outward);
        if face.dot(outward) < 0.0 {
            face = -face;
        }
        let droop = random.direction() - DVec3::Y * 0.6;
        let along = (droop - face * droop.dot(face)).normalize_or(face.any_orthonormal_vector());
        let across = face.cross(along);
        let size = length * random.range(0.75, 1.2);
        let fold = face * (0.10 * size);
        let corners = [
            center - along * (0.5 * size),
            center + across * (0.5 * ASPECT * size) + fold - along * (0.08 * size),
            center + along * (0.5 * size),
            center - across * (0.5 * ASPECT * size) + fold - along * (0.08 * size),
        ];
        // The normal is mostly that of the crown's surface: the crown reads as one volume, not as single leaves.
        let normal = (outward * 0.65 + face * 0.5).normalize();
        let color = color(center, random.unit());
        let first = mesh.positions.len() as u32;
        for corner in corners {
            mesh.positions.push(corner.as_vec3());
            mesh.normals.push(normal.as_vec3());
            mesh.uvs.push(DVec2::ZERO.as_vec2());
            let color = color.as_vec3();
            mesh.colors.push(Vec4::new(color.x, color.y, color.z, 1.0));
        }
        mesh.indices.extend([0, 2, 1, 0, 3, 2].map(|k| first + k));
    }
    mesh
}

/// Green turning to gold and red, in drifts across the crown.
fn color(p: DVec3, dice: f64) -> DVec3 {
    let green = DVec3::new(0.180, 0.310, 0.040);
    let gold = DVec3::new(0.860, 0.520, 0.060);
    let red = DVec3::new(0.720, 0.170, 0.030);
    let drift = fbm(DVec2::new(p.x + 0.6 * p.y, p.z - 0.5 * p.y) / 9.0, 3, 61) + 0.35 * (dice - 0.5);
    let turned = green.lerp(gold, smoothstep(-0.50, -0.10, drift));
    turned.lerp(red, smoothstep(0.0, 0.45, drift)) * (0.8 + 0.4 * dice)
}
