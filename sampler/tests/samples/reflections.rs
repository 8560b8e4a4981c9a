//! What glossy and transparent things show of the scene around them by rays, against the reference.

use std::sync::Arc;

use argus_scene::procedural::mirrors;
use argus_scene::reference::{Reflecting, Tracer};
use argus_scene::reflection::BOUNCES;
use argus_scene::{
    Camera, Cancel, Material, PlaneKind, ProbeSource, ReflectionProbeSet, RenderError, SampleJob,
    SampleSetInfo, Sampler as _, ViewJob,
};
use glam::DVec3;

use crate::common::*;
use crate::reflecting::*;
use crate::rooms::grey;

#[test]
fn a_reflector_plane_names_the_probe_of_each_surface() {
    let scene = Arc::new(mirrors(5));
    let eye = DVec3::new(0.0, 2.4, 3.5);
    let rig = omni_rig(eye, 64);
    let nearest = rig.nearest(&Camera::look_at(eye, DVec3::ZERO), 1)[0];
    let job = sample_job(&scene, rig, nearest, true);
    let plain = sample(&mut sampler(&scene), &job);
    assert!(plain.plane(PlaneKind::Reflector).is_none(), "simulated only where it is asked for");
    let info = SampleSetInfo { reflections: probes_from(&scene, ProbeSource::Rays), ..(*job.info).clone() };
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
    let rays = probes_from(&scene, ProbeSource::Rays).unwrap();
    assert_eq!(refused(Some(ReflectionProbeSet { count: 4, ..rays })), "reflections.count");
}

#[test]
fn views_show_by_rays_what_the_reference_traces() {
    let glass = Material { transmission: 0.9, roughness: 0.0, ..grey(0.95) };
    for (name, material) in [("chrome", chrome(0.0)), ("brushed", chrome(0.35)), ("glass", glass)] {
        let scene = room_with_a_ball(DVec3::ZERO, material);
        let rays = own(name, ProbeSource::Rays, &scene, into_room(DVec3::ZERO));
        assert!(rays < 0.02, "{name}: FLIP {rays} by rays");
    }
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

#[test]
fn views_find_their_reflections_a_million_metres_away() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let scene = room_with_a_ball(far, chrome(0.0));
    let source = ProbeSource::Rays;
    let found = own("far", source, &scene, into_room(far));
    assert!(found < 0.05, "{}: FLIP {found}", source.name());
}

#[test]
fn an_eye_within_a_reflector_and_one_on_its_surface_see_a_finite_image() {
    let scene = room_with_a_ball(DVec3::ZERO, chrome(0.1));
    let source = ProbeSource::Rays;
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
    let source = ProbeSource::Rays;
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
