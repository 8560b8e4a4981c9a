//! Texels gather what leaf sides reflect.
//!
//! A texel of each block of 2×2 casts rays. These texels form an image of half the size, in which neighbours share what
//! they found within a surface, as for direct light. All texels then take the mean of those around them that show the same
//! surface. Where there are none they cast rays themselves.

use argus_scene::Bounds;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::super::filter::smoothed;
use super::super::pattern::{Pattern, SLOTS, above};
use super::super::texels::{Effort, Texel, Texels};
use super::leaves::Leaves;
use crate::light_rays::LightRaysAbout;

/// Slots whose rays are cast by a texel without neighbours in a list, and by one in an image.
const SLOTS_IN_LIST: usize = 8;
const SLOTS_ALONE: usize = 2;
/// Blocks on each side of a texel's own whose light it takes; and if none of them shows its surface.
const REACHES: [i64; 2] = [1, 3];

/// Casts rays from texels about an eye.
pub(super) struct Gatherer<'a> {
    pub(super) leaves: &'a Leaves,
    /// Radiance that leaf sides reflect.
    pub(super) radiance: &'a [Vec3],
    pub(super) about: &'a LightRaysAbout<'a>,
    /// The eye about the centre of the leaves.
    pub(super) from_eye: Vec3,
}

impl Gatherer<'_> {
    /// Irradiance / π at each texel; `rays` is the number of rays of one that shares.
    pub(super) fn by_pi(&self, texels: &Texels, rays: usize) -> Vec<Vec3> {
        let pattern = Pattern::of_disc(rays);
        let count = texels.all.len();
        let Some(first) = texels.first else {
            let alone = |index: usize| self.of_slots(&texels.all[index], &pattern, 0, SLOTS_IN_LIST);
            return (0..count).into_par_iter().with_min_len(64).map(alone).collect();
        };
        let half = halved(texels, first);
        let one = |index: usize| self.of_slots(&half.all[index], &pattern, half.slot(index), 1);
        let found: Vec<Vec3> = (0..half.all.len()).into_par_iter().with_min_len(64).map(one).collect();
        let found = smoothed(found, &half);
        let spread = |index: usize| {
            let texel = &texels.all[index];
            if !texel.exists {
                return Vec3::ZERO;
            }
            REACHES
                .into_iter()
                .find_map(|reach| mean_around(texels.place(index), texel, &half, &found, reach))
                .unwrap_or_else(|| self.of_slots(texel, &pattern, texels.slot(index), SLOTS_ALONE))
        };
        (0..count).into_par_iter().with_min_len(256).map(spread).collect()
    }

    /// Mean of what the rays of some slots bring, which begin with `first`.
    fn of_slots(&self, texel: &Texel, pattern: &Pattern, first: usize, slots: usize) -> Vec3 {
        if !texel.exists {
            return Vec3::ZERO;
        }
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for slot in 0..slots {
            // The points of consecutive slots are far from one another.
            for disc in pattern.of_slot((first + slot) % SLOTS) {
                sum += self.along(texel, disc);
                count += 1.0;
            }
        }
        sum / count
    }

    /// Radiance along the ray above a point of the unit disc.
    fn along(&self, texel: &Texel, disc: Vec2) -> Vec3 {
        let direction = above(texel.normal, disc);
        if !(texel.is_lifted || direction.dot(texel.side) > 0.0) {
            return Vec3::ZERO;
        }
        let Some(hit) = self.about.nearest(texel.start, direction, f32::MAX) else { return Vec3::ZERO };
        let side = self.leaves.hit(texel.start + self.from_eye, direction, &hit);
        side.map_or(Vec3::ZERO, |side| self.radiance[side as usize])
    }
}

/// For each block of 2×2 in an image, its first texel that exists.
fn halved(texels: &Texels, first: [u32; 2]) -> Texels {
    let begin = first.map(|at| at / 2);
    let size = [0, 1].map(|axis| {
        let last = first[axis] as usize + texels.size[axis].max(1) - 1;
        last / 2 - begin[axis] as usize + 1
    });
    let at = |index: usize| {
        let block = [begin[0] as usize + index % size[0], begin[1] as usize + index / size[0]];
        let places = (0..4).map(|corner| [2 * block[0] + corner % 2, 2 * block[1] + corner / 2]);
        let inside = places.filter_map(|[x, y]| {
            let x = x.checked_sub(first[0] as usize).filter(|x| *x < texels.size[0])?;
            let y = y.checked_sub(first[1] as usize).filter(|y| *y < texels.size[1])?;
            Some(texels.all[y * texels.size[0] + x])
        });
        inside.into_iter().find(|texel| texel.exists).unwrap_or_default()
    };
    let all = (0..size[0] * size[1]).into_par_iter().with_min_len(1024).map(at).collect();
    Texels { size, first: Some(begin), effort: Effort::Shared, all, bounds: Bounds::EMPTY }
}

/// Mean of what blocks around a place found on the surface of its texel, weighted by nearness; `None` if none shows it.
fn mean_around(place: [u32; 2], texel: &Texel, half: &Texels, found: &[Vec3], reach: i64) -> Option<Vec3> {
    let begin = half.first?;
    let [own_x, own_y] = [0, 1].map(|axis| i64::from(place[axis] / 2) - i64::from(begin[axis]));
    // A block's middle is between its texels.
    let aside = place.map(|at| if at % 2 == 0 { -0.25 } else { 0.25 });
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for y in -reach..=reach {
        for x in -reach..=reach {
            let (column, row) = (own_x + x, own_y + y);
            if column < 0 || row < 0 || column >= half.size[0] as i64 || row >= half.size[1] as i64 {
                continue;
            }
            let index = row as usize * half.size[0] + column as usize;
            if texel.agrees(&half.all[index]) {
                let near = |by: i64, aside: f32| (reach as f32 + 0.5 - (by as f32 - aside).abs()).max(0.0);
                let weight = near(x, aside[0]) * near(y, aside[1]);
                sum += found[index] * weight;
                weights += weight;
            }
        }
    }
    (weights > 0.0).then(|| sum / weights)
}
