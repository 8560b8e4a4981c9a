//! What fills light cells: a posed and lit scene, and the directions of rays.

use argus_scene::Sky;
use argus_scene::light_sampling::disc_point;
use glam::{DVec2, Vec2, Vec3};

use super::super::lattice::Lattice;
use super::super::paths::Leaves;
use super::blocks::Blocks;
use super::tree::BoxTree;
use crate::light_rays::LightRaysAbout;
use crate::surfaces::Surfaces;

/// Rays of a block.
pub(super) const BLOCK: usize = 16;
/// Blocks that neighbouring cells begin with in turn.
const SLOTS: usize = 4;
/// Rays of a side at each tier. A tier's rays are those of the one before it, and further ones.
pub(super) const RAYS: [usize; 3] = [16, 64, 256];

/// What fills cells: a posed and lit scene. Positions are metres about the centre of its leaves.
pub(super) struct CellScene<'a> {
    pub(super) lattice: Lattice,
    pub(super) leaves: &'a Leaves,
    pub(super) tree: &'a BoxTree,
    pub(super) surfaces: &'a Surfaces,
    /// The scene about that centre. Rays of cells start from surfaces, so they are the same for all eyes.
    pub(super) about: &'a LightRaysAbout<'a>,
    pub(super) sky: &'a Sky,
    /// Radiance that leaf sides reflect; empty if they light nothing.
    pub(super) radiance: &'a [Vec3],
    pub(super) sequence: &'a Sequence,
    /// Blocks by which what rays meet is recorded; `None` if nothing moves.
    pub(super) blocks: Option<Blocks>,
}

/// Points of the unit disc for all rays of all slots.
pub(super) struct Sequence(Vec<Vec2>);

impl Sequence {
    pub(super) fn new() -> Self {
        let [.., most] = RAYS;
        Self((0..most as u32).map(|index| disc_point(point(index)).as_vec2()).collect())
    }

    /// The point of a ray of a cell that begins with the block `slot`. After so many blocks as there are slots, all cells have had
    /// the same ones.
    pub(super) fn disc(&self, slot: usize, ray: usize) -> Vec2 {
        let [round, turn] = [ray / BLOCK / SLOTS, ray / BLOCK % SLOTS];
        self.0[(round * SLOTS + (turn ^ slot)) * BLOCK + ray % BLOCK]
    }
}

/// A point of the (0, 2)-sequence: van der Corput's numbers, and the second dimension of Sobol's.
fn point(index: u32) -> DVec2 {
    let (mut second, mut column, mut rest) = (0u32, 1u32 << 31, index);
    while rest != 0 {
        if rest & 1 == 1 {
            second ^= column;
        }
        column ^= column >> 1;
        rest >>= 1;
    }
    let unit = |bits: u32| f64::from(bits) / (f64::from(u32::MAX) + 1.0);
    DVec2::new(unit(index.reverse_bits()), unit(second))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_begin_with_different_directions_and_in_the_end_have_the_same() {
        let sequence = Sequence::new();
        let points = |slot: usize, rays: std::ops::Range<usize>| {
            let mut all: Vec<[u32; 2]> =
                rays.map(|ray| sequence.disc(slot, ray).to_array().map(f32::to_bits)).collect();
            all.sort_unstable();
            all
        };
        for slot in 1..SLOTS {
            assert_ne!(points(slot, 0..16), points(0, 0..16));
            for rays in [0..64, 64..128, 0..256] {
                assert_eq!(points(slot, rays.clone()), points(0, rays));
            }
        }
    }

    #[test]
    fn every_block_has_a_point_in_each_of_sixteen_boxes_of_every_shape() {
        for block in 0..64 {
            for (columns, rows) in [(1, 16), (2, 8), (4, 4), (8, 2), (16, 1)] {
                let mut seen = [false; 16];
                for index in 0..16 {
                    let at = point(block * 16 + index) * DVec2::new(f64::from(columns), f64::from(rows));
                    let place = at.x as usize + at.y as usize * columns as usize;
                    assert!(!std::mem::replace(&mut seen[place], true), "block {block}, {columns}×{rows}");
                }
            }
        }
    }
}
