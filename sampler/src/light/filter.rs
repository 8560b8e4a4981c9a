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

/// Some texels of an image or list, ascending.
pub(super) struct Listed {
    texels: Vec<u32>,
    /// Each texel's place in the list, or [`NOT_LISTED`].
    places: Vec<u32>,
}

const NOT_LISTED: u32 = u32::MAX;

/// A line of texels.
#[derive(Clone, Copy)]
enum Line {
    Row,
    Column,
}

impl Listed {
    /// The texels of which this is so, and which show a surface.
    pub(super) fn of(points: &ShadingPoints, is_listed: impl Fn(usize) -> bool + Sync) -> Self {
        let of = |texel: u32| points.all[texel as usize].exists && is_listed(texel as usize);
        let all = (0..points.all.len() as u32).into_par_iter().with_min_len(4096);
        Self::numbered(all.filter(|texel| of(*texel)).collect(), points)
    }

    fn numbered(texels: Vec<u32>, points: &ShadingPoints) -> Self {
        let mut places = vec![NOT_LISTED; points.all.len()];
        for (place, texel) in texels.iter().enumerate() {
            places[*texel as usize] = place as u32;
        }
        Self { texels, places }
    }

    /// These and those up to so many rows above and below.
    fn and_rows_around(&self, points: &ShadingPoints, reach: isize) -> Self {
        let width = points.size[0];
        let mut is_near = vec![false; points.all.len()];
        for texel in self.texels() {
            for row in -reach..=reach {
                if let Some(near) = is_near.get_mut(texel.wrapping_add_signed(row * width as isize)) {
                    *near = true;
                }
            }
        }
        Self::of(points, |texel| is_near[texel])
    }

    pub(super) fn is_empty(&self) -> bool {
        self.texels.is_empty()
    }

    pub(super) fn texels(&self) -> impl Iterator<Item = usize> {
        self.texels.iter().map(|texel| *texel as usize)
    }

    pub(super) fn par_texels(&self) -> impl IndexedParallelIterator<Item = usize> {
        self.texels.par_iter().map(|texel| *texel as usize)
    }

    /// The value of a texel, of those of the list.
    fn value<T: Copy>(&self, values: &[T], texel: usize) -> Option<T> {
        values.get(self.places[texel] as usize).copied()
    }
}

/// Means over the texels around each that show the same surface, rows and then columns. Nothing changes without
/// neighbours.
pub(super) fn smoothed<T: Shared>(values: Vec<T>, points: &ShadingPoints) -> Vec<T> {
    if points.first.is_none() {
        return values;
    }
    let all = || (0..points.all.len()).into_par_iter();
    let [wide, narrow] = REACHES;
    [(wide, Line::Row), (wide, Line::Column), (narrow, Line::Row), (narrow, Line::Column)]
        .into_iter()
        .fold(values, |values, (reach, line)| means(all(), points, line, reach, |texel| Some(values[texel])))
}

/// The same for the texels of a list, of which `values` are. Others do not count.
pub(super) fn smoothed_among<T: Shared>(values: Vec<T>, listed: &Listed, points: &ShadingPoints) -> Vec<T> {
    if points.first.is_none() {
        return values;
    }
    let [wide, narrow] = REACHES;
    [(wide, Line::Row), (wide, Line::Column), (narrow, Line::Row), (narrow, Line::Column)].into_iter().fold(
        values,
        |values, (reach, line)| {
            means(listed.par_texels(), points, line, reach, |texel| listed.value(&values, texel))
        },
    )
}

/// Means of all texels' values by one box, at the texels of a list.
pub(super) fn smoothed_at<T: Shared>(
    values: &[T],
    listed: &Listed,
    points: &ShadingPoints,
    reach: isize,
) -> Vec<T> {
    if points.first.is_none() {
        return listed.texels().map(|texel| values[texel]).collect();
    }
    let around = listed.and_rows_around(points, reach);
    let rows = means(around.par_texels(), points, Line::Row, reach, |texel| Some(values[texel]));
    means(listed.par_texels(), points, Line::Column, reach, |texel| around.value(&rows, texel))
}

/// Means over a reach along a line, at some texels. Texels without a value do not count.
fn means<T: Shared>(
    texels: impl IndexedParallelIterator<Item = usize>,
    points: &ShadingPoints,
    line: Line,
    reach: isize,
    value: impl Fn(usize) -> Option<T> + Sync,
) -> Vec<T> {
    let [width, height] = points.size;
    let mean = |texel: usize| {
        let point = &points.all[texel];
        if !point.exists {
            return T::default();
        }
        let (place, length, step) = match line {
            Line::Row => (texel % width, width, 1),
            Line::Column => (texel / width, height, width),
        };
        let (mut sum, mut weights) = (T::default(), 0.0);
        for by in -reach..=reach {
            let there = place as isize + by;
            if there < 0 || there >= length as isize {
                continue;
            }
            let other = texel.wrapping_add_signed(by * step as isize);
            let Some(found) = value(other) else { continue };
            if by == 0 || point.agrees(&points.all[other]) {
                let weight = if by.abs() == reach { 0.5 } else { 1.0 };
                sum += found * weight;
                weights += weight;
            }
        }
        sum * (1.0 / weights)
    };
    texels.with_min_len(1024).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::shading_points::{Effort, ShadingPoint};
    use super::*;

    /// A wall of 12 × 9 texels with an edge in its middle and a hole.
    fn wall() -> ShadingPoints {
        let all = (0..12 * 9).map(|texel| {
            let (x, y) = (texel % 12, texel / 12);
            let side = if x < 6 { Vec3::Z } else { Vec3::X };
            let position = Vec3::new(x as f32 * 0.01, y as f32 * 0.01, -5.0);
            ShadingPoint { exists: texel != 40, position, side, normal: side, ..ShadingPoint::default() }
        });
        ShadingPoints {
            size: [12, 9],
            first: Some([0, 0]),
            effort: Effort::Shared,
            numbers: Vec::new(),
            all: all.collect(),
            bounds: argus_scene::Bounds::EMPTY,
        }
    }

    #[test]
    fn texels_of_a_list_have_the_means_of_the_whole_image() {
        let points = wall();
        let values: Vec<f32> = (0..points.all.len()).map(|texel| (texel * 37 % 11) as f32).collect();
        let whole = Listed::of(&points, |_| true);
        let rows = means(whole.par_texels(), &points, Line::Row, 4, |texel| Some(values[texel]));
        let all = means(whole.par_texels(), &points, Line::Column, 4, |texel| whole.value(&rows, texel));
        for some in [vec![0, 5, 6, 50, 107], vec![17], vec![]] {
            let listed = Listed::of(&points, |texel| some.contains(&texel));
            let expected: Vec<f32> = listed.texels().filter_map(|texel| whole.value(&all, texel)).collect();
            assert_eq!(smoothed_at(&values, &listed, &points, 4), expected);
        }
        let listed: Vec<f32> = whole.texels().map(|texel| values[texel]).collect();
        let among = smoothed_among(listed, &whole, &points);
        let everywhere = smoothed(values, &points);
        assert!(whole.texels().zip(among).all(|(texel, mean)| everywhere[texel] == mean));
    }

    #[test]
    fn texels_beyond_an_edge_or_not_listed_do_not_count() {
        let points = wall();
        let listed = Listed::of(&points, |texel| texel % 12 != 3);
        let values: Vec<f32> = listed.texels().map(|texel| if texel % 12 < 6 { 1.0 } else { 9.0 }).collect();
        let means = smoothed_among(values.clone(), &listed, &points);
        assert!(means.iter().zip(&values).all(|(mean, value)| (mean - value).abs() < 1e-5), "{means:?}");
    }
}
