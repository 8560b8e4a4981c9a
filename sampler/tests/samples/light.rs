//! Direct light by rays, against the reference's.

use std::sync::Arc;

use argus_sampler::{Indirect, LightSettings, LightTracer, PathSettings, PreparedSampler, SamplerSettings};
use argus_scene::effects::{EffectKind, SHARED_STAGE};
use argus_scene::reference::{DirectLight, Tracer};
use argus_scene::{
    Camera, Cancel, EffectPlan, EffectRequest, Effects, Light, LightChoice, LightEffects, Lighting, Material,
    Output, PixelJob, PlaneKind, Sampler, Scene, SceneHash, SceneState, Sky, Visibility,
};
use glam::{DAffine3, DVec3, Vec3, Vec4};
use image::RgbImage;

use crate::common::*;
use crate::small_scene;

/// Every kind of surface, under lights with and without an extent, a sky and an emitter.
pub(crate) fn scene_with_lights() -> Scene {
    let mut scene = small_scene::scene();
    for light in &mut scene.lighting.lights {
        match light {
            Light::Directional { angular_radius, .. } => *angular_radius = 0.05,
            Light::Point { radius, .. } => *radius = 0.1,
            Light::Spot { radius, .. } => *radius = 0.0,
        }
    }
    scene.materials.push(argus_scene::Material {
        emissive: Vec3::new(4.0, 3.0, 2.0),
        base_color: Vec4::W,
        ..argus_scene::Material::default()
    });
    let material = scene.materials.len() as u32 - 1;
    let lamp = quad(Vec3::ZERO, Vec3::X * 0.3, Vec3::Z * 0.3, 1.0, material);
    place(&mut scene, lamp, DAffine3::from_translation(DVec3::new(-1.5, 1.8, 0.5)));
    scene
}

fn with(scene: &Arc<Scene>, effects: LightEffects) -> argus_sampler::GpuSampler {
    sampler_with(scene, SamplerSettings { effects, ..SamplerSettings::default() })
}

fn truth(scene: &Arc<Scene>, effects: LightEffects, camera: &Camera, size: [u32; 2]) -> RgbImage {
    let tracer = Tracer::new(Arc::clone(scene)).with_direct_light(DirectLight { effects, rays: 64 });
    tracer.render(camera, size[0], size[1], 4, |_| {}).display(scene.lighting.exposure)
}

pub(crate) const CAMERA: (DVec3, DVec3) = (DVec3::new(2.6, 2.6, 4.2), DVec3::new(-0.2, 0.6, -0.3));

#[test]
fn direct_views_have_the_references_light_whichever_effects_are_on() {
    let scene = Arc::new(scene_with_lights());
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let size = [112, 84];
    let none = LightEffects::NONE;
    for (name, effects, most) in [
        ("hard-shadows", LightEffects { shadows: true, ..none }, 0.012),
        ("soft-shadows", LightEffects { shadows: true, soft_shadows: true, ..none }, 0.015),
        ("sky", LightEffects { sky_visibility: true, ..none }, 0.03),
        ("emitters", LightEffects { emitters: true, ..none }, 0.1),
        ("all", LightEffects::ALL, 0.1),
    ] {
        let frame = direct(&mut with(&scene, effects), &view_job(camera, size, 4));
        let truth = truth(&scene, effects, &camera, size);
        let found = flip(&format!("light-{name}"), &image_of(&frame), &truth);
        println!("{name}: FLIP {found:.4} {:?}", frame.stages);
        assert!(found <= most, "{name}: FLIP {found}");
        let dark = image_of(&direct(&mut with(&scene, none), &view_job(camera, size, 4)));
        let changed = flip("light-none", &dark, &truth);
        assert!(changed > found, "{name} changes FLIP by {changed} only");
    }
}

#[test]
fn light_that_the_device_traces_is_that_of_the_cpu() {
    let scene = Arc::new(scene_with_lights());
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let size = [96, 72];
    let none = LightEffects::NONE;
    let paths = Indirect::Paths(PathSettings { level: 5, ..PathSettings::default() });
    for (name, effects, indirect) in [
        ("hard-shadows", LightEffects { shadows: true, ..none }, Indirect::Off),
        ("soft-shadows", LightEffects { shadows: true, soft_shadows: true, ..none }, Indirect::Off),
        ("sky", LightEffects { sky_visibility: true, ..none }, Indirect::Off),
        ("emitters", LightEffects { emitters: true, ..none }, Indirect::Off),
        ("all", LightEffects::ALL, Indirect::Off),
        ("paths", LightEffects::ALL, paths),
    ] {
        let render = |tracer: LightTracer| {
            let light = LightSettings { tracer, ..LightSettings::default() };
            let settings = SamplerSettings { effects, light, indirect, ..SamplerSettings::default() };
            let frame = direct(&mut sampler_with(&scene, settings), &view_job(camera, size, 4));
            println!("{name}, {tracer:?}: {:?}", frame.stages);
            image_of(&frame)
        };
        let (by_cpu, on_device) = (render(LightTracer::Cpu), render(LightTracer::Device));
        let differs = |a: &image::Rgb<u8>, b: &image::Rgb<u8>| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 2);
        let apart = by_cpu.pixels().zip(on_device.pixels()).filter(|(a, b)| differs(a, b)).count();
        println!("{name}: {apart} pixels differ");
        assert!(apart * 1000 <= 2 * (size[0] * size[1]) as usize, "{name}: {apart} pixels differ");
    }
}

#[test]
fn samples_have_the_same_light_from_the_device_as_from_the_cpu() {
    let scene = Arc::new(scene_with_lights());
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let rig = omni_rig(CAMERA.0, 24);
    let job = sample_job(&scene, rig, rig.nearest(&camera, 1)[0], true);
    let render = |tracer: LightTracer| {
        let light = LightSettings { tracer, ..LightSettings::default() };
        let settings = SamplerSettings { effects: LightEffects::ALL, light, ..SamplerSettings::default() };
        sample(&mut sampler_with(&scene, settings), &job)
    };
    let (by_cpu, on_device) = (render(LightTracer::Cpu), render(LightTracer::Device));
    let [a, b] = [&by_cpu, &on_device].map(|sample| host_bytes(sample, PlaneKind::LightVisibility));
    let apart = a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert!(apart * 200 <= a.len(), "{apart} of {} shares differ", a.len());
    let [a, b] = [&by_cpu, &on_device].map(radiance_of);
    let differs = |a: &Vec3, b: &Vec3| (*a - *b).abs().max_element() > 0.02 * a.max_element() + 1e-3;
    let apart = a.iter().zip(&b).filter(|(a, b)| differs(a, b)).count();
    assert!(apart * 200 <= a.len(), "{apart} of {} texels differ", a.len());
}

#[test]
fn a_row_removed_from_the_effect_plan_takes_its_pass_and_its_milliseconds_along() {
    let scene = Arc::new(scene_with_lights());
    let request = EffectRequest {
        effects: Effects::Auto,
        indirect: Some(argus_scene::Indirect::Off),
        ..EffectRequest::default()
    };
    let whole = EffectPlan::of(&scene, &request, None);
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let rig = omni_rig(CAMERA.0, 24);
    let job = sample_job(&scene, rig, rig.nearest(&camera, 1)[0], true);
    // Stages of a view and of a sample, and the passes that are on.
    let render = |plan: &EffectPlan| {
        let mut sampler = with(&scene, plan.light_effects());
        let view = direct(&mut sampler, &view_job(camera, [48, 36], 1)).stages;
        let sample = sample(&mut sampler, &job).stages;
        let on: Vec<&str> = sampler.plan().into_iter().filter(|pass| pass.on).map(|pass| pass.name).collect();
        (view, sample, on)
    };
    let stage_of = [
        (EffectKind::Shadows, "trace shadows"),
        (EffectKind::SoftShadows, "trace penumbras"),
        (EffectKind::SkyVisibility, "trace sky"),
        (EffectKind::Emitters, "trace emitters"),
    ];
    for removed in [None].into_iter().chain(stage_of.map(|(effect, _)| Some(effect))) {
        let mut plan = whole.clone();
        plan.rows.retain(|row| Some(row.effect) != removed);
        let (view, sample, on) = render(&plan);
        for (effect, stage) in stage_of {
            let is_left = Some(effect) != removed
                && (removed, effect) != (Some(EffectKind::Shadows), EffectKind::SoftShadows);
            for stages in [&view, &sample] {
                let has = stages.iter().any(|row| row.name == stage);
                assert_eq!(has, is_left, "{stage} without {removed:?}: {stages:?}");
                assert_eq!(effect.ms_of(stages).is_some_and(|ms| ms > 0.0), is_left, "{effect}");
            }
            assert_eq!(on.contains(&stage), is_left, "{stage} without {removed:?}: {on:?}");
        }
        plan.measured_in(&view);
        assert_eq!(plan.row(EffectKind::Glow).unwrap().measured_ms, None, "it is a part of shading");
        for row in plan.rows.iter().filter(|row| stage_of.iter().any(|(effect, _)| *effect == row.effect)) {
            assert!(row.measured_ms.is_some() && row.saved_ms.is_none(), "{row:?}");
        }
    }
    let (view, sample, on) = render(&EffectPlan::default());
    let names: Vec<&str> = view.iter().chain(&sample).map(|stage| stage.name.as_str()).collect();
    let light = |name: &&str| *name == SHARED_STAGE || stage_of.iter().any(|(_, stage)| stage == name);
    assert!(!names.iter().any(light) && !on.iter().any(light), "nothing is read back: {names:?} {on:?}");
}

#[test]
fn a_view_with_other_effects_is_that_of_their_sampler_and_leaves_the_own_ones_as_they_were() {
    let job = view_job(Camera::look_at(CAMERA.0, CAMERA.1), [48, 36], 1);
    // Textures of emission are not read for a measurement alone.
    for (textured, emitters) in [(true, false), (true, true), (false, false)] {
        let mut scene = scene_with_lights();
        scene.materials.iter_mut().filter(|_| !textured).for_each(|m| m.emissive_texture = None);
        let scene = Arc::new(scene);
        let own = LightEffects { shadows: true, emitters, ..LightEffects::NONE };
        let all = LightEffects { emitters: emitters || !textured, ..LightEffects::ALL };
        let [mut own, mut all, mut none] = [own, all, LightEffects::NONE].map(|e| with(&scene, e));
        let [before, expected, _] =
            [&mut own, &mut all, &mut none].map(|one| direct(one, &job).images[Output::Color].clone());
        assert!(before != expected);
        assert!(
            own.render_with(LightEffects::ALL, &job).unwrap().unwrap().images[Output::Color] == expected,
            "{textured}"
        );
        assert!(direct(&mut own, &job).images[Output::Color] == before);
        assert!(none.render_with(LightEffects::ALL, &job).is_none(), "its surfaces are not read back");
    }
}

#[test]
fn a_spot_light_casts_no_ray_where_its_cone_does_not_reach() {
    let mut scene = empty_scene();
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 20.0, Vec3::NEG_Z * 20.0, 1.0, 0), DAffine3::IDENTITY);
    scene.lighting = Lighting {
        lights: vec![Light::Spot {
            position: DVec3::new(-8.0, 3.0, 0.0),
            direction: DVec3::NEG_Y,
            intensity: Vec3::splat(40.0),
            range: None,
            inner_cone: 0.2,
            outer_cone: 0.4,
            radius: 0.0,
        }],
        sky: Sky::BLACK,
        exposure: 1.0,
    };
    let scene = Arc::new(scene);
    let effects = LightEffects { shadows: true, ..LightEffects::NONE };
    let view = |target: DVec3| {
        let camera = Camera { fov_deg: 40.0, ..Camera::look_at(target + DVec3::new(0.0, 4.0, 3.0), target) };
        let frame = direct(&mut with(&scene, effects), &view_job(camera, [48, 36], 1));
        let cast = frame.stages.iter().any(|stage| stage.name == "trace shadows");
        (cast, image_of(&frame).iter().any(|byte| *byte > 0))
    };
    assert_eq!(view(DVec3::new(-8.0, 0.0, 0.0)), (true, true), "in the cone");
    assert_eq!(view(DVec3::new(8.0, 0.0, 0.0)), (false, false), "beside the cone");
}

#[test]
fn a_sample_stores_the_light_of_direct_views_and_which_lights_its_gloss_sees() {
    let scene = Arc::new(scene_with_lights());
    let mut sampler = with(&scene, LightEffects::ALL);
    let rig = omni_rig(DVec3::new(1.0, 1.5, 2.0), 96);
    let here = Camera::look_at(DVec3::new(1.0, 1.5, 2.0), DVec3::ZERO);
    let job = sample_job(&scene, rig, rig.nearest(&here, 1)[0], true);
    let found = sample(&mut sampler, &job);
    let seen = host_bytes(&found, PlaneKind::LightVisibility);
    let range = floats(&host_bytes(&found, PlaneKind::InverseRange));
    let shares = |byte: usize| seen.iter().skip(byte).step_by(4).zip(&range).filter(|(_, r)| **r > 0.0);
    for byte in 0..4 {
        let (all, none) = (shares(byte).any(|(s, _)| *s == 255), shares(byte).any(|(s, _)| *s < 64));
        assert!(all && none, "byte {byte}: some texels see the light and some do not");
    }
    let mean = mean_radiance(&mut sampler, &job);
    let open = mean_radiance(&mut with(&scene, LightEffects::NONE), &job);
    assert!(mean.element_sum() < open.element_sum(), "what blocks light darkens: {mean} {open}");
    // Equal bytes in another order of work.
    let again = sample(&mut with(&scene, LightEffects::ALL), &job);
    for plane in &found.planes {
        assert!(host_bytes(&found, plane.kind) == host_bytes(&again, plane.kind), "{:?}", plane.kind);
    }
}

#[test]
fn listed_pixels_have_about_the_light_of_their_view() {
    let scene = Arc::new(scene_with_lights());
    let mut sampler = with(&scene, LightEffects::ALL);
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let size = [96, 72];
    let whole = image_of(&direct(&mut sampler, &view_job(camera, size, 4)));
    let pixels: Vec<u32> = (0..size[0] * size[1]).step_by(7).collect();
    let job = PixelJob {
        camera,
        width: size[0],
        height: size[1],
        pixels: pixels.clone(),
        samples_per_pixel: 4,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: None,
    };
    let found = sampler.render_pixels(&[job], &Cancel::new()).remove(0).unwrap();
    let differences = pixels.iter().zip(found.color.chunks_exact(3)).map(|(pixel, color)| {
        let view = whole.get_pixel(pixel % size[0], pixel / size[0]).0;
        (0..3).map(|i| (f64::from(view[i]) - f64::from(color[i])).abs()).sum::<f64>() / 3.0
    });
    let mean = differences.sum::<f64>() / pixels.len() as f64;
    assert!(mean < 3.0, "{mean} of 255");
}

#[test]
fn shadows_stand_still_far_from_zero_and_on_small_scenes() {
    for (scale, offset) in [(1.0, 1e6), (1e-3, 0.0), (1e3, 0.0)] {
        let mut scene = empty_scene();
        scene.lighting = Lighting {
            lights: vec![Light::Directional {
                direction: DVec3::new(0.3, -1.0, 0.1).normalize(),
                irradiance: Vec3::splat(3.0),
                angular_radius: 0.0,
            }],
            sky: Sky::BLACK,
            exposure: 1.0,
        };
        let shift = DVec3::splat(offset);
        let at = |p: DVec3| {
            DAffine3::from_translation(p * scale + shift) * DAffine3::from_scale(DVec3::splat(scale))
        };
        place(&mut scene, quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1.0, 0), at(DVec3::ZERO));
        place(&mut scene, ball(0, 24), at(DVec3::Y * 1.2));
        let scene = Arc::new(scene);
        let effects = LightEffects { shadows: true, ..LightEffects::NONE };
        let camera =
            Camera::look_at(DVec3::new(3.0, 3.0, 4.0) * scale + shift, DVec3::Y * 0.5 * scale + shift);
        let size = [128, 96];
        let image = image_of(&direct(&mut with(&scene, effects), &view_job(camera, size, 1)));
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 1 });
        let truth = tracer.render(&camera, size[0], size[1], 1, |_| {}).display(1.0);
        let wrong = image.pixels().zip(truth.pixels()).filter(|(a, b)| a.0[0].abs_diff(b.0[0]) > 24).count();
        let share = wrong as f64 / f64::from(size[0] * size[1]);
        assert!(share < 0.005, "{:.3}% wrong at scale {scale}, offset {offset}", share * 100.0);
    }
}

#[test]
fn a_ball_of_glass_casts_no_shadow_and_one_of_stone_does() {
    let shade = |transmission: f32| {
        let mut scene = empty_scene();
        scene.materials = vec![Material { transmission, ..Material::default() }, Material::default()];
        let sun =
            Light::Directional { direction: DVec3::NEG_Y, irradiance: Vec3::splat(2.0), angular_radius: 0.0 };
        scene.lighting = Lighting { lights: vec![sun], sky: Sky::BLACK, exposure: 1.0 };
        place(&mut scene, quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1.0, 1), DAffine3::IDENTITY);
        place(&mut scene, ball(0, 24), DAffine3::from_translation(DVec3::Y * 3.0));
        let scene = Arc::new(scene);
        let effects = LightEffects { shadows: true, ..LightEffects::NONE };
        // The ground under the ball, from the side.
        let camera = Camera { fov_deg: 10.0, ..Camera::look_at(DVec3::new(3.0, 1.5, 0.0), DVec3::ZERO) };
        let image = image_of(&direct(&mut with(&scene, effects), &view_job(camera, [16, 16], 1)));
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 1 });
        let truth = tracer.render(&camera, 16, 16, 1, |_| {}).display(1.0);
        [image, truth].map(|image| image.get_pixel(8, 8).0[0])
    };
    let ([glass, true_glass], [stone, true_stone]) = (shade(1.0), shade(0.0));
    assert!(glass > 100 && glass.abs_diff(true_glass) <= 1, "{glass} {true_glass}");
    assert_eq!((stone, true_stone), (0, 0));
}

#[test]
fn all_visibility_backends_have_the_same_light() {
    let scene = Arc::new(scene_with_lights());
    let mut sampler = with(&scene, LightEffects::ALL);
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let images: Vec<RgbImage> = Visibility::ALL
        .iter()
        .map(|&visibility| {
            let job = argus_scene::ViewJob { visibility, ..view_job(camera, [96, 72], 1) };
            image_of(&direct(&mut sampler, &job))
        })
        .collect();
    for image in &images[1..] {
        let differ = image.pixels().zip(images[0].pixels()).filter(|(a, b)| a != b).count();
        assert!(differ <= 96 * 72 / 20, "{differ} pixels differ, where only edges may");
    }
}

#[test]
fn a_sampler_that_was_prepared_before_the_light_was_known_renders_the_same_bytes() {
    let opened = Arc::new(scene_with_lights());
    let camera = Camera::look_at(CAMERA.0, CAMERA.1);
    let job = view_job(camera, [96, 72], 1);
    for (choice, effects) in [
        (LightChoice::FILE, LightEffects { shadows: true, ..LightEffects::NONE }),
        (LightChoice::SKY.with_own(-3), LightEffects::ALL),
        (LightChoice::interior(1.0), LightEffects::ALL),
        (LightChoice::interior(1.0), LightEffects::NONE),
    ] {
        let scene = Arc::new((*opened).clone().in_light(choice));
        let settings = SamplerSettings { effects, exposure: Some(1.5), ..SamplerSettings::default() };
        let prepared = PreparedSampler::new(gpu(), &opened, crate::methods()).unwrap();
        assert!(prepared.is_of(&gpu(), &scene));
        assert_eq!(Arc::strong_count(&opened), 1, "who opened the scene may change it");
        let found = direct(&mut prepared.in_light(scene.clone(), settings).unwrap(), &job);
        let expected = direct(&mut sampler_with(&scene, settings), &job);
        assert_eq!(found.images[Output::Color], expected.images[Output::Color], "{choice}, {effects}");
    }
    let other = Scene { hash: SceneHash([7; 32]), ..(*opened).clone() };
    assert!(!PreparedSampler::new(gpu(), &opened, crate::methods()).unwrap().is_of(&gpu(), &other));
}
