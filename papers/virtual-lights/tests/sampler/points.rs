//! Indirect light by points, against what is known exactly and against the path-traced reference.

use std::sync::Arc;

use argus_sampler::{Indirect, PointSettings, SamplerSettings};
use argus_scene::{Camera, Light, MegaViews, Output, SampleJob, SampleSetInfo, Sampling, Scene};
use argus_virtual_lights::point_report;
use glam::{DAffine3, DVec3, Vec3};

use crate::common::*;
use crate::rooms::*;

fn settings(points: PointSettings) -> SamplerSettings {
    SamplerSettings { sub_samples: 1, indirect: Indirect::Points(points), ..SamplerSettings::default() }
}

/// Enough for rooms of four metres.
fn fine() -> PointSettings {
    PointSettings { levels: 5, ..PointSettings::default() }
}

#[test]
fn in_a_furnace_everything_looks_alike_as_bright_as_the_series_says() {
    let scene = furnace();
    let camera = Camera { fov_deg: 60.0, ..Camera::look_at(DVec3::ZERO, DVec3::NEG_Z) };
    for (bounces, sharing) in [(1, true), (3, true), (3, false)] {
        let mut sampler = sampler_with(&scene, settings(PointSettings { bounces, sharing, ..fine() }));
        let image = image_of(&direct(&mut sampler, &view_job(camera, [24, 24], 4)));
        // Emission, and what was reflected once more than there are reflections before.
        let series: f32 = (0..=bounces as i32 + 1).map(|k| 0.5f32.powi(k)).sum();
        let truth = argus_scene::tone::display_from_radiance(Vec3::splat(0.1 * series), 1.0)[0];
        let [least, most] = [image.iter().min(), image.iter().max()].map(|byte| *byte.expect("has pixels"));
        assert!(truth.abs_diff(least) <= 2 && truth.abs_diff(most) <= 2, "{least} to {most}, not {truth}");
    }
}

#[test]
fn a_room_lit_by_points_looks_like_the_path_traced_one_wherever_it_stands() {
    for (offset, name) in [(DVec3::ZERO, "near"), (DVec3::new(1e6, -2e6, 3e6), "far")] {
        let scene = box_of_cornell(offset);
        let camera = view_of_room(offset);
        let truth = path_traced(&scene, &camera, [64, 64], 2).display(1.0);
        let flip_of = |indirect, what: &str| {
            let settings = SamplerSettings { indirect, ..SamplerSettings::default() };
            let image =
                image_of(&direct(&mut sampler_with(&scene, settings), &view_job(camera, [64, 64], 4)));
            flip(&format!("points-{name}-{what}"), &image, &truth)
        };
        let without = flip_of(Indirect::Off, "off");
        for (sharing, what) in [(true, "shared"), (false, "alone")] {
            let with = flip_of(Indirect::Points(PointSettings { bounces: 2, sharing, ..fine() }), what);
            assert!(with < 0.09 && with < 0.5 * without, "{name}, {what}: {with} with, {without} without");
        }
    }
}

#[test]
fn blocks_that_see_two_surfaces_light_each_by_its_own() {
    // The block stands before the walls, and each of its sides is lit by other ones.
    let scene = box_of_cornell(DVec3::ZERO);
    let job = view_job(view_of_room(DVec3::ZERO), [64, 64], 4);
    let render = |block| {
        image_of(&direct(&mut sampler_with(&scene, settings(PointSettings { block, ..fine() })), &job))
    };
    let each = render(1);
    for (block, most) in [(4, 0.03), (8, 0.04), (16, 0.06)] {
        let found = flip(&format!("points-block-{block}"), &render(block), &each);
        assert!(found < most, "{found} with blocks of {block}");
    }
}

#[test]
fn the_same_settings_give_the_same_bytes_whatever_was_rendered_before() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = view_job(view_of_room(DVec3::ZERO), [40, 30], 1);
    let other = view_job(Camera::look_at(DVec3::ZERO, DVec3::X), [64, 64], 4);
    let once = direct(&mut sampler_with(&scene, settings(fine())), &job);
    let mut again = sampler_with(&scene, settings(fine()));
    direct(&mut again, &other);
    assert_eq!(direct(&mut again, &job).images[Output::Color], once.images[Output::Color]);
    let report = point_report(&again).expect("it was lit");
    assert!(report.leaves > 1000 && report.receivers >= 20 && report.map_bytes > 0, "{report:?}");
    again.set_indirect(Indirect::Points(PointSettings { levels: 4, ..fine() })).unwrap();
    assert_ne!(direct(&mut again, &job).images[Output::Color], once.images[Output::Color]);
    again.set_indirect(Indirect::Points(fine())).unwrap();
    assert_eq!(
        direct(&mut again, &job).images[Output::Color],
        once.images[Output::Color],
        "settings that come back"
    );
    let refused = again.set_indirect(Indirect::Off).unwrap_err();
    assert!(refused.to_string().contains("indirect"), "{refused}");
    let row = again.plan().into_iter().find(|row| row.name == "receive light").expect("the plan names it");
    assert!(row.on && row.why.contains("5 levels"), "{row:?}");
}

#[test]
fn pixels_of_a_list_look_like_those_of_the_view() {
    let scene = box_of_cornell(DVec3::ZERO);
    let off = off_in_a_list(&mut sampler_with(&scene, settings(fine())), 4);
    assert!(off < 4.0, "{off}");
}

#[test]
fn samples_from_triangles_and_from_maps_hold_the_light() {
    let scene = box_of_cornell(DVec3::ZERO);
    let job = job_around_origin(&scene, 24);
    let mapped = Sampling::MegaViews(MegaViews { map_side: 64, levels: 6, block: 1 });
    let info = SampleSetInfo { sampling: mapped, ..(*job.info).clone() };
    let from_maps = SampleJob { info: info.into(), ..job.clone() };
    let mean = |settings, job: &SampleJob| mean_radiance(&mut sampler_with(&scene, settings), job);
    let off = SamplerSettings { sub_samples: 1, ..SamplerSettings::default() };
    let without = mean(off, &job);
    let with = mean(settings(fine()), &job);
    assert!(with.cmpgt(without * 1.05).all(), "{with} {without}");
    let of_maps = mean(settings(fine()), &from_maps);
    assert!((of_maps / with - 1.0).abs().max_element() < 0.1, "{of_maps} from maps, {with} from triangles");
}

#[test]
fn scenes_with_nothing_to_light_or_to_light_with_render_as_without() {
    let job = view_job(view_of_room(DVec3::ZERO), [16, 16], 1);
    let empty = Arc::new(empty_scene());
    let mut dark = Scene::clone(&box_of_cornell(DVec3::ZERO));
    dark.lighting = lit_by(Vec::new());
    let plain = direct(&mut sampler(&empty), &job).images[Output::Color].clone();
    assert_eq!(direct(&mut sampler_with(&empty, settings(fine())), &job).images[Output::Color], plain);
    let frame = direct(&mut sampler_with(&Arc::new(dark), settings(fine())), &job);
    assert!(frame.images[Output::Color].clone().expect("asked for").iter().all(|&byte| byte == 0));
}

#[test]
fn lights_do_not_shine_through_walls_onto_what_reflects() {
    // Two rooms side by side, the light in one of them: nothing reaches the other.
    let mut scene = empty_scene();
    scene.materials = vec![grey(0.7)];
    add_room(&mut scene, DVec3::ZERO, [0; 6]);
    add_room(&mut scene, DVec3::new(4.5, 0.0, 0.0), [0; 6]);
    let light =
        Light::Point { position: DVec3::ZERO, intensity: Vec3::splat(4.0), range: Some(3.0), radius: 0.0 };
    scene.lighting = lit_by(vec![light]);
    let scene = Arc::new(scene);
    let there = DVec3::new(4.5, 0.0, 0.0);
    let look = |eye: DVec3| view_job(Camera::look_at(eye + DVec3::Z, eye - DVec3::Z), [24, 24], 1);
    let brightness = |settings, job| {
        let image = image_of(&direct(&mut sampler_with(&scene, settings), &job));
        image.iter().map(|&byte| u32::from(byte)).sum::<u32>()
    };
    let off = SamplerSettings { sub_samples: 1, ..SamplerSettings::default() };
    assert!(brightness(settings(fine()), look(DVec3::ZERO)) > brightness(off, look(DVec3::ZERO)));
    assert_eq!(brightness(settings(fine()), look(there)), brightness(off, look(there)));
}

#[test]
fn mirrored_instances_and_triangles_without_area_are_lit_like_others() {
    let plain = box_of_cornell(DVec3::ZERO);
    let mut odd = Scene::clone(&plain);
    // The same room through a mirror, and a mesh of nothing.
    for instance in &mut odd.instances {
        instance.world_from_mesh =
            DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)) * instance.world_from_mesh;
    }
    let nothing = quad(Vec3::ZERO, Vec3::ZERO, Vec3::Y, 1.0, 0);
    place(&mut odd, nothing, DAffine3::IDENTITY);
    let size = [32u32, 32];
    let straight = Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(0.0, 0.0, 1.9), DVec3::ZERO) };
    let render = |scene: &Arc<Scene>| {
        image_of(&direct(&mut sampler_with(scene, settings(fine())), &view_job(straight, size, 4)))
    };
    let (truth, mirrored) = (render(&plain), render(&Arc::new(odd)));
    let found = flip("points-mirrored", &image::imageops::flip_horizontal(&mirrored), &truth);
    // Cells and blocks are not the mirror images of one another.
    assert!(found < 0.05, "{found}");
}
