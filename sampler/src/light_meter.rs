//! Meters the light of a scene for its exposure.
//!
//! Rays from the scene's viewpoints find visible points. At each, irradiance is estimated with a few rays, and light from
//! other surfaces by short paths: a noisy value each, of which only the mean is used. Cut-outs are left out, as they are
//! from [`PacketSight`], whose triangles these are.

use argus_scene::emitters::{EmittersByPower, emitters};
use argus_scene::exposure::{Metering, metered};
use argus_scene::light_sampling::{cosine_direction, disc_point, r2, shadow_ray};
use argus_scene::shading::{incident, sky_ambient, sky_radiance};
use argus_scene::{Camera, Lighting, Material, Scene};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::PacketSight;
use crate::packets::{Hit, PacketTracer};
use crate::radiosity::surfaces::Surfaces;
use crate::resident::placed;

/// Viewpoints that are metered, at most.
const VIEWPOINTS: usize = 8;
/// Columns and rows of the rays of all viewpoints together.
const COLUMNS: u32 = 24;
const ROWS: u32 = 16;
/// Directions from each visible point.
const DIRECTIONS: u32 = 12;
/// Reflections between a light and a visible point, at most.
const BOUNCES: u32 = 4;
/// Distance off a surface, as a share of coordinates and distance.
const OFF_SURFACE: f64 = 1e-9;
/// Panes of glass that a ray passes, at most.
const MOST_PANES: u32 = 16;
/// Share of the way to an emitter that is looked at.
const ALMOST: f64 = 1.0 - 1e-6;

impl PacketSight {
    /// Mean light at the surfaces that the scene's viewpoints show, at time zero, for [`argus_scene::Exposure::factor`].
    /// `None` if no light arrives.
    pub fn metered(&self, metering: Metering) -> Option<f64> {
        let scene = self.scene();
        let lighting = scene.at(0.0).lighting;
        self.at(0.0, |tracer| {
            let surfaces = Surfaces::new(scene, &placed(scene, &scene.at(0.0).instances));
            let lit = match metering.effects.emitters {
                true => emitters(scene, &scene.at(0.0).instances, surfaces.textures()),
                false => Vec::new(),
            };
            let emitters = EmittersByPower::new(lit);
            let meter = Meter { tracer, surfaces, lighting, metering, emitters };
            let rays: Vec<(DVec3, DVec3)> = rays(scene);
            let light = (0u32..).zip(&rays).collect::<Vec<_>>().into_par_iter();
            let light: Vec<f64> = light.filter_map(|(seed, &(eye, way))| meter.at(seed, eye, way)).collect();
            metered(&light)
        })
    }
}

/// Rays of sight: eyes and directions, evenly over the images of the viewpoints.
fn rays(scene: &Scene) -> Vec<(DVec3, DVec3)> {
    let named = scene.cameras.iter().map(|named| named.camera).take(VIEWPOINTS);
    let mut cameras: Vec<Camera> = named.collect();
    if cameras.is_empty() {
        cameras.push(scene.default_camera());
    }
    let rows = (ROWS / cameras.len() as u32).max(4);
    let pixels = |camera: Camera| {
        let all =
            (0..rows * COLUMNS).map(move |i| DVec2::new(f64::from(i % COLUMNS), f64::from(i / COLUMNS)));
        all.map(move |pixel| (camera.eye, camera.direction(pixel + 0.5, COLUMNS, rows)))
    };
    cameras.into_iter().flat_map(pixels).collect()
}

struct Meter<'a> {
    tracer: &'a PacketTracer,
    surfaces: Surfaces,
    lighting: Lighting,
    metering: Metering,
    emitters: EmittersByPower,
}

/// A surface point that light arrives at.
struct Lit {
    /// Above the surface.
    position: DVec3,
    /// Unit normal.
    normal: DVec3,
    albedo: Vec3,
}

impl Meter<'_> {
    /// Luminance of irradiance / π where a ray of sight ends; `None` where there is no surface.
    fn at(&self, seed: u32, eye: DVec3, way: DVec3) -> Option<f64> {
        let point = self.hit(eye, way)?;
        let arriving =
            |ray: u32| self.arriving(&point, seed.wrapping_mul(DIRECTIONS).wrapping_add(ray), BOUNCES);
        let sum: Vec3 = (0..DIRECTIONS).map(arriving).sum();
        Some(f64::from((sum / DIRECTIONS as f32).dot(Vec3::new(0.2126, 0.7152, 0.0722))))
    }

    fn hit(&self, from: DVec3, way: DVec3) -> Option<Lit> {
        let (hit, position) = self.nearest(from, way, f64::INFINITY)?;
        let point = self.surfaces.hit(&hit, way)?;
        let off = OFF_SURFACE * (position.abs().max_element() + from.distance(position));
        Some(Lit { position: position + point.side * off, normal: point.normal, albedo: point.albedo })
    }

    /// The nearest hit behind glass, up to `most` times the direction, and its position.
    fn nearest(&self, from: DVec3, way: DVec3, most: f64) -> Option<(Hit, DVec3)> {
        let mut passed = 0.0;
        for _ in 0..MOST_PANES {
            let hit = self.tracer.nearest(from + way * passed, way, most - passed)?;
            let t = passed + hit.t;
            if !self.surfaces.material(&hit).is_some_and(Material::passes_light) {
                return Some((hit, from + way * t));
            }
            let at = from + way * t;
            passed = t + OFF_SURFACE * (at.abs().max_element() + from.distance(at)) / way.length();
        }
        None
    }

    /// An estimate of irradiance / π, with some reflections.
    fn arriving(&self, point: &Lit, seed: u32, bounces: u32) -> Vec3 {
        let effects = self.metering.effects;
        // Decorrelates the bounces of a path.
        let square = r2(seed.wrapping_mul(BOUNCES + 1).wrapping_add(bounces).wrapping_add(1));
        let mut sum = self.of_lights(point, disc_point(square)) + self.of_emitters(point, square);
        if !effects.sky_visibility {
            sum += sky_ambient(&self.lighting.sky, point.normal.as_vec3());
        }
        if !(effects.sky_visibility || self.metering.indirect) {
            return sum;
        }
        let way = cosine_direction(point.normal, disc_point(square));
        match self.hit(point.position, way) {
            Some(next) if self.metering.indirect && bounces > 0 => {
                sum += next.albedo * self.arriving(&next, seed, bounces - 1);
            }
            None if effects.sky_visibility => sum += sky_radiance(&self.lighting.sky, way.as_vec3()),
            _ => {}
        }
        sum
    }

    fn of_lights(&self, point: &Lit, disc: DVec2) -> Vec3 {
        let effects = self.metering.effects;
        let of = |light| {
            let (to_light, irradiance) = incident(light, point.position);
            let by_pi =
                irradiance * (point.normal.as_vec3().dot(to_light).max(0.0) * std::f32::consts::FRAC_1_PI);
            let disc = if effects.soft_shadows { disc } else { DVec2::ZERO };
            let ray = shadow_ray(light, point.position, disc);
            let is_seen =
                by_pi != Vec3::ZERO && (!effects.shadows || self.sees(point, ray.direction, ray.most));
            if is_seen { by_pi } else { Vec3::ZERO }
        };
        self.lighting.lights.iter().map(of).sum()
    }

    /// Light of a point of one emitter, chosen by power.
    fn of_emitters(&self, point: &Lit, square: DVec2) -> Vec3 {
        let Some(index) = self.emitters.pick((square.x + square.y).fract()) else { return Vec3::ZERO };
        let emitter = &self.emitters.all()[index];
        let to_light = emitter.point(square.x, square.y) - point.position;
        let facing = -emitter.area_vector().dot(to_light) * 0.5;
        let facing = if emitter.both_sides { facing.abs() } else { facing };
        let squared = to_light.length_squared();
        let weight =
            point.normal.dot(to_light) * facing / (squared * squared) / self.emitters.probability(emitter);
        match weight > 0.0 && weight.is_finite() && self.sees(point, to_light, ALMOST) {
            true => emitter.radiance * (weight * std::f64::consts::FRAC_1_PI) as f32,
            false => Vec3::ZERO,
        }
    }

    fn sees(&self, point: &Lit, way: DVec3, most: f64) -> bool {
        self.nearest(point.position, way, most).is_none()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use argus_scene::LightEffects;

    use super::*;

    fn light(scene: &Scene, effects: LightEffects, indirect: bool) -> f64 {
        PacketSight::new(&Arc::new(scene.clone())).metered(Metering { effects, indirect }).unwrap()
    }

    #[test]
    fn rays_find_about_the_light_that_shading_adds_to_an_open_scene() {
        let scene = argus_scene::procedural::terrain(20_000);
        let whole = light(&scene, LightEffects::NONE, false);
        for effects in ["shadows", "sky-visibility", "shadows,sky-visibility"] {
            let share = light(&scene, effects.parse().unwrap(), false) / whole;
            assert!((0.5..1.1).contains(&share), "{effects}: {share}");
        }
    }

    #[test]
    fn walls_keep_light_out_and_reflect_it() {
        let scene = argus_scene::procedural::rooms(20);
        let direct = light(&scene, LightEffects::ALL, false);
        let all = light(&scene, LightEffects::ALL, true);
        assert!(direct < 0.9 * all, "{direct} {all}");
    }

    #[test]
    fn a_scene_without_light_or_surfaces_is_not_metered() {
        let mut scene = argus_scene::procedural::terrain(2_000);
        let metering = Metering { effects: LightEffects::ALL, indirect: true };
        let metered = |scene: &Scene| PacketSight::new(&Arc::new(scene.clone())).metered(metering);
        scene.lighting = Lighting { lights: Vec::new(), sky: argus_scene::Sky::BLACK, exposure: 1.0 };
        assert_eq!(metered(&scene), None);
        scene.instances.clear();
        assert_eq!(metered(&scene), None);
    }

    #[test]
    fn light_is_the_same_at_a_million_metres() {
        let scene = argus_scene::procedural::rooms(20);
        let mut far = scene.clone();
        let by = DVec3::new(1e6, -2e6, 3e6);
        for instance in &mut far.instances {
            instance.world_from_mesh.translation += by;
        }
        for light in &mut far.lighting.lights {
            if let argus_scene::Light::Point { position, .. } | argus_scene::Light::Spot { position, .. } =
                light
            {
                *position += by;
            }
        }
        for named in &mut far.cameras {
            named.camera.eye += by;
            named.camera.target += by;
        }
        let [near, far] = [&scene, &far].map(|scene| light(scene, LightEffects::ALL, true));
        assert!((near / far - 1.0).abs() < 0.02, "{near} {far}");
    }
}
