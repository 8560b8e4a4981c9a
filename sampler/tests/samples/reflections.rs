//! What glossy and transparent things show of the scene around them, against rays.

use std::sync::Arc;

use argus_scene::procedural::mirrors;
use argus_scene::reference::{Reflecting, Tracer};
use argus_scene::reflection::{BOUNCES, level_sides, map_size};
use argus_scene::{
    Camera, Cancel, Material, PixelJob, PlaneKind, ProbeSource, ReflectionProbeSet, Reflections, RenderError,
    SampleId, SampleJob, SampleSetInfo, Sampler as _, Scene, SceneState, Version, ViewJob, rgb9e5,
};
use glam::{DAffine3, DVec3, Vec3};

use crate::common::*;
use crate::rooms::{add_room, grey, lit_by};

const SIZE: [u32; 2] = [160, 120];

fn maps(scene: &Scene) -> Option<ReflectionProbeSet> {
    probes_from(scene, ProbeSource::Octree { levels: 7 })
}

pub(crate) fn probes_from(scene: &Scene, source: ProbeSource) -> Option<ReflectionProbeSet> {
    let rig = omni_rig(scene.bounds().center(), 384);
    ReflectionProbeSet::of(scene, &rig, Reflections { source, ..Reflections::default() })
        .expect("the knobs are in range")
}

fn traced(scene: &Arc<Scene>, time_secs: f64) -> Tracer {
    let tracer = Tracer::new(Arc::clone(scene)).at(time_secs);
    tracer.reflecting(Reflecting { rays: 32, bounces: BOUNCES, instances: scene.reflectors(1024) })
}

/// FLIP of a direct view with maps, and of one without, against rays; and what the first shows.
fn judged(name: &str, scene: &Arc<Scene>, camera: Camera, time_secs: f64) -> (f64, f64, Vec<u8>) {
    judged_with(name, maps(scene), scene, camera, time_secs)
}

/// FLIP of a direct view with these probes, and of one without, against rays; and what the first shows.
pub(crate) fn judged_with(
    name: &str,
    probes: Option<ReflectionProbeSet>,
    scene: &Arc<Scene>,
    camera: Camera,
    time_secs: f64,
) -> (f64, f64, Vec<u8>) {
    let truth = traced(scene, time_secs).render(&camera, SIZE[0], SIZE[1], 4, |_| {});
    let truth = truth.display(scene.lighting.exposure);
    let plain = ViewJob { time_secs, state: SceneState::of_epoch(1), ..view_job(camera, SIZE, 4) };
    let mirrored = ViewJob { reflections: probes, ..plain.clone() };
    let mut sampler = sampler(scene);
    let [with, without] = [mirrored, plain].map(|job| image_of(&direct(&mut sampler, &job)));
    let (good, bad) = (flip(name, &with, &truth), flip(&format!("{name}-without"), &without, &truth));
    (good, bad, with.into_raw())
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

/// A room about `center` with a ball of a material in its middle.
fn room_with_a_ball(center: DVec3, material: Material) -> Arc<Scene> {
    let mut scene = empty_scene();
    let color = |c: Vec3| Material { base_color: c.extend(1.0), ..grey(0.5) };
    let walls = [color(Vec3::new(0.8, 0.1, 0.1)), color(Vec3::new(0.1, 0.7, 0.1)), grey(0.8)];
    scene.materials = [&walls[..], &[material]].concat();
    scene.lighting = lit_by(vec![argus_scene::Light::Point {
        position: center + DVec3::new(0.3, 1.5, 0.8),
        intensity: Vec3::splat(5.0),
        range: None,
        radius: 0.0,
    }]);
    add_room(&mut scene, center, [0, 1, 2, 2, 2, 2]);
    let placed = DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(0.7));
    place(&mut scene, ball(3, 24), placed);
    Arc::new(scene)
}

fn chrome(roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, ..grey(0.9) }
}

fn into_room(center: DVec3) -> Camera {
    Camera { fov_deg: 70.0, ..Camera::look_at(center + DVec3::new(0.2, 0.4, 1.9), center) }
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

fn probes_of(scene: &Arc<Scene>, reflections: Option<ReflectionProbeSet>) -> SampleJob {
    let job = sample_job(scene, omni_rig(scene.bounds().center(), 16), 0, true);
    let info = SampleSetInfo { reflections, ..(*job.info).clone() };
    let id = SampleId { camera: SampleId::REFLECTION_PROBES, ..job.ids[0] };
    SampleJob { info: Arc::new(info), ids: vec![id], ..job }
}

#[test]
fn a_reflector_is_culled_from_its_own_probe_and_walls_have_their_range() {
    let scene = room_with_a_ball(DVec3::new(5.0, 0.0, 0.0), chrome(0.0));
    let maps = maps(&scene).unwrap();
    assert_eq!(maps.count, 1);
    let found = sample(&mut sampler(&scene), &probes_of(&scene, Some(maps)));
    let [columns, rows] = map_size(maps.knobs.side);
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
    let columns = map_size(maps.knobs.side)[0] as usize;
    let mut row = 1;
    let mut means = Vec::new();
    for side in level_sides(maps.knobs.side).map(|side| side as usize) {
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

#[test]
fn a_reflector_plane_names_the_probe_of_each_surface() {
    let scene = Arc::new(mirrors(5));
    let eye = DVec3::new(0.0, 2.4, 3.5);
    let rig = omni_rig(eye, 64);
    let nearest = rig.nearest(&Camera::look_at(eye, DVec3::ZERO), 1)[0];
    let job = sample_job(&scene, rig, nearest, true);
    let plain = sample(&mut sampler(&scene), &job);
    assert!(plain.plane(PlaneKind::Reflector).is_none(), "simulated only where it is asked for");
    let info = SampleSetInfo { reflections: maps(&scene), ..(*job.info).clone() };
    let found = sample(&mut sampler(&scene), &SampleJob { info: Arc::new(info), ..job });
    let words = host_bytes(&found, PlaneKind::Reflector);
    let words: Vec<u32> = words.as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b)).collect();
    let mut seen: Vec<u32> = words.iter().map(|word| word & 2047).collect();
    seen.sort_unstable();
    seen.dedup();
    assert!(seen.len() > 2 && seen.iter().all(|&map| map <= 5), "{seen:?}");
    // Glass alone lets light through.
    let through = words.iter().filter(|&&word| word >> 11 != 0).map(|word| word & 2047);
    assert!(
        through.clone().count() > 0 && through.into_iter().all(|map| map == 3),
        "the third ball is glass"
    );
}

#[test]
fn probes_that_a_scene_does_not_have_are_refused_by_field() {
    let scene = Arc::new(mirrors(5));
    let refused = |reflections| {
        let found = sampler(&scene).render_samples(&probes_of(&scene, reflections), &Cancel::new()).remove(0);
        match found.unwrap_err() {
            RenderError::Invalid(field) => field.field,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refused(None), "sample.index");
    let maps = maps(&scene).unwrap();
    assert_eq!(refused(Some(ReflectionProbeSet { count: 4, ..maps })), "reflections.count");
}

#[test]
fn points_show_the_room_after_it_moved_about_as_well_as_an_octree() {
    let scene = Arc::new(mirrors(7));
    let camera = scene.cameras[0].camera;
    let octree = judged("mirrors-octree", &scene, camera, 2.0).0;
    let from_points = probes_from(&scene, ProbeSource::POINTS);
    let (points, without, _) = judged_with("mirrors-points", from_points, &scene, camera, 2.0);
    assert!(
        points <= 1.2 * octree && points < 0.5 * without,
        "FLIP {points} from points, {octree} from an octree"
    );
}

#[test]
fn probes_from_points_have_exact_ranges_also_a_million_metres_away() {
    for center in [DVec3::new(5.0, 0.0, 0.0), DVec3::new(1e6, -1e6, 1e6)] {
        let scene = room_with_a_ball(center, chrome(0.0));
        let probes = probes_from(&scene, ProbeSource::POINTS).unwrap();
        let found = sample(&mut sampler(&scene), &probes_of(&scene, Some(probes)));
        let columns = map_size(probes.knobs.side)[0] as usize;
        let ranges = floats(&host_bytes(&found, PlaneKind::InverseRange));
        for (place, &inverse) in ranges[..columns * columns].iter().enumerate() {
            let range = 1.0 / inverse;
            // The walls are 2 m from the ball's middle, and a corner is √3 times as far.
            assert!((1.95..3.5).contains(&range), "texel {place}: {range} m, and no hole");
        }
    }
}

#[test]
fn two_samplers_give_the_bytes_of_probes_from_points_whatever_they_rendered_before() {
    let scene = Arc::new(mirrors(5));
    let at = |epoch| {
        let job = probes_of(&scene, probes_from(&scene, ProbeSource::Points { budget: 1 << 14 }));
        let info = SampleSetInfo { epoch_secs: 0.5, ..(*job.info).clone() }
            .at_version(&scene, Version::of_epoch(epoch, epoch));
        let ids = job.ids.iter().map(|id| SampleId { version: epoch, ..*id }).collect();
        SampleJob { info: Arc::new(info), ids, ..job }
    };
    let planes = [PlaneKind::Radiance, PlaneKind::InverseRange, PlaneKind::ProbeSphere];
    let mut moving = sampler(&scene);
    let [before, moved] =
        [0, 5].map(|epoch| planes.map(|kind| host_bytes(&sample(&mut moving, &at(epoch)), kind)));
    assert_ne!(before, moved);
    let fresh = planes.map(|kind| host_bytes(&sample(&mut sampler(&scene), &at(5)), kind));
    assert_eq!(moved, fresh);
}

/// FLIP of a direct view whose reflections are found by rays or points of its own, against traced ones.
fn own(name: &str, source: ProbeSource, scene: &Arc<Scene>, camera: Camera) -> f64 {
    judged_with(&format!("{name}-{}", source.name()), probes_from(scene, source), scene, camera, 0.0).0
}

#[test]
fn views_show_by_rays_what_the_reference_traces_and_by_points_nearly_that() {
    let glass = Material { transmission: 0.9, roughness: 0.0, ..grey(0.95) };
    for (name, material) in [("chrome", chrome(0.0)), ("brushed", chrome(0.35)), ("glass", glass)] {
        let scene = room_with_a_ball(DVec3::ZERO, material);
        let [rays, points] = [ProbeSource::Rays, ProbeSource::POINTS]
            .map(|source| own(name, source, &scene, into_room(DVec3::ZERO)));
        assert!(rays < 0.02, "{name}: FLIP {rays} by rays");
        assert!(points < 0.04, "{name}: FLIP {points} by points");
    }
}

/// A room with two chrome balls side by side.
fn room_with_two_balls() -> (Arc<Scene>, Camera) {
    let mut scene = (*room_with_a_ball(DVec3::ZERO, chrome(0.0))).clone();
    place(
        &mut scene,
        ball(3, 24),
        DAffine3::from_translation(DVec3::X * 1.3) * DAffine3::from_scale(DVec3::splat(0.5)),
    );
    (Arc::new(scene), into_room(DVec3::X * 0.5))
}

#[test]
fn a_mirror_in_a_mirror_shows_the_room() {
    let (scene, camera) = room_with_two_balls();
    let reflections = probes_from(&scene, ProbeSource::Rays);
    let job = ViewJob { reflections, ..view_job(camera, SIZE, 4) };
    let shown = image_of(&direct(&mut sampler(&scene), &job));
    let [one, all] = [1, BOUNCES].map(|bounces| {
        let reflecting = Reflecting { rays: 1, bounces, instances: scene.reflectors(2) };
        let tracer = Tracer::new(Arc::clone(&scene)).reflecting(reflecting);
        let truth = tracer.render(&camera, SIZE[0], SIZE[1], 4, |_| {}).display(scene.lighting.exposure);
        flip(&format!("mirror-in-mirror-{bounces}"), &shown, &truth)
    });
    assert!(all < 0.02 && all < 0.6 * one, "FLIP {all}; {one} against a single bounce");
}

#[test]
fn probes_by_rays_show_what_reflectors_in_them_reflect() {
    let (scene, _) = room_with_two_balls();
    let dark = |source| {
        let probes = probes_from(&scene, source).unwrap();
        let job = probes_of(&scene, Some(probes));
        let words = host_bytes(&sample(&mut sampler(&scene), &job), PlaneKind::Radiance);
        let words = words.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        // The finest level of each probe, which comes first and is a square.
        let [columns, rows] = map_size(probes.knobs.side).map(|n| n as usize);
        let finest = words.enumerate().filter(|(place, _)| place % (columns * rows) < columns * columns);
        finest.filter(|(_, word)| rgb9e5::decode(*word).max_element() < 1e-3).count()
    };
    let (rays, points) = (dark(ProbeSource::Rays), dark(ProbeSource::POINTS));
    assert!(points > 100 && rays * 8 < points, "{rays} dark texels by rays, {points} by points");
}

#[test]
fn views_find_their_reflections_a_million_metres_away() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let scene = room_with_a_ball(far, chrome(0.0));
    for source in [ProbeSource::Rays, ProbeSource::POINTS] {
        let found = own("far", source, &scene, into_room(far));
        assert!(found < 0.05, "{}: FLIP {found}", source.name());
    }
}

#[test]
fn an_eye_within_a_reflector_and_one_on_its_surface_see_a_finite_image() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.1));
    for source in [ProbeSource::Rays, ProbeSource::POINTS] {
        let mut sampler = sampler(&scene);
        for eye in [DVec3::ZERO, DVec3::new(0.0, 0.0, 0.7), DVec3::new(0.1, 0.2, 0.3)] {
            let camera = Camera::look_at(eye, eye + DVec3::X);
            let job = ViewJob { reflections: probes_from(&scene, source), ..view_job(camera, [32, 24], 4) };
            let image = image_of(&direct(&mut sampler, &job));
            assert_eq!(image.dimensions(), (32, 24));
        }
    }
}

#[test]
fn a_view_has_the_same_bytes_whatever_was_rendered_before_and_by_every_sampler() {
    let scene = Arc::new(mirrors(5));
    for source in [ProbeSource::Rays, ProbeSource::POINTS] {
        let at = |time_secs: f64, size| {
            let reflections = probes_from(&scene, source);
            ViewJob { time_secs, reflections, ..view_job(scene.cameras[0].camera, size, 4) }
        };
        let (mut busy, mut fresh) = (sampler(&scene), sampler(&scene));
        direct(&mut busy, &at(0.0, [64, 48]));
        direct(&mut busy, &at(3.0, [40, 30]));
        let again = image_of(&direct(&mut busy, &at(1.5, [80, 60])));
        assert!(again == image_of(&direct(&mut fresh, &at(1.5, [80, 60]))), "{}", source.name());
    }
}

#[test]
fn a_direct_view_renders_no_probe_and_a_sample_none_for_views() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.0));
    let job = ViewJob {
        reflections: probes_from(&scene, ProbeSource::Rays),
        ..view_job(into_room(DVec3::ZERO), [32, 24], 1)
    };
    let names =
        |stages: &[argus_scene::Stage]| stages.iter().map(|stage| stage.name.to_string()).collect::<Vec<_>>();
    let view = names(&direct(&mut sampler(&scene), &job).stages);
    assert!(view.iter().any(|name| name == "find reflections"), "{view:?}");
    assert!(!view.iter().any(|name| name == "reflection probes"), "{view:?}");
    let probes = names(&sample(&mut sampler(&scene), &probes_of(&scene, job.reflections)).stages);
    assert!(probes.iter().any(|name| name == "reflection rays"), "{probes:?}");
    assert!(!probes.iter().any(|name| name == "find reflections"), "{probes:?}");
}
