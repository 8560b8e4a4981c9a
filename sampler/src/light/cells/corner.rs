//! Whether the eight cells of a corner may be mixed: no wall stands between their sides.
//!
//! A wall that stands on the border of two cells is in neither, so that no side straddles it. The floors before and behind
//! it look the same way and lie in one plane, and a lookup between them would mix the light of two rooms.

use glam::{IVec3, Vec3};

use super::CellScene;
use super::key::CellKey;
use super::sides::{ALMOST, LIFT, Side};

/// Cosine of the angle within which two sides are mixed by much.
const ALIKE: f32 = 0.9;
/// Distance of a side from another's plane within which they are mixed by much, in edges of a cell.
const NEAR: f32 = 0.3;

/// Whether something stands between two sides that lookups at a corner would mix. `sides` are those of the corner's cells,
/// with the cells' offsets from the lowest.
pub(super) fn leaks(scene: &CellScene<'_>, corner: CellKey, sides: &[(IVec3, Side)]) -> bool {
    let spacing = scene.lattice.spacing(corner.level());
    let [low, _] = scene.lattice.corners(corner);
    let place = |(offset, side): &(IVec3, Side)| offset.as_vec3() + side.place;
    // The first side of each group of sides that are mixed and see one another.
    let mut leaders: Vec<&(IVec3, Side)> = Vec::new();
    for one in sides {
        let mut mixed = leaders.iter().filter(|leader| {
            let between = place(leader) - place(one);
            let [off, back] = [one.1.normal, leader.1.normal].map(|normal| normal.dot(between).abs());
            one.1.normal.dot(leader.1.normal) > ALIKE && off < NEAR && back < NEAR
        });
        let Some(leader) = mixed.next() else {
            leaders.push(one);
            continue;
        };
        let [from, to]: [Vec3; 2] = [one, leader].map(|s| low + (place(s) + s.1.normal * LIFT) * spacing);
        if scene.about.is_blocked(from, to - from, ALMOST) {
            return true;
        }
    }
    false
}
