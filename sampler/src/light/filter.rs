//! Shares what neighbouring texels found, within surfaces.

use std::ops::{AddAssign, Mul};

use rayon::prelude::*;

use super::pattern::SQUARE;
use super::shading_points::ShadingPoints;

/// Reaches of the filter's two boxes in texels, whose outermost texels have half weight. The first covers a square of slots,
/// so that every slot has the same weight. The second takes off the edges that a few bright rays leave.
pub(super) const REACHES: [isize; 2] = [SQUARE as isize / 2, SQUARE as isize / 4];

/// Reach of the box over pixels that light cells leave uneven: most cells are four to eight pixels wide.
pub(super) const REACH_OF_CELLS: isize = 4;

/// What texels share: a sum of colours, or several.
pub(super) trait Shared: Copy + Default + Send + Sync + AddAssign + Mul<f32, Output = Self> {}

impl<T: Copy + Default + Send + Sync + AddAssign + Mul<f32, Output = T>> Shared for T {}

/// Means over the texels around each that show the same surface, rows and then columns. Nothing changes without
/// neighbours.
pub(super) fn smoothed<T: Shared>(values: Vec<T>, points: &ShadingPoints) -> Vec<T> {
    REACHES.into_iter().fold(values, |values, reach| smoothed_by(values, points, reach))
}

/// The same by one box of a reach.
pub(super) fn smoothed_by<T: Shared>(values: Vec<T>, points: &ShadingPoints, reach: isize) -> Vec<T> {
    if points.first.is_none() {
        return values;
    }
    let [width, height] = points.size;
    let rows = along(&values, points, 1, reach, |index| (index % width, width));
    along(&rows, points, width, reach, |index| (index / width, height))
}

/// Means over a reach along a line of texels `step` apart; `line` says which place a texel has on its line, and the line's length.
fn along<T: Shared>(
    values: &[T],
    points: &ShadingPoints,
    step: usize,
    reach: isize,
    line: impl Fn(usize) -> (usize, usize) + Sync,
) -> Vec<T> {
    let mean = |index: usize| {
        let point = &points.all[index];
        if !point.exists {
            return T::default();
        }
        let (place, length) = line(index);
        let (mut sum, mut weights) = (T::default(), 0.0);
        for by in -reach..=reach {
            let there = place as isize + by;
            if there < 0 || there >= length as isize {
                continue;
            }
            let other = index.wrapping_add_signed(by * step as isize);
            if by == 0 || point.agrees(&points.all[other]) {
                let weight = if by.abs() == reach { 0.5 } else { 1.0 };
                sum += values[other] * weight;
                weights += weight;
            }
        }
        sum * (1.0 / weights)
    };
    (0..values.len()).into_par_iter().with_min_len(1024).map(mean).collect()
}
