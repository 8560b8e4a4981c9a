//! What glossy and transparent things show of the scene around them by points, against rays.

use std::sync::Arc;

use argus_scene::procedural::mirrors;
use argus_scene::reflection::map_size;
use argus_scene::{
    Camera, Material, PlaneKind, ProbeSource, SampleId, SampleJob, SampleSetInfo, Version, ViewJob, rgb9e5,
};
use glam::DVec3;

use crate::common::*;
use crate::reflecting::*;
use crate::rooms::grey;

#[test]
fn points_show_the_room_after_it_moved_about_as_well_as_an_octree() {
    let scene = Arc::new(mirrors(7));
    let camera = scene.cameras[0].camera;
    let octree = judged_with(
        "mirrors-octree",
        probes_from(&scene, ProbeSource::Octree { levels: 7 }),
        &scene,
        camera,
        2.0,
    )
    .0;
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
        let columns = map_size(probes.settings.side)[0] as usize;
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

#[test]
fn probes_by_rays_show_what_reflectors_in_them_reflect() {
    let (scene, _) = room_with_two_balls();
    let dark = |source| {
        let probes = probes_from(&scene, source).unwrap();
        let job = probes_of(&scene, Some(probes));
        let words = host_bytes(&sample(&mut sampler(&scene), &job), PlaneKind::Radiance);
        let words = words.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        // The finest level of each probe, which comes first and is a square.
        let [columns, rows] = map_size(probes.settings.side).map(|n| n as usize);
        let finest = words.enumerate().filter(|(place, _)| place % (columns * rows) < columns * columns);
        finest.filter(|(_, word)| rgb9e5::decode(*word).max_element() < 1e-3).count()
    };
    let (rays, points) = (dark(ProbeSource::Rays), dark(ProbeSource::POINTS));
    assert!(points > 100 && rays * 8 < points, "{rays} dark texels by rays, {points} by points");
}

#[test]
fn views_show_by_points_nearly_what_the_reference_traces() {
    let glass = Material { transmission: 0.9, roughness: 0.0, ..grey(0.95) };
    for (name, material) in [("chrome", chrome(0.0)), ("brushed", chrome(0.35)), ("glass", glass)] {
        let scene = room_with_a_ball(DVec3::ZERO, material);
        let points = own(name, ProbeSource::POINTS, &scene, into_room(DVec3::ZERO));
        assert!(points < 0.04, "{name}: FLIP {points} by points");
    }
}

#[test]
fn views_find_their_reflections_a_million_metres_away() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let scene = room_with_a_ball(far, chrome(0.0));
    let source = ProbeSource::POINTS;
    let found = own("far", source, &scene, into_room(far));
    assert!(found < 0.05, "{}: FLIP {found}", source.name());
}

#[test]
fn an_eye_within_a_reflector_and_one_on_its_surface_see_a_finite_image() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.1));
    let source = ProbeSource::POINTS;
    let mut sampler = sampler(&scene);
    for eye in [DVec3::ZERO, DVec3::new(0.0, 0.0, 0.7), DVec3::new(0.1, 0.2, 0.3)] {
        let camera = Camera::look_at(eye, eye + DVec3::X);
        let job = ViewJob { reflections: probes_from(&scene, source), ..view_job(camera, [32, 24], 4) };
        let image = image_of(&direct(&mut sampler, &job));
        assert_eq!(image.dimensions(), (32, 24));
    }
}

#[test]
fn a_view_has_the_same_bytes_whatever_was_rendered_before_and_by_every_sampler() {
    let scene = Arc::new(mirrors(5));
    let source = ProbeSource::POINTS;
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
