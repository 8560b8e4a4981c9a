//! Which rays a texel casts.
//!
//! Texels are tiled by squares of 8×8 *slots* (Keller, Heidrich: "Interleaved Sampling", 2001). Each slot casts other rays
//! of one well-distributed set, so that the texels of a square together cast all of it.

use argus_scene::light_sampling::{disc_point, r2};
use glam::{DVec2, Vec2, Vec3};

/// Texels along a side of a square of slots.
pub(super) const SQUARE: u32 = 8;
/// Slots of a square.
pub(super) const SLOTS: usize = (SQUARE * SQUARE) as usize;

/// The slot of a texel by its coordinates: Bayer's ordered dither, so that neighbours take distant points. The quotients by 4
/// are the slots of squares of 4×4 texels.
#[inline]
pub(super) fn slot([x, y]: [u32; 2]) -> usize {
    let digit = |bit: u32| ((x >> bit & 1) * 2) ^ ((y >> bit & 1) * 3);
    (digit(0) * 16 + digit(1) * 4 + digit(2)) as usize
}

/// A slot by a number; consecutive numbers have distant slots.
#[inline]
pub(super) fn shuffled(number: usize) -> usize {
    slot([number as u32, (number / SQUARE as usize) as u32])
}

/// Points of the unit square; the first of them all lies in a corner and is left out.
pub(super) fn square_points(count: usize) -> Vec<Vec2> {
    (0..count).map(|i| r2(i as u32 + 1).as_vec2()).collect()
}

/// Points of the unit disc, uniform by area.
pub(super) fn disc_points(count: usize) -> Vec<Vec2> {
    (0..count).map(|i| disc_point(r2(i as u32 + 1)).as_vec2()).collect()
}

/// Points for the rays of every slot.
pub(super) struct Pattern {
    points: Vec<Vec2>,
    per_slot: usize,
}

impl Pattern {
    /// Points of the unit square, `per_slot` for each slot.
    pub(super) fn of_square(per_slot: usize) -> Self {
        Self { points: square_points(SLOTS * per_slot), per_slot }
    }

    /// Points of the unit disc, uniform by area, `per_slot` for each slot.
    pub(super) fn of_disc(per_slot: usize) -> Self {
        Self { points: disc_points(SLOTS * per_slot), per_slot }
    }

    /// The points of a slot.
    #[inline]
    pub(super) fn of_slot(&self, slot: usize) -> impl Iterator<Item = Vec2> + '_ {
        (0..self.per_slot).map(move |ray| self.points[ray * SLOTS + slot])
    }
}

/// The unit vector over a point of the unit disc around a unit normal: distributed by its cosine where points of the disc
/// are uniform by area.
pub(super) fn above(normal: Vec3, disc: Vec2) -> Vec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let up = (1.0 - disc.length_squared()).max(0.0).sqrt();
    tangent * disc.x + bitangent * disc.y + normal * up
}

/// Two numbers in 0..1 by an index (lowbias32, Wellons).
pub(super) fn hash(index: u32) -> DVec2 {
    let mix = |x: u32| {
        let x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
        let x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
        x ^ x >> 16
    };
    let (first, second) = (mix(index), mix(!index));
    DVec2::new(f64::from(first), f64::from(second)) / (f64::from(u32::MAX) + 1.0)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_square_has_every_slot_wherever_it_begins() {
        for begin in [[0, 0], [3, 5], [u32::MAX / 2, 7]] {
            let of_square = |side: u32, quotient: usize| -> BTreeSet<usize> {
                let texels = (0..side * side).map(|i| [begin[0] + i % side, begin[1] + i / side]);
                texels.map(|texel| slot(texel) / quotient).collect()
            };
            assert_eq!(of_square(SQUARE, 1).len(), SLOTS);
            assert_eq!(of_square(4, 4).len(), 16);
        }
    }
}
