//! What glossy and transparent things show of the scene around them by probes from an octree, against rays.

use std::sync::Arc;

use argus_scene::procedural::mirrors;
use argus_scene::reflection::{level_sides, map_size};
use argus_scene::{
    Camera, Cancel, Material, PixelJob, PlaneKind, ProbeSource, ReflectionProbeSet, SampleId, SampleJob,
    SampleSetInfo, Sampler as _, Scene, SceneState, Version, ViewJob,
};
use glam::{DVec3, Vec3};

use crate::common::*;
use crate::reflecting::*;
use crate::rooms::grey;

fn maps(scene: &Scene) -> Option<ReflectionProbeSet> {
    probes_from(scene, ProbeSource::Octree { levels: 7 })
}

/// FLIP of a direct view with maps, and of one without, against rays; and what the first shows.
fn judged(name: &str, scene: &Arc<Scene>, camera: Camera, time_secs: f64) -> (f64, f64, Vec<u8>) {
    judged_with(name, maps(scene), scene, camera, time_secs)
}

#[test]
fn reflectors_show_the_room_and_each_other_after_they_moved() {
    let scene = Arc::new(mirrors(7));
    let camera = scene.cameras[0].camera;
    for (name, time_secs) in [("mirrors", 0.0), ("mirrors-moved", 2.0)] {
        let (with, without, _) = judged(name, &scene, camera, time_secs);
        assert!(with < 0.06 && with < 0.55 * without, "{name}: FLIP {with} with maps, {without} without");
    }
}

#[test]
fn smooth_rough_and_glass_balls_show_what_rays_show() {
    let glass = Material { transmission: 0.9, roughness: 0.0, ..grey(0.95) };
    for (name, material) in [("chrome", chrome(0.0)), ("brushed", chrome(0.35)), ("glass", glass)] {
        let scene = room_with_a_ball(DVec3::ZERO, material);
        let (with, without, _) = judged(name, &scene, into_room(DVec3::ZERO), 0.0);
        assert!(with < 0.06 && with < 0.6 * without, "{name}: FLIP {with} with maps, {without} without");
    }
}

#[test]
fn reflections_are_the_same_a_million_metres_away() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let [near, moved] = [DVec3::ZERO, far].map(|center| {
        let scene = room_with_a_ball(center, chrome(0.0));
        let (flip, _, image) = judged("chrome-far", &scene, into_room(center), 0.0);
        (flip, image)
    });
    assert!((near.0 - moved.0).abs() < 0.01, "{} and {}", near.0, moved.0);
    let apart = near.1.iter().zip(&moved.1).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    assert!(apart * 50 < near.1.len(), "{apart} of {} bytes differ", near.1.len());
}

#[test]
fn a_reflector_is_culled_from_its_own_probe_and_walls_have_their_range() {
    let scene = room_with_a_ball(DVec3::new(5.0, 0.0, 0.0), chrome(0.0));
    let maps = maps(&scene).unwrap();
    assert_eq!(maps.count, 1);
    let found = sample(&mut sampler(&scene), &probes_of(&scene, Some(maps)));
    let [columns, rows] = map_size(maps.settings.side);
    assert_eq!(found.camera.size(), [columns, rows]);
    let ranges = floats(&host_bytes(&found, PlaneKind::InverseRange));
    // Of the finest level, which comes first.
    let finest = &ranges[..(columns * columns) as usize];
    for &inverse in finest {
        let range = 1.0 / inverse;
        assert!(
            (1.8..3.7).contains(&range),
            "the ball has a radius of 0.7, walls are 2 to 3.5 away: {range}"
        );
    }
    let place = floats(&host_bytes(&found, PlaneKind::ProbeSphere));
    assert!(
        Vec3::new(place[0], place[1], place[2]).length() < 1e-6 && (place[3] - 1.2).abs() < 0.1,
        "{place:?}"
    );
}

#[test]
fn levels_of_a_probe_blur_and_keep_its_light() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.0));
    let maps = maps(&scene).unwrap();
    let found = sample(&mut sampler(&scene), &probes_of(&scene, Some(maps)));
    let radiance = radiance_of(&found);
    let columns = map_size(maps.settings.side)[0] as usize;
    let mut row = 1;
    let mut means = Vec::new();
    for side in level_sides(maps.settings.side).map(|side| side as usize) {
        let texels = (0..side * side).map(|i| radiance[(row + i / side) * columns + 1 + i % side]);
        means.push(texels.sum::<Vec3>() / (side * side) as f32);
        row += side + 2;
    }
    for mean in &means {
        assert!((*mean - means[0]).abs().max_element() < 0.15 * means[0].max_element(), "{means:?}");
    }
}

#[test]
fn pixels_of_a_list_and_samples_asked_for_again_are_the_same() {
    let scene = Arc::new(mirrors(5));
    let job = ViewJob { reflections: maps(&scene), ..view_job(scene.cameras[1].camera, [64, 48], 4) };
    let mut sampler = sampler(&scene);
    let whole = image_of(&direct(&mut sampler, &job)).into_raw();
    let wanted = PixelJob {
        camera: job.camera,
        width: job.width,
        height: job.height,
        pixels: (0..64 * 48).step_by(5).collect(),
        samples_per_pixel: 4,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections: job.reflections,
    };
    let pixels = wanted.pixels.clone();
    let some = sampler.render_pixels(&[wanted], &Cancel::new()).remove(0).unwrap();
    let same = |(i, &p): (usize, &u32)| some.color[3 * i..3 * i + 3] == whole[3 * p as usize..][..3];
    let apart = pixels.iter().enumerate().filter(|&at| !same(at)).count();
    assert!(apart * 50 <= pixels.len(), "{apart} of {} differ: only edges may", pixels.len());

    let order = probes_of(&scene, maps(&scene));
    let planes = [PlaneKind::Radiance, PlaneKind::InverseRange, PlaneKind::ProbeSphere];
    let again = [&mut sampler, &mut crate::common::sampler(&scene)]
        .map(|sampler| planes.map(|kind| host_bytes(&sample(sampler, &order), kind)));
    assert_eq!(again[0], again[1], "whatever was rendered before");
}

#[test]
fn probes_of_a_time_do_not_depend_on_earlier_times() {
    let scene = Arc::new(mirrors(5));
    let at = |epoch| {
        let job = probes_of(&scene, maps(&scene));
        let info = SampleSetInfo { epoch_secs: 0.5, ..(*job.info).clone() }
            .at_version(&scene, Version::of_epoch(epoch, epoch));
        let ids = job.ids.iter().map(|id| SampleId { version: epoch, ..*id }).collect();
        SampleJob { info: Arc::new(info), ids, ..job }
    };
    let mut moving = sampler(&scene);
    let planes = [PlaneKind::Radiance, PlaneKind::InverseRange, PlaneKind::ProbeSphere];
    let [before, moved] =
        [0, 5].map(|epoch| planes.map(|kind| host_bytes(&sample(&mut moving, &at(epoch)), kind)));
    assert_ne!(before, moved);
    let fresh = planes.map(|kind| host_bytes(&sample(&mut sampler(&scene), &at(5)), kind));
    assert_eq!(moved, fresh);
}
