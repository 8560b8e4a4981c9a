//! Pixels that cells do not describe, such as leaves and what is beside a wall: each casts rays of its own.

use std::ops::{AddAssign, Mul};

use argus_scene::Sky;
use argus_scene::shading::sky_radiance;
use glam::Vec3;
use rayon::prelude::*;

use super::super::filter::{Listed, smoothed_among};
use super::super::paths::Leaves;
use super::super::pattern::{Pattern, SLOTS, above};
use super::super::shading_points::{ShadingPoint, ShadingPoints};
use super::lookup::CellLight;
use super::trail::Trail;
use crate::light_rays::{LightRaysAbout, RayHit};

/// Rays of a pixel in an image, whose neighbours share what they find; and slots of them for a pixel without neighbours.
pub(in crate::light) const RAYS: usize = 2;
const SLOTS_IN_LIST: usize = 24;

/// What rays of single pixels meet. Positions are metres about the eye.
pub(super) struct Surroundings<'a> {
    pub(super) about: &'a LightRaysAbout<'a>,
    pub(super) leaves: &'a Leaves,
    /// Radiance that leaf sides reflect; empty if they light nothing.
    pub(super) radiance: &'a [Vec3],
    pub(super) sky: &'a Sky,
    /// The eye about the centre of the leaves.
    pub(super) from_eye: Vec3,
    /// Where it is written down what is read of the leaves.
    pub(super) trail: Option<&'a Trail>,
}

/// Sums over rays.
#[derive(Clone, Copy, Default)]
struct Sums {
    seen: Vec3,
    whole: Vec3,
    reflected: Vec3,
    rays: f32,
}

impl AddAssign for Sums {
    fn add_assign(&mut self, other: Self) {
        self.seen += other.seen;
        self.whole += other.whole;
        self.reflected += other.reflected;
        self.rays += other.rays;
    }
}

impl Mul<f32> for Sums {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            seen: self.seen * factor,
            whole: self.whole * factor,
            reflected: self.reflected * factor,
            rays: self.rays * factor,
        }
    }
}

impl Surroundings<'_> {
    /// The light of some texels.
    pub(super) fn light(&self, points: &ShadingPoints, listed: &Listed) -> Vec<CellLight> {
        let pattern = Pattern::of_disc(RAYS);
        let slots = if points.first.is_some() { 1 } else { SLOTS_IN_LIST };
        let cast = |index: usize| {
            let (point, mut sums) = (&points.all[index], Sums::default());
            for slot in 0..slots {
                let discs = pattern.of_slot((points.slot(index) + slot) % SLOTS);
                discs.for_each(|disc| self.add(point, above(point.normal, disc), &mut sums));
            }
            sums
        };
        let sums: Vec<Sums> = listed.par_texels().with_min_len(256).map(cast).collect();
        let ratio = |seen: f32, whole: f32| if whole > 0.0 { seen / whole } else { 0.0 };
        let light = |Sums { seen, whole, reflected, rays }: Sums| CellLight {
            sky: Vec3::new(ratio(seen.x, whole.x), ratio(seen.y, whole.y), ratio(seen.z, whole.z)),
            indirect: if rays > 0.0 { reflected / rays } else { Vec3::ZERO },
        };
        smoothed_among(sums, listed, points).into_par_iter().map(light).collect()
    }

    fn add(&self, point: &ShadingPoint, direction: Vec3, sums: &mut Sums) {
        let radiance = sky_radiance(self.sky, direction);
        sums.rays += 1.0;
        sums.whole += radiance;
        if !(point.is_lifted || direction.dot(point.side) > 0.0) {
            return;
        }
        let reach = self.sky.reach.map_or(f32::MAX, |reach| reach as f32);
        if self.radiance.is_empty() {
            sums.seen += radiance * self.about.passed(point.start, direction, reach);
            return;
        }
        let hit = self.about.nearest(point.start, direction, f32::MAX);
        if hit.is_none_or(|hit| hit.t > reach) {
            sums.seen += radiance;
        }
        let side = hit.and_then(|hit| self.side(point.start + self.from_eye, direction, &hit));
        sums.reflected += side.map_or(Vec3::ZERO, |side| self.radiance[side as usize]);
    }

    /// The leaf side that a ray hits.
    fn side(&self, start: Vec3, direction: Vec3, hit: &RayHit) -> Option<u32> {
        let Some(trail) = self.trail else { return self.leaves.hit(start, direction, hit) };
        let mut reads = Vec::new();
        let side = self.leaves.hit_reading(start, direction, hit, |read| reads.push(read));
        trail.add_reads(&reads);
        side
    }
}
