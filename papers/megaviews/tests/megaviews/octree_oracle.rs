//! Voxelisation and octrees on the CPU, in f64.

use std::collections::BTreeSet;

use argus_megaviews::hierarchy::{RootCube, Triangle};
use glam::{DVec3, UVec3};

/// Whether a triangle meets a closed box about `center` of so large half edges: the separating axis test with all
/// thirteen axes.
pub(crate) fn meets(corners: [DVec3; 3], center: DVec3, half: f64) -> bool {
    let [a, b, c] = corners.map(|corner| corner - center);
    let edges = [b - a, c - b, a - c];
    let units = [DVec3::X, DVec3::Y, DVec3::Z];
    let crossed = units.iter().flat_map(|unit| edges.map(|edge| unit.cross(edge)));
    let axes = units.into_iter().chain([edges[0].cross(edges[1])]).chain(crossed);
    axes.into_iter().all(|axis| {
        let reach = half * (axis.x.abs() + axis.y.abs() + axis.z.abs());
        let along = [a, b, c].map(|corner| corner.dot(axis));
        let least = along.iter().copied().fold(f64::INFINITY, f64::min);
        let most = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        least <= reach && most >= -reach
    })
}

/// Morton code of a cell.
pub(crate) fn code(cell: UVec3) -> u32 {
    (0..10).fold(0, |code, bit| {
        let at = |part: u32, shift: u32| (part >> bit & 1) << (3 * bit + shift);
        code | at(cell.x, 0) | at(cell.y, 1) | at(cell.z, 2)
    })
}

/// Codes of the cells of a level that triangles meet, each cell larger by `margin` edges of the root on every side.
pub(crate) fn cells(root: &RootCube, triangles: &[Triangle], level: u32, margin: f64) -> BTreeSet<u32> {
    let mut found = BTreeSet::new();
    let along = f64::from(1u32 << level);
    for triangle in triangles.iter().filter(|t| t.is_surface()) {
        let corners = triangle.corners.map(|corner| root.unit_from_world(corner));
        let [a, b, c] = corners;
        let cell = |p: DVec3| (p * along).floor().clamp(DVec3::ZERO, DVec3::splat(along - 1.0)).as_uvec3();
        let (least, most) = (cell(a.min(b).min(c) - margin), cell(a.max(b).max(c) + margin));
        for z in least.z..=most.z {
            for y in least.y..=most.y {
                for x in least.x..=most.x {
                    let at = UVec3::new(x, y, z);
                    let center = (at.as_dvec3() + 0.5) / along;
                    if meets(corners, center, 0.5 / along + margin) {
                        found.insert(code(at));
                    }
                }
            }
        }
    }
    found
}
