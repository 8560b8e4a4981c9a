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

/// How far an emitter that covers a point is looked for, as a share of the way to its plane.
const PAST: f32 = 1.0 + 1e-3;
/// Least cosine between a point's normal and the way to the plane of an emitter that covers it.
const COVERS: f32 = 0.5;
/// A ray stands for the whole triangle within so many of its longest edges from its middle, squared.
const NEAR: f32 = 16.0;

/// The emitting triangles of a pose.
#[derive(Clone)]
pub(super) struct Emitters(EmittersByPower);

impl Emitters {
    pub(super) fn new(all: Vec<Emitter>) -> Self {
        Self(EmittersByPower::new(all))
    }

    /// All emitting triangles.
    pub(super) fn all(&self) -> &[Emitter] {
        self.0.all()
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
            let [first, second, third] = emitter.corners.map(|corner| corner.to_array());
            EmitterPoint {
                position: emitter.point(*square).to_array(),
                both_sides: u32::from(emitter.both_sides),
                area: emitter.area.to_array(),
                near: emitter.near,
                radiance: (emitter.radiance / rays as f32).to_array(),
                _pad: 0.0,
                first,
                _pad_first: 0.0,
                second,
                _pad_second: 0.0,
                third,
                _rest: 0.0,
            }
        };
        squares.iter().enumerate().map(point).collect()
    }

    /// Irradiance / π at each texel; `None` if nothing emits.
    pub(super) fn irradiance_over_pi(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        settings: LightSettings,
    ) -> Option<Vec<Vec3>> {
        let found = self.at_points(points, about, eye, settings, 0.0)?;
        let found = found.into_iter().map(Option::unwrap_or_default).collect();
        Some(if settings.filter { smoothed(found, points) } else { found })
    }

    /// Irradiance / π at each point; `None` if nothing emits, and for points that an emitter covers from less than `beyond` metres.
    pub(super) fn at_points(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        settings: LightSettings,
        beyond: f32,
    ) -> Option<Vec<Option<Vec3>>> {
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
                return Some(Vec3::ZERO);
            }
            let slot = points.slot(index);
            let cast = |(ray, square): (usize, glam::Vec2)| match emitters.pick(place_of(ray, slot, rays)) {
                Some(which) => near.contribution(which, from, square, about, beyond),
                None => Some(Vec3::ZERO),
            };
            let sum: Option<Vec3> = match &alone {
                Some(all) => all.iter().copied().enumerate().map(cast).sum(),
                None => pattern.of_slot(slot).enumerate().map(cast).sum(),
            };
            sum.map(|sum| sum / rays as f32)
        };
        Some((0..points.all.len()).into_par_iter().with_min_len(256).map(at).collect())
    }
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
    /// Square of the distance from its middle, metres, below which a ray stands for the whole triangle.
    near: f32,
}

impl NearEmitter {
    fn new(emitter: &Emitter, among: &EmittersByPower, eye: DVec3) -> Self {
        let corners = emitter.corners.map(|corner| (corner - eye).as_vec3());
        let edge = |at: usize| corners[at].distance_squared(corners[(at + 1) % 3]);
        Self {
            corners,
            near: NEAR * edge(0).max(edge(1)).max(edge(2)),
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

    /// Whether the emitter covers a point, closer than `beyond` metres. One that only stands beside it does not.
    fn covers(&self, from: &ShadingPoint, to_point: Vec3, about: &LightRaysAbout<'_>, beyond: f32) -> bool {
        let across = self.area.normalize_or_zero();
        let to_plane = across * across.dot(to_point);
        let distance = to_plane.length();
        distance < beyond
            && from.normal.dot(to_plane) > COVERS * distance
            && from.sees(about, to_plane, PAST) < 1.0
    }

    /// How much of its radiance arrives by a ray towards it, if nothing blocks that; and where the ray goes, which is elsewhere if the
    /// point that it is for lies below the horizon. From afar a ray stands for its point. From close by points differ too much, and it
    /// stands for the whole triangle, which is then as visible as the point.
    fn weight(&self, from: &ShadingPoint, to_point: Vec3, facing: f32) -> (f32, Vec3) {
        let cosine = from.normal.dot(to_point);
        let corners = self.corners.map(|corner| corner - from.start);
        let middle = corners.iter().sum::<Vec3>() / 3.0;
        if middle.length_squared() >= self.near {
            let squared = to_point.length_squared();
            return (cosine * facing / (squared * squared), to_point);
        }
        let (weight, above) = lambert(corners, from.normal);
        (weight, if cosine > 0.0 { to_point } else { above })
    }
}

impl Near {
    fn new(emitters: &EmittersByPower, eye: DVec3) -> Self {
        Self(emitters.all().iter().map(|emitter| NearEmitter::new(emitter, emitters, eye)).collect())
    }

    /// What a ray to a point of an emitter adds to irradiance / π; `None` if the emitter covers the point from less than
    /// `beyond` metres.
    fn contribution(
        &self,
        which: usize,
        from: &ShadingPoint,
        square: glam::Vec2,
        about: &LightRaysAbout<'_>,
        beyond: f32,
    ) -> Option<Vec3> {
        let emitter = &self.0[which];
        let to_point = emitter.point(square) - from.start;
        let facing = -emitter.area.dot(to_point);
        let facing = if emitter.both_sides { facing.abs() } else { facing };
        // NaN fails.
        if !(facing > 0.0) {
            return Some(Vec3::ZERO);
        }
        if beyond > 0.0 && emitter.covers(from, to_point, about, beyond) {
            return None;
        }
        let (weight, to_light) = emitter.weight(from, to_point, facing);
        Some(match weight > 0.0 && weight.is_finite() {
            true => emitter.radiance * weight * from.sees(about, to_light, ALMOST),
            false => Vec3::ZERO,
        })
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

    /// The weights of rays to many points of a lamp of a metre, from a point so far below its middle: least, mean and greatest, and the
    /// exact sum over the lamp.
    fn weights_below(distance: f32) -> ([f32; 3], f32) {
        let corners = [DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 0.0, -0.5), DVec3::new(0.0, 0.0, 0.5)];
        let emitter = Emitter { corners, radiance: Vec3::ONE, both_sides: false, instance: 0, primitive: 0 };
        let lamp = NearEmitter::new(&emitter, &EmittersByPower::new(vec![emitter]), DVec3::ZERO);
        let start = Vec3::NEG_Y * distance;
        let from = ShadingPoint {
            exists: true,
            position: start,
            normal: Vec3::Y,
            side: Vec3::Y,
            start,
            is_lifted: false,
            across: 0.0,
        };
        let weights = square_points(SLOTS * 4).into_iter().map(|square| {
            let to_point = lamp.point(square) - start;
            lamp.weight(&from, to_point, -lamp.area.dot(to_point)).0
        });
        let weights: Vec<f32> = weights.collect();
        let mean = weights.iter().sum::<f32>() / weights.len() as f32;
        let [least, most] = [f32::min, f32::max].map(|of| weights.iter().copied().reduce(of).unwrap());
        ([least, mean, most], lambert(lamp.corners.map(|corner| corner - start), Vec3::Y).0)
    }

    #[test]
    fn every_ray_to_an_emitter_stands_for_about_as_much_from_close_by_and_from_afar() {
        for distance in [1e-3, 0.01, 0.3, 1.0, 4.0, 5.0, 30.0] {
            let ([least, mean, most], exact) = weights_below(distance);
            assert!((mean / exact - 1.0).abs() < 0.02, "{distance} m: {mean}, not {exact}");
            assert!(most < 1.1 * least, "{distance} m: {least} to {most}");
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
