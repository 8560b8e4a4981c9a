//! Shares of lights that texels see.

use std::time::Instant;

use argus_scene::light::SEPARATE_LIGHTS;
use argus_scene::light_sampling::shadow_ray;
use argus_scene::shading::incident;
use argus_scene::{Bounds, Light, Lighting, Stage};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::pattern::{SLOTS, disc_points};
use super::shading_points::{Effort, ShadingPoint, ShadingPoints};
use crate::light_rays::LightRaysAbout;
use crate::timing;

/// Points of a light that a texel in a penumbra looks at; each texel of a square of 4×4 looks at another one first.
const POINTS: usize = 16;

/// Whether a light may reach any of the texels: it ends at its range and at its cone.
pub(super) fn reaches(light: &Light, points: &ShadingPoints, eye: DVec3) -> bool {
    let Bounds { min, max } = points.bounds;
    light.reaches(&Bounds { min: min + eye, max: max + eye })
}

/// Irradiance / π of a light at each texel, as if nothing blocked it.
pub(super) fn incident_at(light: &Light, points: &ShadingPoints, eye: DVec3) -> Vec<Vec3> {
    let at = |point: &ShadingPoint| {
        if !point.exists {
            return Vec3::ZERO;
        }
        let (to_light, irradiance) = incident(light, eye + point.position.as_dvec3());
        irradiance * (point.normal.dot(to_light).max(0.0) * std::f32::consts::FRAC_1_PI)
    };
    points.all.par_iter().with_min_len(1024).map(at).collect()
}

/// Rays from texels to one light.
pub(super) struct ShadowRays<'a> {
    pub(super) light: &'a Light,
    pub(super) points: &'a ShadingPoints,
    /// Irradiance of each texel if nothing blocks the light.
    pub(super) lit: &'a [Vec3],
    pub(super) about: &'a LightRaysAbout<'a>,
    pub(super) eye: DVec3,
}

impl ShadowRays<'_> {
    /// The share of the light that each texel sees; 0 where its light does not arrive. Adds the stage `trace shadows`, and
    /// for soft shadows `trace penumbras`.
    ///
    /// For a soft shadow each texel first looks at one point of the light. Where neighbours on the same surface do not agree
    /// there is a penumbra, or the edge of a shadow: there each texel looks at all of [`POINTS`] points.
    pub(super) fn seen_shares(&self, soft: bool, stages: &mut Vec<Stage>) -> Vec<f32> {
        let Self { light, points, lit, .. } = *self;
        let is_soft = soft && light.is_extended();
        let begin = Instant::now();
        let discs: Vec<DVec2> = disc_points(POINTS).iter().map(|point| point.as_dvec2()).collect();
        let of_all = |point: &ShadingPoint| {
            discs.iter().map(|&disc| self.sees(point, disc)).sum::<f32>() / POINTS as f32
        };
        let first = |index: usize| {
            let point = &points.all[index];
            if lit[index] == Vec3::ZERO {
                return 0.0;
            }
            if is_soft && points.effort != Effort::Shared {
                return of_all(point);
            }
            let disc = if is_soft { discs[points.slot(index) * POINTS / SLOTS] } else { DVec2::ZERO };
            self.sees(point, disc)
        };
        let count = points.all.len();
        let first: Vec<f32> = (0..count).into_par_iter().with_min_len(256).map(first).collect();
        timing::add_since(stages, "trace shadows", begin);
        if !is_soft || points.first.is_none() {
            return first;
        }
        let begin = Instant::now();
        let share = |index: usize| match lit[index] != Vec3::ZERO && is_mixed(points, lit, &first, index) {
            true => of_all(&points.all[index]),
            false => first[index],
        };
        let shares = (0..count).into_par_iter().with_min_len(256).map(share).collect();
        timing::add_since(stages, "trace penumbras", begin);
        shares
    }

    /// The share of a point of the light's disc that a texel sees.
    fn sees(&self, point: &ShadingPoint, disc: DVec2) -> f32 {
        let ray = shadow_ray(self.light, self.eye + point.start.as_dvec3(), disc);
        point.sees(self.about, ray.direction.as_vec3(), ray.most as f32)
    }
}

/// Whether lit texels around one on the same surface see different things.
fn is_mixed(points: &ShadingPoints, lit: &[Vec3], first: &[f32], index: usize) -> bool {
    const REACH: usize = 2;
    let [width, height] = points.size;
    let (x, y) = (index % width, index / width);
    let point = &points.all[index];
    for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
        for column in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
            let other = row * width + column;
            if first[other] != first[index] && lit[other] != Vec3::ZERO && point.agrees(&points.all[other]) {
                return true;
            }
        }
    }
    false
}

/// The bytes of a LightVisibility plane, gathered light by light: [`Lighting::visibility_bytes`].
pub(super) struct VisibilityWords {
    byte_of: Vec<u32>,
    /// Of each texel: the separate lights' shares, and the rest's seen and whole brightness.
    sums: Vec<[f32; SEPARATE_LIGHTS + 2]>,
}

impl VisibilityWords {
    pub(super) fn new(lighting: &Lighting, points: usize) -> Self {
        Self { byte_of: lighting.visibility_bytes(), sums: vec![[0.0; SEPARATE_LIGHTS + 2]; points] }
    }

    /// Takes the shares of one light over. `lit` is its irradiance.
    pub(super) fn add(&mut self, light: usize, lit: &[Vec3], shares: &[f32]) {
        let byte = self.byte_of[light] as usize;
        for ((sums, lit), share) in self.sums.iter_mut().zip(lit).zip(shares) {
            if byte < SEPARATE_LIGHTS {
                sums[byte] = *share;
            } else {
                let brightness = lit.element_sum();
                sums[SEPARATE_LIGHTS] += brightness * share;
                sums[SEPARATE_LIGHTS + 1] += brightness;
            }
        }
    }

    /// The word of a texel; `sky` is the share of the sky that it sees.
    pub(super) fn word(&self, point: usize, sky: f32) -> u32 {
        let [first, second, seen, whole] = self.sums[point];
        let rest = if whole > 0.0 { seen / whole } else { 1.0 };
        let bytes = [first, second, rest, sky].map(|share| (share.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        u32::from_le_bytes(bytes)
    }
}
