//! The light that arrives at a side of a cell: of the sky and of other surfaces, by rays.
//!
//! Rays of all sides are blocks of 16 of one (0, 2)-sequence (Sobol'; Kollig and Keller, "Efficient Multidimensional
//! Sampling", 2002), so that each block is well distributed by itself and all together are. Neighbouring cells take other
//! blocks, four in turn, so that a lookup of eight cells has the rays of four.

use argus_scene::light_sampling::disc_point;
use argus_scene::shading::sky_radiance;
use glam::{DVec2, IVec3, Vec2, Vec3};

use super::super::pattern::above;
use super::CellScene;
use super::key::CellKey;
use super::sides::{ORIGINS, SideShape};

/// Rays of a block.
const BLOCK: usize = 16;
/// Blocks that neighbouring cells take in turn.
const SLOTS: usize = 4;
/// Rays of a side at each tier. A tier's rays are those of the one before it, and further ones.
pub(super) const RAYS: [usize; 3] = [16, 64, 256];

/// Sums over the rays of a side, in the order of the sequence, so that they are the same however often they were stopped.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sums {
    /// Radiance of the sky along rays that reach it.
    pub(super) seen: Vec3,
    /// Radiance of the sky along all rays.
    pub(super) whole: Vec3,
    /// Radiance that surfaces reflect.
    pub(super) reflected: Vec3,
    /// Number of rays that count.
    pub(super) valid: f32,
}

/// Points of the unit disc for all rays of all slots.
pub(super) struct Sequence(Vec<Vec2>);

impl Sequence {
    pub(super) fn new() -> Self {
        let [.., most] = RAYS;
        Self((0..(most * SLOTS) as u32).map(|index| disc_point(point(index)).as_vec2()).collect())
    }

    fn disc(&self, slot: usize, ray: usize) -> Vec2 {
        let block = ray / BLOCK * SLOTS + slot;
        self.0[block * BLOCK + ray % BLOCK]
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

/// The blocks of a cell, by the parities of i + k and j + k.
fn slot(at: IVec3) -> usize {
    (((at.x ^ at.z) & 1) | ((at.y ^ at.z) & 1) << 1) as usize
}

/// The origin of a ray. Four blocks give each direction of a block all origins in turn.
fn origin(ray: usize) -> usize {
    (ray % BLOCK + ray % BLOCK / ORIGINS * (ORIGINS / 2) + ray / BLOCK * 3) % ORIGINS
}

/// Adds the rays of a tier to the sums of the tiers before it.
pub(super) fn add_tier(scene: &CellScene<'_>, key: CellKey, shape: &SideShape, tier: usize, sums: &mut Sums) {
    let first = tier.checked_sub(1).map_or(0, |before| RAYS[before]);
    let slot = slot(key.at());
    let near = 0.5 * scene.lattice.spacing(key.level());
    let reach = scene.sky.reach.map_or(f32::MAX, |reach| reach as f32);
    for ray in first..RAYS[tier] {
        let from = &shape.origins[origin(ray)];
        let direction = above(shape.side.normal, scene.sequence.disc(slot, ray));
        // Below the triangle's own plane lies what shading does not show.
        if direction.dot(from.side) <= 0.0 {
            continue;
        }
        let hit = scene.about.nearest(from.start, direction, f32::MAX);
        // The back of something close by: the origin is inside of a wall.
        if hit.is_some_and(|hit| !hit.front && hit.t < near) {
            continue;
        }
        sums.valid += 1.0;
        let radiance = sky_radiance(scene.sky, direction);
        sums.whole += radiance;
        if hit.is_none_or(|hit| hit.t > reach) {
            sums.seen += radiance;
        }
        let side = hit.and_then(|hit| scene.leaves.hit(from.start, direction, &hit));
        sums.reflected += side.map_or(Vec3::ZERO, |side| scene.radiance[side as usize]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn each_origin_casts_as_many_rays_and_in_time_all_directions() {
        for block in 0..4 {
            let mut count = [0; ORIGINS];
            (0..BLOCK).for_each(|ray| count[origin(block * BLOCK + ray)] += 1);
            assert_eq!(count, [2; ORIGINS]);
        }
        for direction in 0..ORIGINS {
            // Two rays of a block share a direction's eighth.
            let mut seen = [false; ORIGINS];
            for block in 0..4 {
                seen[origin(block * BLOCK + direction)] = true;
                seen[origin(block * BLOCK + direction + ORIGINS)] = true;
            }
            assert_eq!(seen, [true; ORIGINS]);
        }
    }
}
