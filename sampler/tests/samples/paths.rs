//! Indirect light by paths between leaf sides, against what is known exactly and against the path-traced reference.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_sampler::{GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::{
    Camera, Light, LightEffects, LightLevel, Lighting, PlaneKind, SampleJob, Sampler as _, Scene,
};
use glam::{DAffine3, DVec3, Vec3};
use image::RgbImage;

use crate::common::*;
use crate::rooms::*;

/// Cells of six centimetres in a room of four metres.
fn coarse() -> PathSettings {
    PathSettings { level: 6, ..PathSettings::default() }
}

fn settings(paths: PathSettings) -> SamplerSettings {
    let indirect = Indirect::Paths(paths);
    let effects = indirect.effects_with(LightEffects::NONE);
    SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() }
}

fn lit(scene: &Arc<Scene>, paths: PathSettings) -> GpuSampler {
    sampler_with(scene, settings(paths))
}

fn mean_of(image: &RgbImage) -> f64 {
    image.iter().map(|&b| f64::from(b)).sum::<f64>() / image.len() as f64
}

#[test]
fn in_a_furnace_everything_is_as_bright_as_the_series_says() {
    let scene = furnace();
    let mut sampler = lit(&scene, coarse());
    let radiance = mean_radiance(&mut sampler, &job_around_origin(&scene, 24));
    // Emission, and 0.5 of it at each reflection, the first surface's included.
    let series: f32 = (0..=coarse().bounces as i32 + 1).map(|k| 0.5f32.powi(k)).sum();
    println!("{radiance}, not {}: {:?}", 0.1 * series, sampler.paths());
    assert!((radiance / (0.1 * series) - 1.0).abs().max_element() < 0.03, "{radiance}, not {}", 0.1 * series);
}

#[test]
fn a_room_looks_like_the_path_traced_one_wherever_it_stands() {
    for (offset, name) in [(DVec3::ZERO, "near"), (DVec3::new(1e6, -2e6, 3e6), "far")] {
        let scene = box_of_cornell(offset);
        let (camera, size) = (view_of_room(offset), [64, 64]);
        let effects = Indirect::Paths(coarse()).effects_with(LightEffects::NONE);
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 16 });
        let image = |bounces| {
            tracer.render_with(&camera, size, 4, Some(Paths { paths: 64, bounces }), |_| {}).display(1.0)
        };
        let (truth, unlit) = (image(coarse().bounces), image(0));
        let mut sampler = lit(&scene, coarse());
        let found = image_of(&direct(&mut sampler, &view_job(camera, size, 4)));
        let (with, without) = (flip(&format!("paths-{name}"), &found, &truth), flip("none", &unlit, &truth));
        let (mean, wanted, dark) = (mean_of(&found), mean_of(&truth), mean_of(&unlit));
        println!(
            "{name}: FLIP {with:.4}, {without:.4} without; mean {mean:.1} of {wanted:.1}, {dark:.1} without"
        );
        println!("{:?}", sampler.paths());
        assert!(with < 0.06 && with < 0.25 * without, "{name}: FLIP {with} with, {without} without");
        let share = (mean - dark) / (wanted - dark);
        assert!((share - 1.0).abs() < 0.1, "{name}: {share} of indirect light");
    }
}

/// Two rooms of four metres on one floor, with a wall of two centimetres between and a light in one of them.
fn rooms_with_a_thin_wall() -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.materials = vec![grey(0.7)];
    let room = DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0));
    let mut around = empty_scene();
    add_room(&mut around, DVec3::ZERO, [0; 6]);
    for mesh in around.meshes {
        place(&mut scene, mesh, room);
    }
    let here = DAffine3::IDENTITY;
    for (face, x) in [(1.0, Vec3::Y * 2.0), (-1.0, Vec3::NEG_Y * 2.0)] {
        place(&mut scene, quad(Vec3::X * (0.01 * face), x, Vec3::Z * 2.0, 1.0, 0), here);
    }
    let position = DVec3::new(-2.0, 1.0, 0.3);
    let intensity = Vec3::splat(4.0);
    scene.lighting = lit_by(vec![Light::Point { position, intensity, range: None, radius: 0.0 }]);
    Arc::new(scene)
}

#[test]
fn a_wall_of_two_centimetres_keeps_light_out_of_the_next_room() {
    let scene = rooms_with_a_thin_wall();
    for (level, most) in [(6, 0.02), (7, 0.01)] {
        let mut sampler = lit(&scene, PathSettings { level, ..PathSettings::default() });
        let mut mean_at = |x: f64| {
            let at = DVec3::new(x, 0.1, 0.2);
            let rig = omni_rig(at, 32);
            let nearest = rig.nearest(&Camera::look_at(at, DVec3::ZERO), 1)[0];
            mean_radiance(&mut sampler, &sample_job(&scene, rig, nearest, true)).x
        };
        let (light, dark) = (mean_at(-2.0), mean_at(2.0));
        println!("level {level}: {light} and {dark}, {:.3}%", 100.0 * dark / light);
        assert!(dark < most * light, "level {level}: {dark} of {light}");
    }
}

#[test]
fn two_samplers_give_the_same_bytes_and_a_change_of_lights_leaves_no_trace() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = job_around_origin(&scene, 24);
    let mut sampler = lit(&scene, coarse());
    let first = host_bytes(&sample(&mut sampler, &job), PlaneKind::Radiance);
    assert!(first == host_bytes(&sample(&mut lit(&scene, coarse()), &job), PlaneKind::Radiance));

    let dim = Lighting { lights: Vec::new(), ..scene.lighting.clone() };
    let info = argus_scene::SampleSetInfo { lighting: dim, ..(*job.info).clone() };
    let dark = argus_scene::SampleJob { info: Arc::new(info), ..job.clone() };
    assert_eq!(mean_radiance(&mut sampler, &dark), Vec3::ZERO);
    assert!(first == host_bytes(&sample(&mut sampler, &job), PlaneKind::Radiance));

    let other = PathSettings { level: 4, rays: 8, bounces: 2, gather: 2 };
    sampler.set_indirect(Indirect::Paths(other)).unwrap();
    assert!(first != host_bytes(&sample(&mut sampler, &job), PlaneKind::Radiance));
    sampler.set_indirect(Indirect::Paths(coarse())).unwrap();
    assert!(first == host_bytes(&sample(&mut sampler, &job), PlaneKind::Radiance));
    assert!(sampler.set_indirect(Indirect::Vpl(argus_sampler::VplSettings::default())).is_err());
}

#[test]
fn pixels_of_a_list_look_like_those_of_the_whole_view() {
    let mut sampler = lit(&box_of_cornell(DVec3::ZERO), coarse());
    let off = off_in_a_list(&mut sampler, 4);
    assert!(off < 4.0, "{off} of 255");
}

#[test]
fn a_scene_without_surfaces_and_one_with_degenerate_triangles_render() {
    let mut scene = empty_scene();
    let nothing = Arc::new(scene.clone());
    assert!(mean_radiance(&mut lit(&nothing, coarse()), &job_around_origin(&nothing, 8)).is_finite());
    place(&mut scene, quad(Vec3::NEG_Z, Vec3::X, Vec3::Y, 1.0, 0), DAffine3::IDENTITY);
    place(&mut scene, quad(Vec3::NEG_Z, Vec3::X, Vec3::X, 1.0, 0), DAffine3::IDENTITY);
    let scene = Arc::new(scene);
    let mut sampler = lit(&scene, coarse());
    assert!(mean_radiance(&mut sampler, &job_around_origin(&scene, 8)).is_finite());
    assert!(sampler.paths().is_some_and(|report| report.sides > 0));
}

#[test]
fn light_rises_from_level_to_level_and_what_was_prepared_beside_has_the_bytes_of_what_was_made_at_once() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = job_around_origin(&scene, 24);
    let mut sampler = lit(&scene, coarse());
    let at = |light| {
        let mut info = (*job.info).clone();
        info.version.state.light = light;
        SampleJob { info: Arc::new(info), ..job.clone() }
    };
    let mean_and_bytes = |sampler: &mut GpuSampler, light| {
        let job = at(light);
        (mean_radiance(sampler, &job).x, host_bytes(&sample(sampler, &job), PlaneKind::Radiance))
    };
    let (direct, _) = mean_and_bytes(&mut sampler, LightLevel::Direct);
    let mut made = Vec::new();
    for light in [LightLevel::Coarse, LightLevel::Full] {
        let began = Instant::now();
        while !sampler.prepare_light(&job.info, light).unwrap() {
            assert!(began.elapsed() < Duration::from_secs(60), "{light} light is never ready");
            std::thread::sleep(Duration::from_millis(5));
        }
        made.push(mean_and_bytes(&mut sampler, light));
    }
    let [(coarse_mean, coarse_bytes), (full_mean, full_bytes)] = &made[..] else { panic!("two levels") };
    println!("{direct}, {coarse_mean}, {full_mean}");
    assert!(*full_mean > 1.2 * direct && *coarse_mean > 1.2 * direct, "light comes from walls, too");
    assert!(coarse_bytes != full_bytes);
    // Levels that were left are still there; nothing of another level stays in them.
    assert_eq!(mean_and_bytes(&mut sampler, LightLevel::Direct).0, direct);
    assert!(mean_and_bytes(&mut sampler, LightLevel::Coarse).1 == *coarse_bytes);
    let mut at_once = lit(&scene, coarse());
    assert!(mean_and_bytes(&mut at_once, LightLevel::Full).1 == *full_bytes);
}
