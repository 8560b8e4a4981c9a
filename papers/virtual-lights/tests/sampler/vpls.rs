//! Indirect light on the device, against what is known exactly and against the path-traced reference.

use std::sync::Arc;

use argus_sampler::{GpuSampler, Indirect, MapSource, SamplerSettings, VplSettings};
use argus_scene::{Camera, Cancel, Light, Output, Sampler as _, Scene, ViewJob};
use argus_virtual_lights::vpl_report;
use glam::{DVec3, Vec3};

use crate::common::*;
use crate::rooms::*;

fn settings(vpl: VplSettings) -> SamplerSettings {
    SamplerSettings { sub_samples: 1, indirect: Indirect::Vpl(vpl), ..SamplerSettings::default() }
}

#[test]
fn in_a_furnace_everything_looks_alike_as_bright_as_the_series_says() {
    let scene = furnace();
    // Without maps nothing is hidden in a convex room, and all of the VPLs are gathered.
    let all = VplSettings {
        vpls: 4000,
        bounces: 4,
        samples: 1 << 16,
        maps: MapSource::Unshadowed,
        clamp: 0.0,
        filter: 0,
        ..VplSettings::default()
    };
    let camera = Camera { fov_deg: 60.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
    // Emission, then 0.5 of it reflected, up to four times behind the first surface.
    let series: f32 = (0..=5).map(|k| 0.5f32.powi(k)).sum();
    let truth = argus_scene::tone::display_from_radiance(Vec3::splat(0.1 * series), 1.0)[0];
    for (maps, samples) in [(MapSource::Unshadowed, 1 << 16), (MapSource::Exact, 256)] {
        let mut sampler = sampler_with(&scene, settings(VplSettings { maps, samples, ..all }));
        let image = image_of(&direct(&mut sampler, &view_job(camera, [24, 24], 4)));
        let mean = image.iter().map(|&b| f64::from(b)).sum::<f64>() / image.len() as f64;
        assert!((mean - f64::from(truth)).abs() < 4.0, "{maps:?}: {mean}, not {truth}");
    }
}

#[test]
fn a_room_lit_by_vpls_looks_like_the_path_traced_one_wherever_it_stands() {
    for (offset, name) in [(DVec3::ZERO, "near"), (DVec3::new(1e6, -2e6, 3e6), "far")] {
        let scene = box_of_cornell(offset);
        let camera = view_of_room(offset);
        let truth = path_traced(&scene, &camera, [64, 64], 2).display(1.0);
        let vpl = VplSettings { vpls: 2000, bounces: 2, samples: 32, map_side: 32, ..VplSettings::default() };
        let flip_of = |indirect, what: &str| {
            let settings = SamplerSettings { indirect, ..SamplerSettings::default() };
            let image =
                image_of(&direct(&mut sampler_with(&scene, settings), &view_job(camera, [64, 64], 4)));
            flip(&format!("indirect-{name}-{what}"), &image, &truth)
        };
        let (with, without) = (flip_of(Indirect::Vpl(vpl), "exact"), flip_of(Indirect::Off, "off"));
        assert!(with < 0.08 && with < 0.5 * without, "{name}: {with} with, {without} without");
        for (maps, most) in
            [(MapSource::Imperfect, 0.16), (MapSource::MegaViews, 0.12), (MapSource::ManyLods, 0.12)]
        {
            let found = flip_of(Indirect::Vpl(VplSettings { maps, levels: 7, ..vpl }), maps.name());
            assert!(found < most && found < 0.5 * without, "{name}: {found} by {maps:?} maps");
        }
    }
}

#[test]
fn culling_leaves_out_no_vpl_that_lights_anything() {
    let scene = box_of_cornell(DVec3::ZERO);
    let every = VplSettings { vpls: 3000, bounces: 3, samples: 1 << 16, filter: 0, ..VplSettings::default() };
    let cutoff = 0.3;
    for base in [every, VplSettings { cutoff, ..every }] {
        let render = |cull| {
            let mut sampler = sampler_with(&scene, settings(VplSettings { cull, ..base }));
            let job = view_job(view_of_room(DVec3::ZERO), [48, 48], 4);
            let image = image_of(&direct(&mut sampler, &job));
            (image, vpl_report(&sampler).unwrap().expect("it was lit"))
        };
        let ((culled, report), (whole, none)) = (render(true), render(false));
        assert!(report.culled > 0.005, "{report:?}");
        assert!(none.culled.abs() < 1e-9);
        // The order of summation differs by rounding alone.
        let most = culled.iter().zip(whole.iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(most <= Some(1), "{most:?} at a cut-off of {}", base.cutoff);
    }
}

#[test]
fn groups_that_are_drawn_stand_for_those_that_are_left_out() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = job_around_origin(&scene, 64);
    // Of radiance, which nothing cuts off at white.
    let mean = |sampler: &mut GpuSampler| mean_radiance(sampler, &job).element_sum();
    let plain =
        mean(&mut sampler_with(&scene, SamplerSettings { sub_samples: 1, ..SamplerSettings::default() }));
    for (samples, filter) in [(1 << 16, 0), (64, 4)] {
        let light = |groups, cull| {
            let maps = MapSource::Unshadowed;
            let vpl =
                VplSettings { vpls: 1000, maps, samples, filter, groups, cull, ..VplSettings::default() };
            let mut sampler = sampler_with(&scene, settings(vpl));
            let mean = mean(&mut sampler) - plain;
            (mean, vpl_report(&sampler).unwrap().expect("it was lit").culled)
        };
        let (all, few_left_out) = light(0, true);
        assert!(all > 0.0 && few_left_out < 0.5, "{all} {few_left_out}");
        for cull in [true, false] {
            let (some, left_out) = light(32, cull);
            assert!((0.85..=0.9).contains(&left_out), "{left_out}");
            assert!((some / all - 1.0).abs() < 0.02, "{} of the light, {samples} samples", some / all);
        }
        // As many as there are is all of them.
        assert!((light(256, true).0 / all - 1.0).abs() < 1e-6);
    }
}

#[test]
fn drawing_some_vpls_and_filtering_comes_close_to_drawing_all() {
    let scene = box_of_cornell(DVec3::ZERO);
    let vpl = VplSettings { vpls: 2000, maps: MapSource::Unshadowed, ..VplSettings::default() };
    let render = |samples, filter| {
        let mut sampler = sampler_with(&scene, settings(VplSettings { samples, filter, ..vpl }));
        image_of(&direct(&mut sampler, &view_job(view_of_room(DVec3::ZERO), [64, 64], 4)))
    };
    let all = render(1 << 16, 0);
    let (noisy, smooth) = (render(16, 0), render(16, 4));
    let of = |image| flip("indirect-some", image, &all);
    assert!(of(&smooth) < 0.06 && of(&smooth) < of(&noisy), "{} {}", of(&smooth), of(&noisy));
}

#[test]
fn the_same_settings_give_the_same_bytes_and_off_costs_nothing() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = view_job(view_of_room(DVec3::ZERO), [40, 30], 1);
    let vpl = settings(VplSettings { vpls: 500, maps: MapSource::Imperfect, ..VplSettings::default() });
    let once = direct(&mut sampler_with(&scene, vpl), &job);
    let mut again = sampler_with(&scene, vpl);
    assert_eq!(direct(&mut again, &job).images[Output::Color], once.images[Output::Color]);
    assert_eq!(
        direct(&mut again, &job).images[Output::Color],
        once.images[Output::Color],
        "nor does it matter what was rendered before"
    );
    let mut off = sampler(&scene);
    let plain = direct(&mut off, &job);
    assert_ne!(plain.images[Output::Color], once.images[Output::Color]);
    assert!(plain.stages.iter().all(|stage| !stage.name.contains("VPL")));
    assert_eq!(vpl_report(&off).unwrap(), None);
    let row = |sampler: &GpuSampler| {
        sampler.plan().into_iter().find(|row| row.name == "gather VPLs").expect("the plan names it")
    };
    assert!(row(&again).on && !row(&off).on);
    assert!(row(&off).why.contains("not asked for"));
}

#[test]
fn samples_hold_the_light_that_direct_views_show() {
    let scene = box_of_cornell(DVec3::ZERO);
    let vpl = VplSettings { vpls: 1000, samples: 32, ..VplSettings::default() };
    let job = job_around_origin(&scene, 24);
    let mean = |settings| mean_radiance(&mut sampler_with(&scene, settings), &job);
    let (with, without) =
        (mean(settings(vpl)), mean(SamplerSettings { sub_samples: 1, ..SamplerSettings::default() }));
    assert!(with.cmpgt(without * 1.05).all(), "{with} {without}");
    assert!(with.is_finite());
}

#[test]
fn pixels_of_a_list_look_like_those_of_the_view() {
    let scene = box_of_cornell(DVec3::ZERO);
    let vpl = VplSettings { vpls: 2000, samples: 8, maps: MapSource::Unshadowed, ..VplSettings::default() };
    let off = off_in_a_list(&mut sampler_with(&scene, settings(vpl)), 1);
    assert!(off < 4.0, "{off}");
}

#[test]
fn scenes_with_nothing_to_light_or_to_light_with_render_as_without() {
    let job = view_job(view_of_room(DVec3::ZERO), [16, 16], 1);
    let empty = Arc::new(empty_scene());
    let mut dark = Scene::clone(&box_of_cornell(DVec3::ZERO));
    dark.lighting = lit_by(Vec::new());
    let dark = Arc::new(dark);
    for maps in MapSource::ALL {
        let vpl = settings(VplSettings { vpls: 64, maps, levels: 4, ..VplSettings::default() });
        let plain = direct(&mut sampler(&empty), &job).images[Output::Color].clone();
        assert_eq!(direct(&mut sampler_with(&empty, vpl), &job).images[Output::Color], plain, "{maps:?}");
        let frame = direct(&mut sampler_with(&dark, vpl), &job);
        assert!(frame.images[Output::Color].clone().expect("asked for").iter().all(|&b| b == 0), "{maps:?}");
    }
}

#[test]
fn maps_that_do_not_fit_are_refused_by_name_and_so_are_settings() {
    let scene = box_of_cornell(DVec3::ZERO);
    let large = settings(VplSettings { vpls: 1 << 15, map_side: 256, ..VplSettings::default() });
    let job = view_job(view_of_room(DVec3::ZERO), [16, 16], 1);
    let error = sampler_with(&scene, large).render_views(&[job], &Cancel::new()).remove(0).unwrap_err();
    assert!(error.to_string().contains("maps of 32768 VPLs"), "{error}");
    let bad = settings(VplSettings { bounces: 9, ..VplSettings::default() });
    let refused = GpuSampler::with_methods(gpu(), scene, bad, crate::methods()).err().expect("refused");
    assert!(refused.to_string().contains("indirect.bounces"), "{refused}");
}

/// Particles alone, all of them gathered.
fn particles(count: u32, maps: MapSource) -> VplSettings {
    VplSettings {
        vpls: 0,
        particles: count,
        samples: 1 << 16,
        filter: 0,
        clamp: 0.0,
        map_side: 64,
        maps,
        levels: 7,
        ..VplSettings::default()
    }
}

#[test]
fn particles_without_shadows_light_as_point_lights_do_wherever_the_room_stands() {
    for offset in [DVec3::ZERO, DVec3::new(1e6, -2e6, 3e6)] {
        let mut dark = (*box_of_cornell(offset)).clone();
        dark.lighting.lights.clear();
        dark.materials.iter_mut().for_each(|material| material.emissive = Vec3::ZERO);
        let mut lit = dark.clone();
        let all = argus_scene::particles::glowing(&dark.bounds(), 24, VplSettings::default().seed, 2.5);
        let light = |p: &argus_scene::particles::Particle| Light::Point {
            position: p.position,
            intensity: p.flux / (4.0 * std::f32::consts::PI),
            range: None,
            radius: 0.0,
        };
        lit.lighting.lights = all.iter().map(light).collect();
        let job = ViewJob { time_secs: 2.5, ..view_job(view_of_room(offset), [48, 48], 1) };
        let with = settings(particles(24, MapSource::Unshadowed));
        let ours = image_of(&direct(&mut sampler_with(&Arc::new(dark), with), &job));
        let truth = image_of(&direct(&mut sampler(&Arc::new(lit)), &job));
        let off = ours.iter().zip(truth.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(off <= 2, "{off} of 255");
        assert!(truth.iter().any(|&byte| byte > 60), "something is lit");
    }
}

#[test]
fn particles_drift_with_time_and_their_shadows_are_alike_by_all_kinds_of_maps() {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    scene.lighting.lights.clear();
    scene.materials.iter_mut().for_each(|material| material.emissive = Vec3::ZERO);
    let scene = Arc::new(scene);
    let render = |maps, time_secs: f64| {
        let job = ViewJob { time_secs, ..view_job(view_of_room(DVec3::ZERO), [48, 48], 1) };
        image_of(&direct(&mut sampler_with(&scene, settings(particles(60, maps))), &job))
    };
    let exact = render(MapSource::Exact, 1.0);
    assert_eq!(exact, render(MapSource::Exact, 1.0), "the same moment looks the same");
    assert_ne!(exact, render(MapSource::Exact, 1.4), "they move");
    let unshadowed = render(MapSource::Unshadowed, 1.0);
    let without = flip("particles-unshadowed", &unshadowed, &exact);
    for maps in [MapSource::MegaViews, MapSource::ManyLods] {
        let with = flip(&format!("particles-{}", maps.name()), &render(maps, 1.0), &exact);
        assert!(with < 0.1 && with < 0.7 * without, "{with} by {maps:?} maps, {without} without shadows");
    }
}
