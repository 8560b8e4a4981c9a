//! A view whose lights are blocked by what maps of eye-based points see (section 5), in the study of shadows.

use std::sync::Arc;
use std::time::Instant;

use argus_eye_points::{
    Density, DensityRule, Eye, EyePointSettings, LARGEST_SHADOW_SIDE, PointScene, is_lit, light_map,
    light_points, shadow_side,
};
use argus_sampler::plug::MappedReflector;
use argus_scene::reference::Hit;
use argus_scene::shading::{Surface, incident, reflected_light};
use argus_scene::{Camera, Light, Lighting, Scene};
use glam::{DVec2, DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

use super::stage::{NEAR, Stage};
use super::ways::USUAL_DENSITY;

/// A scene whose lights all have a place.
pub(crate) struct ShadowScene {
    stage: Stage,
    points: PointScene,
    lighting: Lighting,
}

/// A view, and what it took.
pub(crate) struct ShadowedView {
    pub(crate) image: RgbImage,
    /// Milliseconds of the whole view, on the CPU.
    pub(crate) view_ms: f64,
    /// Milliseconds of points, maps and lookups.
    pub(crate) light_ms: f64,
}

/// What a sub-pixel sees.
struct SubPixel {
    /// Radiance, with every light unblocked.
    radiance: Vec3,
    /// Hit, surface, normal of its plane and direction of the ray, unless it is the sky.
    seen: Option<(Hit, Surface, DVec3, DVec3)>,
}

/// Centre and radius of a light that has a place.
fn place_of(light: &Light) -> Option<(DVec3, f64)> {
    match *light {
        Light::Directional { .. } => None,
        Light::Point { position, radius, .. } | Light::Spot { position, radius, .. } => {
            Some((position, radius))
        }
    }
}

impl ShadowScene {
    /// A scene at time zero; `None` if it has no light, or one without a place: a map needs one.
    pub(crate) fn new(scene: &Arc<Scene>) -> Option<Self> {
        let lighting = scene.at(0.0).lighting;
        if lighting.lights.is_empty() || lighting.lights.iter().any(|light| place_of(light).is_none()) {
            return None;
        }
        let stage = Stage::of(Arc::clone(scene), Vec::new());
        let mut blocking = Scene::clone(scene);
        let material = |mesh: u32| &scene.materials[scene.meshes[mesh as usize].material as usize];
        blocking.instances.retain(|instance| !material(instance.mesh).passes_light());
        Some(Self { points: PointScene::new(&Arc::new(blocking), 0.0), stage, lighting })
    }

    /// Whether a light is more than a point.
    pub(crate) fn has_extended_lights(&self) -> bool {
        self.lighting.lights.iter().filter_map(place_of).any(|(_, radius)| radius > 0.0)
    }

    /// A view with shadows by `each` points of every light that is more than a point.
    pub(crate) fn view(&self, camera: &Camera, size: [u32; 2], samples: u32, each: u32) -> ShadowedView {
        let begin = Instant::now();
        let side = f64::from(samples.max(1)).sqrt().ceil() as u32;
        let sub_pixels = self.sub_pixels(camera, size, side);
        let lights_begin = Instant::now();
        let eye = Eye::of(camera, size[0] * side, size[1] * side, NEAR);
        let places: Vec<DVec3> =
            sub_pixels.iter().filter_map(|sub| sub.seen.as_ref().map(|seen| seen.0.position)).collect();
        // The maps of each light, and the first of them.
        let (mut maps, mut first): (Vec<MappedReflector>, Vec<usize>) = (Vec::new(), vec![0]);
        for (place, radius) in self.lighting.lights.iter().filter_map(place_of) {
            let points = light_points(place, radius, if radius > 0.0 { each } else { 1 });
            let map =
                |&point: &DVec3| light_map(point, shadow_side(&eye, point, &places, LARGEST_SHADOW_SIDE));
            maps.par_extend(points.par_iter().map(map));
            first.push(maps.len());
        }
        let density = Density { rule: DensityRule::Shadow, scale: USUAL_DENSITY, reduction: 1.0 };
        let found =
            self.points.points(&eye, &maps, &EyePointSettings { density, ..EyePointSettings::default() });
        let seen = |light: usize, place: DVec3, normal: DVec3| {
            let own = first[light]..first[light + 1];
            let count = own.len() as f32;
            let lit = own.filter(|&map| is_lit(&found.maps, map, maps[map].center, place, normal));
            lit.count() as f32 / count
        };
        let radiance: Vec<Vec3> =
            sub_pixels.par_iter().with_min_len(256).map(|sub| self.blocked(sub, &seen)).collect();
        let light_ms = lights_begin.elapsed().as_secs_f64() * 1e3;
        let per_pixel = (side * side) as usize;
        let exposure = self.lighting.exposure;
        let bytes = radiance.chunks(per_pixel).flat_map(|sub| {
            let mean = sub.iter().sum::<Vec3>() / per_pixel as f32;
            argus_scene::tone::display_from_radiance(mean, exposure)
        });
        let image = RgbImage::from_raw(size[0], size[1], bytes.collect());
        ShadowedView {
            image: image.unwrap_or_else(|| RgbImage::new(size[0], size[1])),
            view_ms: begin.elapsed().as_secs_f64() * 1e3,
            light_ms,
        }
    }

    /// What all sub-pixels see, those of a pixel together, on a grid of `side` × `side` a pixel.
    fn sub_pixels(&self, camera: &Camera, [width, height]: [u32; 2], side: u32) -> Vec<SubPixel> {
        let spacing = f64::from(side).recip();
        let of = |index: u32| {
            let (pixel, sub) = (index / (side * side), index % (side * side));
            let within = DVec2::new(f64::from(sub % side), f64::from(sub / side)) + 0.5;
            let at = DVec2::new(f64::from(pixel % width), f64::from(pixel / width)) + within * spacing;
            let along = |offset: DVec2| camera.direction(at + offset * spacing, width, height);
            let [direction, right, down] = [DVec2::ZERO, DVec2::X, DVec2::Y].map(along);
            let (dx, dy) = (right - direction, down - direction);
            let tracer = &self.stage.tracer;
            let hit = tracer.trace(camera.eye, direction);
            let radiance = tracer.radiance_of(hit.as_ref(), direction, dx, dy);
            let seen = hit.map(|hit| {
                let surface = tracer.surface(&hit, direction, dx, dy);
                (hit, surface, self.stage.plane_normal(&hit, direction), direction)
            });
            SubPixel { radiance, seen }
        };
        (0..width * height * side * side).into_par_iter().with_min_len(256).map(of).collect()
    }

    /// Radiance of a sub-pixel without the light that does not reach it.
    fn blocked(&self, sub: &SubPixel, seen: &(impl Fn(usize, DVec3, DVec3) -> f32 + Sync)) -> Vec3 {
        let Some((hit, surface, normal, direction)) = &sub.seen else { return sub.radiance };
        let missing = |(number, light): (usize, &Light)| {
            let (to_light, irradiance) = incident(light, surface.position);
            let cosine = surface.normal.dot(to_light);
            if !(cosine > 0.0 && irradiance.max_element() > 0.0) {
                return Vec3::ZERO;
            }
            let diffuse = surface.albedo * irradiance * (cosine * std::f32::consts::FRAC_1_PI);
            let mirrored = match surface.f0 == Vec3::ZERO {
                true => Vec3::ZERO,
                false => reflected_light(surface, -direction.as_vec3(), light),
            };
            (diffuse + mirrored) * (1.0 - seen(number, hit.position, *normal))
        };
        let missing: Vec3 = self.lighting.lights.iter().enumerate().map(missing).sum();
        (sub.radiance - missing).max(Vec3::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::LightEffects;
    use argus_scene::metrics::flip_mean;
    use argus_scene::procedural::{mirrors, rooms};
    use argus_scene::reference::{DirectLight, Tracer};

    use super::*;

    #[test]
    fn points_shadow_a_view_as_rays_do() {
        let mut scene = mirrors(6);
        for light in &mut scene.lighting.lights {
            if let Light::Point { radius, .. } = light {
                *radius = 0.1;
            }
        }
        scene.lighting.lights.retain(|light| place_of(light).is_some());
        let scene = Arc::new(scene);
        let shadows = ShadowScene::new(&scene).unwrap();
        assert!(shadows.has_extended_lights());
        let (camera, size) = (scene.default_camera(), [96, 64]);
        for (soft_shadows, each, most) in [(false, 1, 0.02), (true, 12, 0.02)] {
            let effects = LightEffects { shadows: true, soft_shadows, ..LightEffects::NONE };
            let render = |tracer: &Tracer| {
                tracer.render(&camera, size[0], size[1], 4, |_| ()).display(scene.lighting.exposure)
            };
            let open = Tracer::new(Arc::clone(&scene));
            let without = render(&open);
            let truth = render(&open.with_direct_light(DirectLight { effects, rays: 16 }));
            let found = shadows.view(&camera, size, 4, each);
            let [off, unshadowed] = [&found.image, &without].map(|image| flip_mean(&truth, image).unwrap());
            assert!(off < most && off * 2.0 < unshadowed, "{off}, without shadows {unshadowed}");
            assert!(found.light_ms > 0.0 && found.light_ms <= found.view_ms);
        }
    }

    #[test]
    fn a_scene_without_lights_or_with_a_sun_has_no_maps_around_lights() {
        let mut scene = rooms(20);
        scene.lighting.lights.clear();
        assert!(ShadowScene::new(&Arc::new(scene.clone())).is_none());
        scene.lighting.lights =
            vec![Light::Directional { direction: DVec3::NEG_Y, irradiance: Vec3::ONE, angular_radius: 0.0 }];
        assert!(ShadowScene::new(&Arc::new(scene)).is_none());
    }
}
