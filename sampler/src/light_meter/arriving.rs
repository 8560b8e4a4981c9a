//! Light that arrives at visible points.

use argus_scene::Lighting;
use argus_scene::emitters::EmittersByPower;
use argus_scene::exposure::Metering;
use argus_scene::light_sampling::{cosine_direction, disc_point, r2, shadow_ray};
use argus_scene::shading::{incident, sky_ambient, sky_radiance};
use glam::{DVec2, DVec3, Vec3};

use crate::light_rays::{LightRaysAbout, RayHit};
use crate::packets::Hit;
use crate::surfaces::Surfaces;

/// A visible point of a surface. Positions are about the meter's centre.
pub(super) struct VisiblePoint {
    pub(super) position: Vec3,
    /// Unit shading normal, and unit normal of the triangle, on the visible side.
    pub(super) normal: Vec3,
    pub(super) side: Vec3,
    /// Where rays of light begin.
    pub(super) start: Vec3,
    pub(super) albedo: Vec3,
    pub(super) base: Vec3,
    pub(super) emissive: Vec3,
}

/// Directions from each visible point, and how many of them are followed to further surfaces.
const DIRECTIONS: u32 = 32;
const FOLLOWED: u32 = 4;
/// Rays from each visible point to emitters.
const EMITTER_RAYS: u32 = 8;
/// Reflections between a light and a visible point, at most.
const BOUNCES: u32 = 4;
/// Lights that are all asked at a reflection; of more, one is picked.
const MOST_LIGHTS: usize = 4;
/// Share of the way to an emitter that is looked at.
const ALMOST: f32 = 1.0 - 1e-4;

/// A lighting of a scene.
pub(super) struct Light<'a> {
    pub(super) about: LightRaysAbout<'a>,
    pub(super) surfaces: &'a Surfaces,
    pub(super) center: DVec3,
    pub(super) lighting: Lighting,
    pub(super) metering: Metering,
    pub(super) emitters: EmittersByPower,
}

/// Directions from a point, by their cosine.
pub(super) fn directions(point: &VisiblePoint, seed: u32, count: u32) -> impl Iterator<Item = Vec3> + use<> {
    let (normal, side, shift) = (point.normal.as_dvec3(), point.side, shift(seed));
    let way = move |ray: u32| cosine_direction(normal, disc_point((r2(ray) + shift).fract())).as_vec3();
    // Interpolated normals allow directions below the triangle.
    (0..count).map(way).filter(move |way| way.dot(side) > 0.0)
}

/// Two numbers in 0..1 by an index.
fn shift(seed: u32) -> DVec2 {
    r2(seed.wrapping_mul(0x9e37_79b9) >> 8)
}

impl Light<'_> {
    /// Irradiance / π at a visible point.
    pub(super) fn arriving(&self, point: &VisiblePoint, seed: u32) -> Vec3 {
        let Metering { effects, indirect } = self.metering;
        let mut sum = self.of_lights(point, shift(seed)) + self.of_emitters(point, seed, EMITTER_RAYS);
        let sky = &self.lighting.sky;
        if !effects.sky_visibility {
            sum += sky_ambient(sky, point.normal);
        }
        if !(effects.sky_visibility || indirect) {
            return sum;
        }
        let reach = sky.reach.map_or(f32::MAX, |reach| reach as f32);
        let (mut open, mut reflected) = (Vec3::ZERO, Vec3::ZERO);
        for (ray, way) in (0u32..).zip(directions(point, seed, DIRECTIONS)) {
            let hit = self.about.nearest(point.start, way, f32::MAX);
            if effects.sky_visibility && hit.is_none_or(|hit| hit.t > reach) {
                open += sky_radiance(sky, way);
            }
            let is_followed = indirect && ray % (DIRECTIONS / FOLLOWED) == 0;
            if let Some(hit) = hit.filter(|_| is_followed) {
                reflected += self.reflected(point.start, way, hit, seed ^ ray.wrapping_mul(0x85eb_ca6b));
            }
        }
        sum + open / DIRECTIONS as f32 + reflected / FOLLOWED as f32
    }

    /// Radiance that a surface reflects against a ray, emission left out.
    fn reflected(&self, start: Vec3, way: Vec3, hit: RayHit, seed: u32) -> Vec3 {
        let (mut sum, mut share) = (Vec3::ZERO, Vec3::ONE);
        let (mut from, mut way, mut hit) = (start, way, hit);
        for bounce in 1..=BOUNCES {
            let Some(point) = self.point(from, way, &hit) else { break };
            share *= point.albedo;
            if share.max_element() < 1e-3 {
                break;
            }
            let seed = seed.wrapping_add(bounce.wrapping_mul(0x9e37_79b9));
            sum += share * (self.of_some_lights(&point, seed) + self.of_emitters(&point, seed, 1));
            let Some(next) = directions(&point, seed, 1).next() else { break };
            (from, way) = (point.start, next);
            match self.about.nearest(from, way, f32::MAX) {
                Some(next) => hit = next,
                None => {
                    if self.metering.effects.sky_visibility {
                        sum += share * sky_radiance(&self.lighting.sky, way);
                    }
                    break;
                }
            }
        }
        sum
    }

    fn point(&self, from: Vec3, way: Vec3, hit: &RayHit) -> Option<VisiblePoint> {
        let position = from + way * hit.t;
        let hit = Hit {
            instance: hit.instance,
            primitive: hit.primitive,
            t: f64::from(hit.t),
            weights: hit.weights.map(f64::from),
            front: hit.front,
        };
        let point = self.surfaces.hit(&hit, way.as_dvec3())?;
        let (normal, side) = (point.normal.as_vec3(), point.side.as_vec3());
        let start = position + side * (2.0 * self.about.offset(position, from.distance(position)));
        let (albedo, base, emissive) = (point.albedo, point.base, point.emissive);
        Some(VisiblePoint { position, normal, side, start, albedo, base, emissive })
    }

    fn of_lights(&self, point: &VisiblePoint, disc: DVec2) -> Vec3 {
        (0..self.lighting.lights.len()).map(|index| self.of_light(point, index, disc)).sum()
    }

    fn of_some_lights(&self, point: &VisiblePoint, seed: u32) -> Vec3 {
        let count = self.lighting.lights.len();
        let place = shift(seed ^ 0x5bd1_e995);
        match count > MOST_LIGHTS {
            true => {
                let pick = ((place.x * count as f64) as usize).min(count - 1);
                self.of_light(point, pick, place) * count as f32
            }
            false => self.of_lights(point, place),
        }
    }

    fn of_light(&self, point: &VisiblePoint, index: usize, square: DVec2) -> Vec3 {
        let effects = self.metering.effects;
        let light = &self.lighting.lights[index];
        let position = self.center + point.position.as_dvec3();
        let (to_light, irradiance) = incident(light, position);
        let irradiance_over_pi =
            irradiance * (point.normal.dot(to_light).max(0.0) * std::f32::consts::FRAC_1_PI);
        if irradiance_over_pi == Vec3::ZERO || !effects.shadows {
            return irradiance_over_pi;
        }
        let disc = if effects.soft_shadows { disc_point(square) } else { DVec2::ZERO };
        let ray = shadow_ray(light, self.center + point.start.as_dvec3(), disc);
        match self.sees(point, ray.direction.as_vec3(), ray.most as f32) {
            true => irradiance_over_pi,
            false => Vec3::ZERO,
        }
    }

    /// Light of some points on emitters, chosen by power.
    fn of_emitters(&self, point: &VisiblePoint, seed: u32, rays: u32) -> Vec3 {
        let shift = shift(seed ^ 0x2545_f491);
        let mut sum = Vec3::ZERO;
        for ray in 0..rays {
            let place = (f64::from(ray) + shift.x) / f64::from(rays);
            let Some(index) = self.emitters.pick(place) else { return Vec3::ZERO };
            let emitter = &self.emitters.all()[index];
            let square = (r2(ray + 1) + shift).fract();
            let at = (emitter.point(square.x, square.y) - self.center).as_vec3();
            let to_light = at - point.start;
            let facing = -emitter.area_vector().as_vec3().dot(to_light) * 0.5;
            let facing = if emitter.both_sides { facing.abs() } else { facing };
            let squared = to_light.length_squared();
            let weight = point.normal.dot(to_light) * facing / (squared * squared);
            let weight = weight / self.emitters.probability(emitter) as f32;
            if weight > 0.0 && weight.is_finite() && self.sees(point, to_light, ALMOST) {
                sum += emitter.radiance * (weight * std::f32::consts::FRAC_1_PI);
            }
        }
        sum / rays as f32
    }

    fn sees(&self, point: &VisiblePoint, way: Vec3, most: f32) -> bool {
        way.dot(point.side) > 0.0 && !self.about.is_blocked(point.start, way, most)
    }
}
