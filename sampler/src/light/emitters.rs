//! Light of emitting triangles.

use argus_scene::emitters::{Emitter, EmittersByPower};
use argus_shaders::layout::surface_light::EmitterPoint;
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

    /// The points that texels of an image look at about an eye: those of each slot for the first ray, then for the second, and so on.
    pub(super) fn points(&self, eye: DVec3, settings: LightSettings) -> Vec<EmitterPoint> {
        let (Self(emitters), rays) = (self, settings.emitter_rays as usize);
        let squares = square_points(SLOTS * rays);
        let point = |(number, square): (usize, &glam::Vec2)| {
            let (ray, slot) = (number / SLOTS, number % SLOTS);
            let which = emitters.pick(place_of(ray, slot, rays)).unwrap_or(0);
            let emitter = NearEmitter::new(&emitters.all()[which], emitters, eye);
            EmitterPoint {
                position: emitter.point(*square).to_array(),
                both_sides: u32::from(emitter.both_sides),
                area: emitter.area.to_array(),
                _pad: 0.0,
                radiance: (emitter.radiance / rays as f32).to_array(),
                _rest: 0.0,
            }
        };
        squares.iter().enumerate().map(point).collect()
    }

    /// Irradiance / π at each texel, where a ray stands for as much of an emitter; `None` if nothing emits.
    pub(super) fn irradiance_over_pi(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        settings: LightSettings,
        part: EmitterPart,
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
                if let Some(which) = emitters.pick(place_of(ray, slot, rays)) {
                    sum += near.contribution(which, from, square, about, part);
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

/// What a ray to an emitter stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum EmitterPart {
    /// The point at which it looks. Right on average, and far too much for a few points close to an emitter.
    Point,
    /// The whole triangle, which is as visible as that point: never more than the emitter's radiance over its probability. Nothing,
    /// if the triangle's plane is closer than so many metres.
    Triangle {
        /// Metres.
        beyond: f32,
    },
}

/// The place of a ray in 0..1 of all power: in as many strata as there are rays; within one, each slot has its place.
fn place_of(ray: usize, slot: usize, rays: usize) -> f64 {
    (ray as f64 + (slot as f64 + 0.5) / SLOTS as f64) / rays as f64
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

impl NearEmitter {
    fn new(emitter: &Emitter, among: &EmittersByPower, eye: DVec3) -> Self {
        Self {
            corners: emitter.corners.map(|corner| (corner - eye).as_vec3()),
            area: (emitter.area_vector() * 0.5).as_vec3(),
            radiance: emitter.radiance * (std::f64::consts::FRAC_1_PI / among.probability(emitter)) as f32,
            both_sides: emitter.both_sides,
        }
    }

    /// The point that a point of the unit square stands for, uniform by area.
    fn point(&self, square: glam::Vec2) -> Vec3 {
        let [a, b, c] = self.corners;
        let root = square.x.sqrt();
        a + (b - a) * (root * (1.0 - square.y)) + (c - a) * (root * square.y)
    }
}

impl Near {
    fn new(emitters: &EmittersByPower, eye: DVec3) -> Self {
        Self(emitters.all().iter().map(|emitter| NearEmitter::new(emitter, emitters, eye)).collect())
    }

    /// What a ray to a point of an emitter adds to irradiance / π.
    fn contribution(
        &self,
        which: usize,
        from: &ShadingPoint,
        square: glam::Vec2,
        about: &LightRaysAbout<'_>,
        part: EmitterPart,
    ) -> Vec3 {
        let emitter = &self.0[which];
        let mut to_light = emitter.point(square) - from.start;
        let facing = -emitter.area.dot(to_light);
        let facing = if emitter.both_sides { facing.abs() } else { facing };
        if !(facing > 0.0) {
            return Vec3::ZERO;
        }
        let mut cosine = from.normal.dot(to_light);
        let weight = match part {
            EmitterPart::Point => {
                let squared = to_light.length_squared();
                cosine * facing / (squared * squared)
            }
            EmitterPart::Triangle { beyond } if facing < beyond * emitter.area.length() => return Vec3::ZERO,
            EmitterPart::Triangle { .. } => {
                let corners = emitter.corners.map(|corner| corner - from.start);
                let (weight, middle) = lambert(corners, from.normal);
                if cosine <= 0.0 {
                    // The point is below the horizon, and a part of the triangle may be above.
                    (to_light, cosine) = (middle, from.normal.dot(middle));
                }
                weight
            }
        };
        // NaN fails.
        match cosine > 0.0 && weight.is_finite() {
            true => emitter.radiance * weight * from.sees(about, to_light, ALMOST),
            false => Vec3::ZERO,
        }
    }
}

/// The integral of both cosines over squared distance for a triangle, seen from a point at the origin with that normal: irradiance
/// for a radiance of one (Lambert's formula for polygons; Baum, Rushmeier and Winget, "Improving Radiosity Solutions Through the
/// Use of Analytically Determined Form-Factors", 1989). What lies below the point's horizon does not count; also returns a point of
/// the rest.
fn lambert(corners: [Vec3; 3], normal: Vec3) -> (f32, Vec3) {
    // The triangle above the horizon has four corners at most.
    let (mut above, mut count) = ([Vec3::ZERO; 4], 0);
    for (at, &here) in corners.iter().enumerate() {
        let next = corners[(at + 1) % 3];
        let [height, next_height] = [here, next].map(|corner| corner.dot(normal));
        let crossing = here + (next - here) * (height / (height - next_height));
        let crosses = (height > 0.0) != (next_height > 0.0);
        for (corner, counts) in [(here, height > 0.0), (crossing, crosses)] {
            if counts && count < above.len() {
                above[count] = corner;
                count += 1;
            }
        }
    }
    let above = &above[..count];
    let edge = |(at, here): (usize, &Vec3)| {
        let next = above[(at + 1) % count];
        let across = here.cross(next);
        let length = across.length();
        // The angle of the edge, about the axis across it. An edge through the point has none.
        if length > 0.0 { length.atan2(here.dot(next)) * across.dot(normal) / length } else { 0.0 }
    };
    let integral = 0.5 * above.iter().enumerate().map(edge).sum::<f32>().abs();
    (integral, above.iter().sum::<Vec3>() / count.max(1) as f32)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    #[test]
    fn a_triangle_lights_as_the_sum_of_its_points() {
        let corners = [Vec3::new(-0.4, 0.7, 0.2), Vec3::new(0.9, 0.5, 0.1), Vec3::new(0.1, 1.1, 0.8)];
        for normal in [Vec3::Y, Vec3::X, Vec3::new(-0.6, 0.0, 0.8), Vec3::NEG_Y] {
            let [a, b, c] = corners;
            let area = (b - a).cross(c - a) * 0.5;
            const SIDE: usize = 400;
            let mut sum = 0.0;
            for i in 0..SIDE * SIDE {
                let (u, v) =
                    (((i % SIDE) as f32 + 0.5) / SIDE as f32, ((i / SIDE) as f32 + 0.5) / SIDE as f32);
                let at = a + (b - a) * (u.sqrt() * (1.0 - v)) + (c - a) * (u.sqrt() * v);
                let squared = at.length_squared();
                sum += normal.dot(at).max(0.0) * area.dot(at).abs() / (squared * squared);
            }
            let sum = sum / (SIDE * SIDE) as f32;
            let (found, middle) = lambert(corners, normal);
            assert!(found == 0.0 || normal.dot(middle) > 0.0, "{normal}: {middle}");
            assert!((found - sum).abs() <= 2e-3 * sum.max(0.01), "{normal}: {found}, not {sum}");
        }
    }

    #[test]
    fn no_triangle_lights_more_than_a_whole_sky_of_its_radiance() {
        let large = [Vec3::new(-1e4, 1e-3, -1e4), Vec3::new(1e4, 1e-3, -1e4), Vec3::new(0.0, 1e-3, 2e4)];
        assert!((lambert(large, Vec3::Y).0 - PI).abs() < 1e-3);
        // Through the point, without an area, and at a single place.
        let through = [Vec3::ZERO, Vec3::X, Vec3::Z];
        for corners in [through, [Vec3::Y; 3], [Vec3::Y, Vec3::Y * 2.0, Vec3::Y * 3.0], [Vec3::ZERO; 3]] {
            let (found, _) = lambert(corners, Vec3::Y);
            assert!((0.0..=PI).contains(&found), "{corners:?}: {found}");
        }
    }
}
