//! Which rays a texel casts.
//!
//! Texels are tiled by squares of 4×4 *slots* (Keller, Heidrich: "Interleaved Sampling", 2001). Each slot casts other rays
//! of one well-distributed set, so that the texels of a square together cast all of it.

use argus_scene::light_sampling::{disc_point, r2};
use glam::Vec2;

/// Texels along a side of a square of slots.
pub(super) const SQUARE: u32 = 4;
/// Slots of a square.
pub(super) const SLOTS: usize = (SQUARE * SQUARE) as usize;

/// Order in which the slots of a square take points (ordered dither), so that neighbours take distant points.
const ORDER: [u8; SLOTS] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

/// The slot of a texel by its coordinates.
#[inline]
pub(super) fn slot(place: [u32; 2]) -> usize {
    let [x, y] = place.map(|at| at % SQUARE);
    usize::from(ORDER[(y * SQUARE + x) as usize])
}

/// A slot by a number; consecutive numbers have distant slots.
#[inline]
pub(super) fn shuffled(number: usize) -> usize {
    usize::from(ORDER[number % SLOTS])
}

/// Points for the rays of every slot.
pub(super) struct Pattern {
    points: Vec<Vec2>,
    per_slot: usize,
}

impl Pattern {
    /// Points of the unit square, `per_slot` for each slot.
    pub(super) fn of_square(per_slot: usize) -> Self {
        // Without the first, which lies in a corner.
        let points = (0..SLOTS * per_slot).map(|i| r2(i as u32 + 1).as_vec2());
        Self { points: points.collect(), per_slot }
    }

    /// Points of the unit disc, uniform by area.
    pub(super) fn of_disc(per_slot: usize) -> Self {
        let points = (0..SLOTS * per_slot).map(|i| disc_point(r2(i as u32 + 1)).as_vec2());
        Self { points: points.collect(), per_slot }
    }

    /// The points of a slot.
    #[inline]
    pub(super) fn of_slot(&self, slot: usize) -> impl Iterator<Item = Vec2> + '_ {
        (0..self.per_slot).map(move |ray| self.points[ray * SLOTS + slot])
    }

    /// The points of all slots.
    pub(super) fn all(&self) -> &[Vec2] {
        &self.points
    }
}
