//! Light that a device finds, against that of the CPU: light cells, emitters and gathered light, and how often it is waited for.

use std::sync::Arc;

use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, Indirect, LightSettings, LightTracer, PathSettings, SamplerSettings};
use argus_scene::{
    Camera, CellSettings, Light, LightEffects, Lighting, Material, Output, ProbeSource, Sampler as _, Scene,
    Sky, SurfaceLight, ViewJob,
};
use glam::{DAffine3, DVec3, Vec3, Vec4};

use crate::cells::{cells, closed_box, color, fill, job, settings};
use crate::common::*;
use crate::light::{CAMERA, scene_with_lights};
use crate::reflecting::{chrome, into_room, probes_from, room_with_a_ball, room_with_two_balls};
use crate::rooms::*;

fn of(gpu: Arc<Gpu>, scene: &Arc<Scene>, indirect: Indirect, tracer: LightTracer) -> GpuSampler {
    let effects = indirect.effects_with(LightEffects::ALL);
    let light = LightSettings { tracer, ..LightSettings::default() };
    let settings = SamplerSettings { sub_samples: 1, effects, light, indirect, ..SamplerSettings::default() };
    GpuSampler::with_methods(gpu, Arc::clone(scene), settings, crate::methods()).expect("the scene fits")
}

fn with_cells(scene: &Arc<Scene>, tracer: LightTracer) -> GpuSampler {
    of(gpu(), scene, Indirect::Cells(settings()), tracer)
}

fn even_sky(radiance: f32) -> Sky {
    let color = Vec3::splat(radiance);
    Sky { zenith: color, horizon: color * 0.5, ground: color * 0.2, map: None, reach: None }
}

/// A room without a ceiling, with a lamp in it and a sun above.
fn open_room(albedo: f32, sky: Sky) -> Arc<Scene> {
    let mut scene = empty_scene();
    let lamp = Material { emissive: Vec3::new(6.0, 4.0, 2.0), base_color: Vec4::W, ..Material::default() };
    scene.materials = vec![grey(albedo), lamp];
    for (n, x, y) in [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::Z, Vec3::Y),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        (Vec3::NEG_Z, Vec3::Y, Vec3::X),
    ] {
        place(&mut scene, quad(n * -2.0, x * 2.0, y * 2.0, 1.0, 0), DAffine3::IDENTITY);
    }
    place(&mut scene, ball(0, 24), DAffine3::from_translation(DVec3::new(0.4, -1.0, -0.5)));
    place(
        &mut scene,
        quad(Vec3::ZERO, Vec3::X * 0.3, Vec3::Z * 0.3, 1.0, 1),
        DAffine3::from_translation(DVec3::new(-1.0, 0.5, 0.0)),
    );
    let sun = Light::Directional {
        direction: DVec3::new(0.4, -1.0, 0.2).normalize(),
        irradiance: Vec3::splat(1.5),
        angular_radius: 0.02,
    };
    scene.lighting = Lighting { lights: vec![sun], sky, exposure: 1.0 };
    Arc::new(scene)
}

/// Share of pixels of which a channel differs by more than two of 255.
fn apart(a: &[u8], b: &[u8]) -> f64 {
    let pixels = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    let differ = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    differ as f64 / (a.len() / 3) as f64
}

/// Cases that are hard on rays or cells, each with a camera.
fn cases() -> Vec<(&'static str, Arc<Scene>, Camera)> {
    let far = DVec3::new(1e6, -2e6, 3e6);
    let inside = |at: DVec3, target: DVec3| Camera { fov_deg: 90.0, ..Camera::look_at(at, target) };
    let corner = DVec3::splat(-2.0);
    let room = view_of_room(DVec3::ZERO);
    vec![
        ("cornell", box_of_cornell(DVec3::ZERO), room),
        ("far", box_of_cornell(far), view_of_room(far)),
        ("thin walls", closed_box(DVec3::ZERO), inside(corner * 0.8, corner)),
        ("outside of thin walls", closed_box(DVec3::ZERO), inside(DVec3::new(3.0, -1.0, 3.5), DVec3::ZERO)),
        ("open room", open_room(0.6, even_sky(1.0)), room),
        ("no albedo", open_room(0.0, even_sky(1.0)), room),
        ("black sky", open_room(0.6, Sky::BLACK), room),
        ("nothing seen", open_room(0.6, even_sky(1.0)), inside(DVec3::Z * 9.0, DVec3::Z * 99.0)),
        ("every kind of surface", Arc::new(scene_with_lights()), Camera::look_at(CAMERA.0, CAMERA.1)),
    ]
}

#[test]
fn cells_that_the_device_looks_up_give_the_light_of_those_that_the_cpu_looks_up() {
    for (name, scene, camera) in cases() {
        let [mut by_cpu, mut on_device] =
            [LightTracer::Cpu, LightTracer::Device].map(|tracer| with_cells(&scene, tracer));
        for (size, rays) in [([96, 72], 16), ([96, 72], 64), ([24, 18], 16)] {
            let view = job(camera, size, cells(rays));
            let [a, b] = [color(&mut by_cpu, &view), color(&mut on_device, &view)];
            let share = apart(&a, &b);
            println!("{name}, {size:?}, {rays} rays: {:.2}% of pixels differ", share * 100.0);
            assert!(share <= 0.01, "{name}, {size:?}, {rays} rays: {:.2}% of pixels differ", share * 100.0);
        }
    }
}

/// Of a light of interiors, cells keep the sky alone. What no cells describe casts rays of its own, which read leaves without light.
#[test]
fn a_light_of_interiors_from_cells_is_that_of_rays_on_the_device_and_on_the_cpu() {
    let scene = open_room(0.6, Sky { reach: Some(1.0), ..even_sky(1.0) });
    let of_sky = Indirect::Cells(CellSettings { rays: 64, ..CellSettings::of_sky() });
    let [mut by_cpu, mut on_device] =
        [LightTracer::Cpu, LightTracer::Device].map(|tracer| of(gpu(), &scene, of_sky, tracer));
    let view = |light| job(view_of_room(DVec3::ZERO), [96, 72], light);
    let [a, b] = [&mut by_cpu, &mut on_device].map(|sampler| color(sampler, &view(cells(64))));
    let share = apart(&a, &b);
    assert!(share <= 0.01, "{:.2}% of pixels differ", share * 100.0);
    for (name, sampler) in [("CPU", &mut by_cpu), ("device", &mut on_device)] {
        let [by_cells, by_rays] =
            [cells(64), Some(SurfaceLight::Rays)].map(|light| color(sampler, &view(light)));
        let far = by_cells.iter().zip(&by_rays).filter(|(a, b)| a.abs_diff(**b) > 12).count();
        assert!(by_cells != by_rays, "{name}: a view by cells is not one by rays");
        assert!(far * 50 < by_cells.len(), "{name}: {far} of {} bytes differ", by_cells.len());
    }
}

/// Nobody fills cells between them, as in a service that is never idle.
#[test]
fn views_that_follow_one_another_without_a_pause_come_to_be_lit_by_cells() {
    let scene = box_of_cornell(DVec3::ZERO);
    for tracer in [LightTracer::Cpu, LightTracer::Device] {
        let mut sampler = with_cells(&scene, tracer);
        let view = job(view_of_room(DVec3::ZERO), [320, 240], None);
        let is_lit = (0..200).position(|_| {
            matches!(direct(&mut sampler, &view).provenance.plan.light(), Some(SurfaceLight::Cells { .. }))
        });
        println!("{tracer:?}: by cells from view {is_lit:?} on");
        assert!(is_lit.is_some(), "{tracer:?}: {:?}", sampler.light_cells());
    }
}

#[test]
fn what_reflections_show_has_the_same_light_from_the_device_as_from_the_cpu() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.0));
    let without = SurfaceLight::Cells { rays: 16, reflected: false };
    for light in [cells(16), Some(without), Some(SurfaceLight::Rays), None] {
        let view = job(into_room(DVec3::ZERO), [64, 48], light);
        let view = ViewJob { reflections: probes_from(&scene, ProbeSource::Rays), ..view };
        let [a, b] = [LightTracer::Cpu, LightTracer::Device].map(|tracer| {
            let mut sampler = with_cells(&scene, tracer);
            let first = direct(&mut sampler, &view);
            fill(&mut sampler);
            [first, direct(&mut sampler, &view)]
        });
        for (at, (a, b)) in a.iter().zip(&b).enumerate() {
            let [of_a, of_b] = [a, b].map(|frame| frame.provenance.plan.light());
            // What an open view has before its cells are filled hangs on the time.
            if light.is_none() && at == 0 && of_a != of_b {
                continue;
            }
            assert_eq!(of_a, of_b);
            let share =
                apart(a.images[Output::Color].as_ref().unwrap(), b.images[Output::Color].as_ref().unwrap());
            println!("{light:?}, {:?}: {:.2}% of pixels differ", a.provenance.plan.light(), share * 100.0);
            assert!(share <= 0.01, "{light:?}: {:.2}% of pixels differ", share * 100.0);
        }
    }
}

/// Thousands of them, which is when the device traces: a mirror in a mirror, glass, and a mirror far from the origin.
#[test]
fn reflected_rays_of_the_device_show_what_those_of_the_cpu_do() {
    let glass = Material { transmission: 0.9, roughness: 0.0, ..grey(0.95) };
    let far = DVec3::new(1e6, -2e6, 3e6);
    let (balls, beside) = room_with_two_balls();
    for (name, scene, camera) in [
        ("two balls", balls, beside),
        ("glass", room_with_a_ball(DVec3::ZERO, glass), into_room(DVec3::ZERO)),
        ("far", room_with_a_ball(far, chrome(0.0)), into_room(far)),
    ] {
        let view = ViewJob {
            reflections: probes_from(&scene, ProbeSource::Rays),
            ..job(camera, [320, 240], Some(SurfaceLight::Rays))
        };
        let [a, b] = [LightTracer::Cpu, LightTracer::Device]
            .map(|tracer| direct(&mut of(gpu(), &scene, Indirect::Off, tracer), &view));
        let traced = |frame: &argus_scene::Frame| {
            frame.stages.iter().any(|stage| stage.name.contains("trace reflected rays"))
        };
        assert!(!traced(&a) && (traced(&b) || !gpu().has_timestamps()), "{name}: {:?}", b.stages);
        let share =
            apart(a.images[Output::Color].as_ref().unwrap(), b.images[Output::Color].as_ref().unwrap());
        println!("{name}: {:.2}% of pixels differ", share * 100.0);
        assert!(share <= 0.01, "{name}: {:.2}% of pixels differ", share * 100.0);
    }
}

#[test]
fn gathered_light_of_the_device_is_that_of_the_cpu() {
    let paths = Indirect::Paths(PathSettings { level: 5, ..PathSettings::default() });
    for (name, scene, camera) in cases() {
        // Also a tile with an odd width, and one smaller than a filter.
        for size in [[97, 72], [5, 3]] {
            let [a, b] = [LightTracer::Cpu, LightTracer::Device]
                .map(|tracer| color(&mut of(gpu(), &scene, paths, tracer), &job(camera, size, None)));
            let share = apart(&a, &b);
            println!("{name}, {size:?}: {:.2}% of pixels differ", share * 100.0);
            assert!(share <= 0.01, "{name}, {size:?}: {:.2}% of pixels differ", share * 100.0);
        }
    }
}

#[test]
fn equal_plans_give_equal_bytes_on_the_device_whatever_was_looked_up_before() {
    let scene = open_room(0.6, even_sky(1.0));
    let view = |rays| job(view_of_room(DVec3::ZERO), [64, 48], cells(rays));
    let mut fresh = with_cells(&scene, LightTracer::Device);
    let wanted = [16, 64].map(|rays| color(&mut fresh, &view(rays)));
    assert!(wanted[0] != wanted[1]);
    let mut sampler = with_cells(&scene, LightTracer::Device);
    for (at, light) in [(1.0, None), (0.5, cells(64)), (-0.5, None)] {
        let camera = Camera { fov_deg: 80.0, ..Camera::look_at(DVec3::new(at, 0.0, 1.5), DVec3::NEG_Y) };
        direct(&mut sampler, &job(camera, [40, 30], light));
        fill(&mut sampler);
    }
    for (rays, wanted) in [16, 64].into_iter().zip(&wanted) {
        assert!(color(&mut sampler, &view(rays)) == *wanted, "{rays} rays");
    }
}

#[test]
fn an_open_view_on_the_device_rises_step_by_step_and_says_what_lit_it() {
    let scene = box_of_cornell(DVec3::ZERO);
    let mut sampler = with_cells(&scene, LightTracer::Device);
    let open = job(view_of_room(DVec3::ZERO), [320, 240], None);
    let light = |sampler: &mut GpuSampler| direct(sampler, &open).provenance.plan.light();
    assert_eq!(light(&mut sampler), Some(SurfaceLight::Rays));
    assert!(sampler.light_cells().unwrap().waiting > 0);
    let rises = (0..8).any(|_| {
        fill(&mut sampler);
        light(&mut sampler) == cells(64)
    });
    assert!(rises, "{:?}", sampler.light_cells());
    // Elsewhere cells lack, although they were whole here.
    let aside =
        Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(-0.3, 0.6, 1.0), DVec3::new(1.0, 1.9, 1.9)) };
    assert_eq!(
        direct(&mut sampler, &job(aside, [320, 240], None)).provenance.plan.light(),
        Some(SurfaceLight::Rays)
    );
}

#[test]
fn a_view_with_all_light_on_the_device_is_one_submission_that_is_waited_for_once() {
    let scene = open_room(0.6, even_sky(1.0));
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let view = job(view_of_room(DVec3::ZERO), [96, 72], None);
    let paths = Indirect::Paths(PathSettings { level: 5, ..PathSettings::default() });
    for indirect in [Indirect::Off, paths, Indirect::Cells(settings())] {
        let mut sampler = of(Arc::clone(&gpu), &scene, indirect, LightTracer::Device);
        for _ in 0..8 {
            direct(&mut sampler, &view);
            fill(&mut sampler);
        }
        direct(&mut sampler, &view);
        let before = gpu.traffic();
        let frame = direct(&mut sampler, &view);
        let after = gpu.traffic();
        let counted = [0, 1].map(|i| after[i] - before[i]);
        println!("{indirect}: {counted:?}, {:?}, {:?}", frame.provenance.plan.light(), frame.stages);
        assert_eq!(counted, [1, 1], "{indirect}: submissions, and waits");
        if let Indirect::Cells(_) = indirect {
            assert_eq!(frame.provenance.plan.light(), cells(64));
        }
    }
}
