//! Which of the eight cells of a corner may be mixed: those between whose sides no wall stands.
//!
//! A wall that stands on the border of two cells is in neither, so that no side straddles it. The floors before and behind
//! it look the same way and lie in one plane, and a lookup between them would mix the light of two rooms. So sides that look
//! alike but do not see one another are *groups* of their own, and a pixel takes the group of the side that it lies on.

use glam::{IVec3, Vec3};

use super::super::lattice::CellKey;
use super::scene::CellScene;
use super::sides::{ALMOST, LIFT, Side};

/// Which sides are mixed.
#[derive(Clone, Copy)]
struct Alike {
    /// Least cosine of the angle between their normals.
    facing: f32,
    /// Most distance of a side from the other's plane, in edges of a cell.
    off: f32,
}

/// Sides that are mixed by much: a wall between these makes groups.
const MUCH: Alike = Alike { facing: 0.9, off: 0.3 };
/// Sides that are mixed at all: beside a wall, what is mixed by little must be seen, too.
const AT_ALL: Alike = Alike { facing: 0.3, off: 0.9 };
/// Most groups of a corner; sides of further ones join the last.
pub(super) const MOST_GROUPS: usize = 16;

/// The first side of the sides that are mixed and see one another.
struct Leader<'a> {
    of: &'a (IVec3, Side),
    /// Number of its group.
    group: u8,
    /// Whether something stands between it and another side that looks alike.
    is_parted: bool,
}

/// The group of each side of a corner, from 1, and 0 for sides that see all sides like them; empty if all do. `sides` are
/// those of the corner's cells, with the cells' offsets from the lowest.
pub(super) fn groups(scene: &CellScene<'_>, corner: CellKey, sides: &[(IVec3, Side)]) -> Box<[u8]> {
    let spacing = scene.lattice.spacing(corner.level());
    let [low, _] = scene.lattice.corners(corner);
    let sees = |one: &(IVec3, Side), other: &(IVec3, Side)| {
        let [from, to] = [one, other].map(|(offset, side)| low + above(*offset, side) * spacing);
        !scene.about.is_blocked(from, to - from, ALMOST)
    };
    if parted(sides, MUCH, sees).is_empty() { Box::default() } else { parted(sides, AT_ALL, sees) }
}

/// The group of each side; empty if all sides that are mixed see one another.
fn parted<'a>(
    sides: &'a [(IVec3, Side)],
    alike: Alike,
    sees: impl Fn(&(IVec3, Side), &(IVec3, Side)) -> bool,
) -> Box<[u8]> {
    let mut leaders: Vec<Leader<'a>> = Vec::new();
    let mut leader_of_side = Vec::with_capacity(sides.len());
    for one in sides {
        let (mut joined, mut is_parted) = (None, false);
        for (number, leader) in leaders.iter_mut().enumerate().filter(|(_, l)| alike.mixes(l.of, one)) {
            if sees(one, leader.of) {
                joined = Some(number);
                break;
            }
            (leader.is_parted, is_parted) = (true, true);
        }
        let number = joined.unwrap_or_else(|| {
            let group = (leaders.len() + 1).min(MOST_GROUPS) as u8;
            leaders.push(Leader { of: one, group, is_parted });
            leaders.len() - 1
        });
        leaders[number].is_parted |= is_parted;
        leader_of_side.push(number);
    }
    if !leaders.iter().any(|leader| leader.is_parted) {
        return Box::default();
    }
    let group = |number: usize| if leaders[number].is_parted { leaders[number].group } else { 0 };
    leader_of_side.into_iter().map(group).collect()
}

/// Where a side is looked at: above its mean point, from the lowest cell's lowest corner, in edges of a cell.
pub(super) fn above(offset: IVec3, side: &Side) -> Vec3 {
    offset.as_vec3() + side.place + side.normal * LIFT
}

impl Alike {
    fn mixes(self, (offset, one): &(IVec3, Side), (other_offset, other): &(IVec3, Side)) -> bool {
        let between = other_offset.as_vec3() + other.place - offset.as_vec3() - one.place;
        let [off, back] = [one.normal, other.normal].map(|normal| normal.dot(between).abs());
        one.normal.dot(other.normal) > self.facing && off < self.off && back < self.off
    }
}
