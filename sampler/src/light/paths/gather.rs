//! Shading points gather what leaf sides reflect.
//!
//! A texel of each block of 2×2 casts rays, and a second one where the block shows two surfaces. They form two images of half
//! the size, in which neighbours share what they found within a surface, as for direct light. All texels then take the mean
//! of those around them that show the same surface. Where there are none they cast rays themselves.

use argus_scene::Bounds;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::super::filter::smoothed;
use super::super::pattern::{Pattern, SLOTS, above};
use super::super::shading_points::{Effort, ShadingPoint, ShadingPoints};
use super::leaves::Leaves;
use crate::light_rays::LightRaysAbout;

/// Slots whose rays are cast by a texel without neighbours in a list, and by one in an image.
const SLOTS_IN_LIST: usize = 8;
const SLOTS_ALONE: usize = 4;
/// Blocks on each side of a texel's own whose light it takes; and if none of them shows its surface.
const REACHES: [i64; 2] = [1, 3];

/// Casts rays from texels about an eye.
pub(in crate::light) struct Gatherer<'a> {
    pub(in crate::light) leaves: &'a Leaves,
    /// Radiance that leaf sides reflect.
    pub(in crate::light) radiance: &'a [Vec3],
    pub(in crate::light) about: &'a LightRaysAbout<'a>,
    /// The eye about the centre of the leaves.
    pub(in crate::light) from_eye: Vec3,
}

impl Gatherer<'_> {
    /// Irradiance / π at each texel; `rays` is the number of rays of one that shares.
    pub(in crate::light) fn irradiance_over_pi(&self, points: &ShadingPoints, rays: usize) -> Vec<Vec3> {
        let pattern = Pattern::of_disc(rays);
        let count = points.all.len();
        let Some(first) = points.first else {
            let alone = |index: usize| self.of_slots(&points.all[index], &pattern, 0, SLOTS_IN_LIST);
            return (0..count).into_par_iter().with_min_len(64).map(alone).collect();
        };
        // The second surface of a block casts other rays than the first.
        let layers = halved(points, first).into_iter().zip([0, SLOTS / 2]).map(|(half, other)| {
            let one = |index: usize| self.of_slots(&half.all[index], &pattern, half.slot(index) + other, 1);
            let found: Vec<Vec3> = (0..half.all.len()).into_par_iter().with_min_len(64).map(one).collect();
            let found = smoothed(found, &half);
            (half, found)
        });
        let layers: Vec<(ShadingPoints, Vec<Vec3>)> = layers.collect();
        let spread = |index: usize| {
            let point = &points.all[index];
            if !point.exists {
                return Vec3::ZERO;
            }
            REACHES
                .into_iter()
                .find_map(|reach| mean_around(points.place(index), point, &layers, reach))
                .unwrap_or_else(|| self.of_slots(point, &pattern, points.slot(index), SLOTS_ALONE))
        };
        (0..count).into_par_iter().with_min_len(256).map(spread).collect()
    }

    /// Mean of what the rays of some slots bring, which begin with `first`.
    fn of_slots(&self, point: &ShadingPoint, pattern: &Pattern, first: usize, slots: usize) -> Vec3 {
        if !point.exists {
            return Vec3::ZERO;
        }
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for slot in 0..slots {
            // The points of consecutive slots are far from one another.
            for disc in pattern.of_slot((first + slot) % SLOTS) {
                sum += self.along(point, disc);
                count += 1.0;
            }
        }
        sum / count
    }

    /// Radiance along the ray above a point of the unit disc.
    fn along(&self, point: &ShadingPoint, disc: Vec2) -> Vec3 {
        let direction = above(point.normal, disc);
        if !(point.is_lifted || direction.dot(point.side) > 0.0) {
            return Vec3::ZERO;
        }
        let Some(hit) = self.about.nearest(point.start, direction, f32::MAX) else { return Vec3::ZERO };
        let side = self.leaves.hit(point.start + self.from_eye, direction, &hit);
        side.map_or(Vec3::ZERO, |side| self.radiance[side as usize])
    }
}

/// For each block of 2×2 in an image, its first texel that exists, and its first that shows another surface than that one.
fn halved(points: &ShadingPoints, first: [u32; 2]) -> [ShadingPoints; 2] {
    let begin = first.map(|at| at / 2);
    let size = [0, 1].map(|axis| {
        let last = first[axis] as usize + points.size[axis].max(1) - 1;
        last / 2 - begin[axis] as usize + 1
    });
    let at = |index: usize| -> (ShadingPoint, ShadingPoint) {
        let block = [begin[0] as usize + index % size[0], begin[1] as usize + index / size[0]];
        let places = (0..4).map(|corner| [2 * block[0] + corner % 2, 2 * block[1] + corner / 2]);
        let mut inside = places.filter_map(|[x, y]| {
            let x = x.checked_sub(first[0] as usize).filter(|x| *x < points.size[0])?;
            let y = y.checked_sub(first[1] as usize).filter(|y| *y < points.size[1])?;
            Some(points.all[y * points.size[0] + x]).filter(|point| point.exists)
        });
        let one = inside.next().unwrap_or_default();
        let other = inside.find(|point| !one.agrees(point)).unwrap_or_default();
        (one, other)
    };
    let (ones, others): (Vec<ShadingPoint>, Vec<ShadingPoint>) =
        (0..size[0] * size[1]).into_par_iter().with_min_len(1024).map(at).unzip();
    [ones, others].map(|all| ShadingPoints {
        size,
        first: Some(begin),
        effort: Effort::Shared,
        numbers: Vec::new(),
        all,
        bounds: Bounds::EMPTY,
    })
}

/// Mean of what blocks around a place found on the surface of its texel, weighted by nearness; `None` if none shows it.
fn mean_around(
    place: [u32; 2],
    point: &ShadingPoint,
    layers: &[(ShadingPoints, Vec<Vec3>)],
    reach: i64,
) -> Option<Vec3> {
    // A block's middle is between its texels.
    let aside = place.map(|at| if at % 2 == 0 { -0.25 } else { 0.25 });
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for (half, found) in layers {
        let begin = half.first?;
        let [own_x, own_y] = [0, 1].map(|axis| i64::from(place[axis] / 2) - i64::from(begin[axis]));
        for y in -reach..=reach {
            for x in -reach..=reach {
                let (column, row) = (own_x + x, own_y + y);
                if column < 0 || row < 0 || column >= half.size[0] as i64 || row >= half.size[1] as i64 {
                    continue;
                }
                let index = row as usize * half.size[0] + column as usize;
                if point.agrees(&half.all[index]) {
                    let near =
                        |by: i64, aside: f32| (reach as f32 + 0.5 - (by as f32 - aside).abs()).max(0.0);
                    let weight = near(x, aside[0]) * near(y, aside[1]);
                    sum += found[index] * weight;
                    weights += weight;
                }
            }
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of texels 10 m before an eye, of which rows with `odd` face up and the rest face the eye.
    fn rows(odd: impl Fn(usize) -> bool, size: usize) -> ShadingPoints {
        let point = |index: usize| {
            let side = if odd(index / size) { Vec3::Y } else { Vec3::Z };
            let place = Vec3::new((index % size) as f32, -((index / size) as f32), 0.0) * 0.01;
            let position = place - Vec3::Z * 10.0;
            ShadingPoint {
                exists: true,
                position,
                normal: side,
                side,
                start: position,
                is_lifted: false,
                across: 0.0,
            }
        };
        ShadingPoints {
            size: [size; 2],
            first: Some([0, 0]),
            effort: Effort::Shared,
            numbers: Vec::new(),
            all: (0..size * size).map(point).collect(),
            bounds: Bounds::EMPTY,
        }
    }

    #[test]
    fn a_ledge_of_one_row_shares_what_its_own_texels_find_wherever_it_lies() {
        for ledge in [6, 7] {
            let points = rows(|row| row == ledge, 16);
            let layers = halved(&points, [0, 0]).map(|half| {
                let found = half.all.iter().map(|point| point.side).collect();
                (half, found)
            });
            for index in 0..points.all.len() {
                let point = &points.all[index];
                let mean = mean_around(points.place(index), point, &layers, REACHES[0]);
                assert_eq!(mean.map(Vec3::normalize), Some(point.side), "ledge {ledge}, texel {index}");
            }
        }
    }

    #[test]
    fn blocks_of_one_surface_have_no_second_texel() {
        let [ones, others] = halved(&rows(|_| false, 8), [0, 0]);
        assert!(ones.all.iter().all(|point| point.exists));
        assert!(others.all.iter().all(|point| !point.exists));
    }
}
