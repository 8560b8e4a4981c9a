//! Light of emitting triangles.

use argus_scene::emitters::{Emitter, EmittersByPower};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::filter::smoothed;
use super::pattern::{Pattern, SLOTS, square_points};
use super::shading_points::{Effort, ShadingPoint, ShadingPoints};
use crate::LightSettings;
use crate::light_rays::LightRaysAbout;

/// Share of the way to an emitter that is looked at: it does not block itself.
const ALMOST: f32 = 1.0 - 1e-4;

/// The emitting triangles of a pose.
#[derive(Clone)]
pub(super) struct Emitters(EmittersByPower);

impl Emitters {
    pub(super) fn new(all: Vec<Emitter>) -> Self {
        Self(EmittersByPower::new(all))
    }

    /// Whether anything emits.
    pub(super) fn any(&self) -> bool {
        !self.0.all().is_empty()
    }

    /// Irradiance / π at each texel; `None` if nothing emits.
    pub(super) fn irradiance_over_pi(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        settings: LightSettings,
    ) -> Option<Vec<Vec3>> {
        let Self(emitters) = self;
        if emitters.all().is_empty() {
            return None;
        }
        let near = Near::new(emitters, eye);
        let rays = points.rays(settings.emitter_rays as usize);
        let alone = match points.effort {
            Effort::Whole { rays } => Some(square_points(rays)),
            Effort::Shared => None,
        };
        let pattern = Pattern::of_square(rays);
        let at = |index: usize| {
            let from = &points.all[index];
            if !from.exists {
                return Vec3::ZERO;
            }
            let slot = points.slot(index);
            let mut sum = Vec3::ZERO;
            let mut cast = |ray: usize, square: glam::Vec2| {
                // Power in as many strata as there are rays; within one, each slot has its place.
                let place = (ray as f64 + (slot as f64 + 0.5) / SLOTS as f64) / rays as f64;
                if let Some(which) = emitters.pick(place) {
                    sum += near.contribution(which, from, square, about);
                }
            };
            match &alone {
                Some(all) => all.iter().enumerate().for_each(|(ray, &square)| cast(ray, square)),
                None => pattern.of_slot(slot).enumerate().for_each(|(ray, square)| cast(ray, square)),
            }
            sum / rays as f32
        };
        let found: Vec<Vec3> = (0..points.all.len()).into_par_iter().with_min_len(256).map(at).collect();
        Some(if settings.filter { smoothed(found, points) } else { found })
    }
}

/// Emitters about an eye.
struct Near(Vec<NearEmitter>);

struct NearEmitter {
    corners: [Vec3; 3],
    /// Front normal times the area.
    area: Vec3,
    /// Radiance by π, divided by the probability of this emitter.
    radiance: Vec3,
    both_sides: bool,
}

impl Near {
    fn new(emitters: &EmittersByPower, eye: DVec3) -> Self {
        let near = |emitter: &Emitter| NearEmitter {
            corners: emitter.corners.map(|corner| (corner - eye).as_vec3()),
            area: (emitter.area_vector() * 0.5).as_vec3(),
            radiance: emitter.radiance * (std::f64::consts::FRAC_1_PI / emitters.probability(emitter)) as f32,
            both_sides: emitter.both_sides,
        };
        Self(emitters.all().iter().map(near).collect())
    }

    /// What a point of an emitter adds to irradiance / π.
    fn contribution(
        &self,
        which: usize,
        from: &ShadingPoint,
        square: glam::Vec2,
        about: &LightRaysAbout<'_>,
    ) -> Vec3 {
        let emitter = &self.0[which];
        let [a, b, c] = emitter.corners;
        let root = square.x.sqrt();
        let point = a + (b - a) * (root * (1.0 - square.y)) + (c - a) * (root * square.y);
        let to_light = point - from.start;
        let squared = to_light.length_squared();
        let cosine = from.normal.dot(to_light);
        let facing = -emitter.area.dot(to_light);
        let facing = if emitter.both_sides { facing.abs() } else { facing };
        let weight = cosine * facing / (squared * squared);
        // NaN fails.
        let arrives = cosine > 0.0 && facing > 0.0 && weight.is_finite();
        match arrives {
            true => emitter.radiance * weight * from.sees(about, to_light, ALMOST),
            false => Vec3::ZERO,
        }
    }
}
