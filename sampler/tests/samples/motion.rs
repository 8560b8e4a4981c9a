//! An animated scene at several times, against the reference and against itself.

use std::sync::Arc;

use argus_scene::reference::Tracer;
use argus_scene::{
    Bounds, Output, PixelJob, PlaneKind, SampleId, SampleSetInfo, Sampler, Scene, SceneState, Version,
    ViewJob, Visibility,
};
use glam::DVec3;

use crate::common::*;
use crate::moving::{EPOCH_SECS, camera, scene, scene_that_deforms};

const SIZE: [u32; 2] = [160, 120];

/// The scene as it is at a time, with nothing left that moves.
fn frozen(scene: &Scene, time_secs: f64) -> Arc<Scene> {
    let pose = scene.at(time_secs);
    let (instances, lighting) = (pose.instances, pose.lighting);
    let shaped = Arc::unwrap_or_clone(Arc::new(scene.clone()).posed(time_secs));
    Arc::new(Scene { instances, lighting, animations: Vec::new(), ..shaped })
}

fn at_epoch(job: &ViewJob, epoch: u64) -> ViewJob {
    ViewJob { state: SceneState::of_epoch(epoch), time_secs: epoch as f64 * EPOCH_SECS, ..job.clone() }
}

fn by_cpu(job: &ViewJob) -> ViewJob {
    ViewJob { visibility: Visibility::Cpu, ..job.clone() }
}

#[test]
fn every_epoch_shows_the_scene_as_the_reference_has_it_at_that_time() {
    shows_each_epoch(scene());
}

#[test]
fn every_epoch_shows_meshes_that_deform_as_the_reference_has_them_at_that_time() {
    shows_each_epoch(scene_that_deforms());
}

fn shows_each_epoch(scene: Scene) {
    let scene = Arc::new(scene);
    let mut sampler = sampler(&scene);
    let tracer = Tracer::new(scene.clone());
    let job = view_job(camera(), SIZE, 4);
    let mut seen = Vec::new();
    for epoch in [0, 3, 6, 11] {
        let frame = direct(&mut sampler, &at_epoch(&job, epoch));
        assert_eq!(frame.provenance.state.epoch, epoch);
        let by_rays = image_of(&direct(&mut sampler, &by_cpu(&at_epoch(&job, epoch))));
        let difference = flip(&format!("epoch-{epoch}-traced"), &by_rays, &image_of(&frame));
        assert!(difference < 0.001, "epoch {epoch}: traced and rasterised differ by FLIP {difference}");
        let truth = tracer.at(epoch as f64 * EPOCH_SECS).render(&camera(), SIZE[0], SIZE[1], 4, |_| {});
        let image = image_of(&frame);
        let error = flip(&format!("epoch-{epoch}"), &image, &truth.display(scene.lighting.exposure));
        assert!(error < 0.02, "epoch {epoch}: FLIP {error}");
        assert!(!seen.contains(&image), "epoch {epoch} looks like one before it");
        seen.push(image);
    }
    let stale = tracer.render(&camera(), SIZE[0], SIZE[1], 4, |_| {}).display(scene.lighting.exposure);
    let error = flip("epoch-stale", &seen[1], &stale);
    assert!(error > 0.02, "the wrong moment must be told from the right one: FLIP {error}");
}

#[test]
fn an_epoch_comes_back_byte_for_byte_and_equals_a_scene_that_stands_still_there() {
    comes_back(scene());
    comes_back(scene_that_deforms());
}

fn comes_back(scene: Scene) {
    let scene = Arc::new(scene);
    let mut moving = sampler(&scene);
    let job = at_epoch(&view_job(camera(), SIZE, 1), 5);
    let first = direct(&mut moving, &job);
    direct(&mut moving, &at_epoch(&job, 9));
    direct(&mut moving, &at_epoch(&job, 0));
    let again = direct(&mut moving, &job);
    let still = direct(&mut sampler(&frozen(&scene, job.time_secs)), &job);
    for other in [&again, &still] {
        assert_eq!(first.images[Output::Color], other.images[Output::Color]);
        assert_eq!(first.images[Output::Range], other.images[Output::Range]);
    }
    // A whole turn later the ball is where it was: four seconds are sixteen epochs.
    assert_eq!(first.images[Output::Color], direct(&mut moving, &at_epoch(&job, 21)).images[Output::Color]);
}

#[test]
fn samples_and_pixels_move_too() {
    samples_move(scene());
    samples_move(scene_that_deforms());
}

fn samples_move(scene: Scene) {
    let scene = Arc::new(scene);
    let mut moving = sampler(&scene);
    let bounds = Bounds { min: DVec3::new(-4.0, 0.0, -4.0), max: DVec3::new(4.0, 3.0, 4.0) };
    let job_at = |scene: &Scene, epoch: u64| {
        let mut job = sample_job(scene, corner_rig(bounds, SIZE), 3, true);
        let info = SampleSetInfo { epoch_secs: EPOCH_SECS, ..(*job.info).clone() };
        job.info = Arc::new(info.at_version(scene, Version::of_epoch(epoch, epoch)));
        job.ids = vec![SampleId { version: epoch, ..job.ids[0] }];
        job
    };
    let planes = [PlaneKind::Radiance, PlaneKind::InverseRange];
    let mut bytes_at = |epoch| {
        let sample = sample(&mut moving, &job_at(&scene, epoch));
        planes.map(|kind| host_bytes(&sample, kind))
    };
    let (first, other, again) = (bytes_at(2), bytes_at(7), bytes_at(2));
    assert_ne!(first, other);
    assert_eq!(first, again);
    let still = frozen(&scene, 7.0 * EPOCH_SECS);
    let mut job = job_at(&still, 0);
    job.info = Arc::new(SampleSetInfo { lighting: still.lighting.clone(), ..(*job.info).clone() });
    let held = sample(&mut sampler(&still), &job);
    assert_eq!(other, planes.map(|kind| host_bytes(&held, kind)));

    let job = at_epoch(&view_job(camera(), SIZE, 1), 6);
    let frame = direct(&mut moving, &job);
    let pixels: Vec<u32> = (0..SIZE[0] * SIZE[1]).step_by(37).collect();
    let wanted = PixelJob {
        camera: job.camera,
        width: SIZE[0],
        height: SIZE[1],
        pixels: pixels.clone(),
        samples_per_pixel: 1,
        state: SceneState::of_epoch(6),
        time_secs: job.time_secs,
        reflections: None,
    };
    direct(&mut moving, &at_epoch(&job, 1));
    let some = moving.render_pixels(&[wanted], &argus_scene::Cancel::new()).remove(0).expect("renders");
    let color = frame.images[Output::Color].clone().expect("colour was asked for");
    let expected: Vec<u8> = pixels.iter().flat_map(|&p| color[p as usize * 3..][..3].to_vec()).collect();
    let differing =
        expected.as_chunks::<3>().0.iter().zip(some.color.as_chunks::<3>().0).filter(|(a, b)| a != b);
    // Another way to see triangles may choose another one along edges.
    assert!(differing.count() * 50 <= pixels.len());
}

#[test]
fn a_scene_that_stands_still_is_the_same_at_all_times_and_is_never_posed() {
    let mut sampler = sampler(&frozen(&scene(), 1.0));
    let job = view_job(camera(), SIZE, 1);
    let (first, later) = (direct(&mut sampler, &job), direct(&mut sampler, &at_epoch(&job, 1000)));
    assert_eq!(first.images[Output::Color], later.images[Output::Color]);
    assert!(later.stages.iter().all(|stage| stage.name != "pose"), "{:?}", later.stages);
}
