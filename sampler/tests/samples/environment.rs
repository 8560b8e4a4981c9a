//! Scenes in environment maps, against the reference.

use std::sync::Arc;

use argus_sampler::SamplerSettings;
use argus_scene::reference::{DirectLight, Tracer};
use argus_scene::{Camera, Environment, LightEffects, Scene};
use glam::{DVec3, Vec3};
use image::RgbImage;

use crate::common::*;
use crate::small_scene;

/// Bands and sectors of colour, dim towards the ground, and a sun of one texel.
fn environment() -> Environment {
    let texel = |i: u32| {
        let (x, y) = (i % 128, i / 128);
        if (x, y) == (10, 14) {
            return Vec3::new(4e3, 3.6e3, 3e3);
        }
        let band = |k: f32, of: u32| 0.5 + 0.5 * (k * of as f32).sin();
        let sector = Vec3::new(band(0.2, x), band(0.05, x + y), band(0.1, y));
        (sector * 0.6 + 0.05) * (1.0 - y as f32 / 80.0)
    };
    Environment::new(128, 64, (0..128 * 64).map(texel).collect()).expect("a sound map")
}

fn difference(a: &RgbImage, b: &RgbImage) -> (u8, f64) {
    let bytes = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b));
    let most = bytes.clone().max().unwrap_or(0);
    (most, bytes.map(f64::from).sum::<f64>() / a.as_raw().len() as f64)
}

#[test]
fn the_background_of_a_view_is_the_map_at_its_poles_and_its_seam_too() {
    let scene = Arc::new(empty_scene().with_environment(environment(), b""));
    let mut sampler = sampler(&scene);
    for target in [DVec3::Y, DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X, DVec3::new(0.3, 0.4, 0.5)] {
        let camera =
            Camera { up: DVec3::new(0.1, 0.2, 0.9), fov_deg: 60.0, ..Camera::look_at(DVec3::ZERO, target) };
        let ours = image_of(&direct(&mut sampler, &view_job(camera, [90, 60], 1)));
        let truth = reference(&scene, &camera, [90, 60], 1).display(scene.lighting.exposure);
        let (most, mean) = difference(&ours, &truth);
        // A byte of rounding; at the pole itself the columns meet.
        assert!(most <= 2 && mean < 0.1, "{target}: {most} {mean}");
    }
}

#[test]
fn direct_views_have_the_references_light_in_an_environment() {
    let scene = small_scene::scene().with_environment(environment(), b"");
    assert!(scene.lighting.lights.len() > small_scene::scene().lighting.lights.len(), "the map's sun");
    let scene: Arc<Scene> = Arc::new(scene);
    let camera = Camera::look_at(DVec3::new(2.6, 2.6, 4.2), DVec3::new(-0.2, 0.6, -0.3));
    let size = [112, 84];
    let none = LightEffects::NONE;
    for (name, effects, most) in [
        ("none", none, 0.012),
        ("shadows", LightEffects { shadows: true, soft_shadows: true, ..none }, 0.015),
        ("sky", LightEffects { sky_visibility: true, ..none }, 0.03),
        ("all", LightEffects::ALL, 0.1),
    ] {
        let mut sampler = sampler_with(&scene, SamplerSettings { effects, ..SamplerSettings::default() });
        let ours = image_of(&direct(&mut sampler, &view_job(camera, size, 4)));
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 64 });
        let truth = tracer.render(&camera, size[0], size[1], 4, |_| {}).display(scene.lighting.exposure);
        let found = flip(&format!("environment-{name}"), &ours, &truth);
        println!("{name}: FLIP {found:.4}");
        assert!(found <= most, "{name}: FLIP {found}");
    }
}

#[test]
fn a_sample_of_an_open_surface_is_as_bright_under_a_map_of_one_colour_as_under_that_sky() {
    let one = |color: Vec3| Environment::new(4, 2, vec![color; 8]).expect("a sound map");
    let color = Vec3::new(0.5, 0.25, 0.75);
    let mapped = small_scene::scene().with_environment(one(color), b"");
    let mut even = mapped.clone();
    even.lighting.sky =
        argus_scene::Sky { zenith: color, horizon: color, ground: color, map: None, reach: None };
    let rig = omni_rig(DVec3::new(1.0, 1.5, 2.0), 48);
    let here = Camera::look_at(DVec3::new(1.0, 1.5, 2.0), DVec3::ZERO);
    for effects in [LightEffects::NONE, LightEffects { sky_visibility: true, ..LightEffects::NONE }] {
        let [mapped, even] = [&mapped, &even].map(|scene| {
            let scene = Arc::new(scene.clone());
            let job = sample_job(&scene, rig, rig.nearest(&here, 1)[0], true);
            let mut sampler = sampler_with(&scene, SamplerSettings { effects, ..SamplerSettings::default() });
            mean_radiance(&mut sampler, &job)
        });
        assert!((mapped / even - Vec3::ONE).abs().max_element() < 2e-3, "{effects}: {mapped} {even}");
    }
}
