//! The light that arrives at a side of a cell: of the sky and of other surfaces, by rays.
//!
//! Rays of all sides are blocks of 16 of one (0, 2)-sequence (Sobol'; Kollig and Keller, "Efficient Multidimensional
//! Sampling", 2002), so that each block is well distributed by itself and all together are. Neighbouring cells begin
//! with other blocks, four in turn, so that a lookup of eight cells has the rays of four. From 64 rays on all have the same
//! directions: what differs between neighbours shows on even walls, as a pattern as wide as cells.

use argus_scene::shading::sky_radiance;
use glam::{IVec3, Vec3};

use super::super::lattice::CellKey;
use super::super::pattern::above;
use super::record::Record;
use super::scene::{BLOCK, CellScene, RAYS};
use super::sides::{ORIGINS, SideShape};

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

/// The first block of a cell, by the parities of i + k and j + k.
fn slot(at: IVec3) -> usize {
    (((at.x ^ at.z) & 1) | ((at.y ^ at.z) & 1) << 1) as usize
}

/// The origin of a ray. Four blocks give each direction of a block all origins in turn.
fn origin(ray: usize) -> usize {
    (ray % BLOCK + ray % BLOCK / ORIGINS * (ORIGINS / 2) + ray / BLOCK * 3) % ORIGINS
}

/// Adds the rays of a tier to the sums of the tiers before it, and what they meet to the record if things move.
pub(super) fn add_tier(
    scene: &CellScene<'_>,
    key: CellKey,
    shape: &SideShape,
    tier: usize,
    sums: &mut Sums,
    record: &mut Record,
) {
    let first = tier.checked_sub(1).map_or(0, |before| RAYS[before]);
    let slot = slot(key.at());
    let near = 0.5 * scene.lattice.spacing(key.level());
    let reach = scene.sky.reach.map_or(f32::MAX, |reach| reach as f32);
    let reflects = !scene.radiance.is_empty();
    let most = if reflects { f32::MAX } else { reach.max(near) };
    for ray in first..RAYS[tier] {
        let from = &shape.origins[origin(ray)];
        let direction = above(shape.side.normal, scene.sequence.disc(slot, ray));
        // Below the triangle's own plane lies what shading does not show.
        if from.is_covered || direction.dot(from.side) <= 0.0 {
            continue;
        }
        let hit = scene.about.nearest(from.start, direction, most);
        if let Some(blocks) = &scene.blocks {
            let met = hit.map(|hit| hit.t).or((most < f32::MAX).then_some(most));
            record.add_ray(blocks, from.start, direction, met);
        }
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
        let side = hit.filter(|_| reflects).and_then(|hit| match scene.blocks {
            Some(_) => scene.leaves.hit_reading(from.start, direction, &hit, |read| record.add_read(read)),
            None => scene.leaves.hit(from.start, direction, &hit),
        });
        sums.reflected += side.map_or(Vec3::ZERO, |side| scene.radiance[side as usize]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
