//! An animated scene at several times, against the reference and against itself.

use std::sync::Arc;

use argus_scene::animation::{Animation, Channel, Interpolation, Node, Parts, Rest, Track};
use argus_scene::deformation::{Deformation, Joint, MorphTarget, Shape, Skin};
use argus_scene::reference::Tracer;
use argus_scene::{
    Bounds, Camera, Light, MegaViews, PixelJob, PlaneKind, SampleId, SampleSetInfo, Sampler, Sampling, Scene,
    SceneState, Version, ViewJob, Visibility,
};
use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

use crate::common::*;

const SIZE: [u32; 2] = [160, 120];
/// Δt of these tests, seconds.
const EPOCH_SECS: f64 = 0.25;

/// A floor and a ball that stand still; a ball that goes round the middle while it grows, a lamp above it.
fn scene() -> Scene {
    let mut scene = empty_scene();
    scene.materials.push(argus_scene::Material {
        base_color: glam::Vec4::new(0.9, 0.3, 0.2, 1.0),
        ..argus_scene::Material::default()
    });
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 3.0, 0), DAffine3::IDENTITY);
    place(&mut scene, ball(0, 16), DAffine3::from_translation(DVec3::new(0.0, 1.0, 0.0)));
    place(&mut scene, ball(1, 24), DAffine3::IDENTITY);
    scene.instances[2].node = Some(1);
    let node = |parent, translation, lights| Node {
        name: String::new(),
        parent,
        rest: Rest::Parts(Parts { translation, ..Parts::default() }),
        lights,
    };
    scene.lighting.lights.push(Light::Point {
        position: DVec3::ZERO,
        intensity: Vec3::splat(3.0),
        range: None,
        radius: 0.0,
    });
    scene.nodes = vec![
        node(None, DVec3::ZERO, vec![]),
        node(Some(0), DVec3::new(2.5, 0.8, 0.0), vec![]),
        node(Some(1), DVec3::new(0.0, 2.0, 0.0), vec![1]),
    ];
    let quarters = (0..=4).map(|i| Quat::from_rotation_y(i as f32 * std::f32::consts::FRAC_PI_2)).collect();
    let around = Channel {
        node: 0,
        times_secs: vec![0.0, 1.0, 2.0, 3.0, 4.0],
        track: Track::Rotation(quarters),
        interpolation: Interpolation::Linear,
    };
    let grow = Channel {
        node: 1,
        times_secs: vec![0.0, 4.0],
        track: Track::Scale(vec![Vec3::splat(0.5), Vec3::splat(0.8)]),
        interpolation: Interpolation::Linear,
    };
    scene.animations = vec![Animation { name: "round".to_owned(), channels: vec![around, grow] }];
    let pose = scene.at(0.0);
    (scene.instances, scene.lighting) = (pose.instances, pose.lighting);
    scene
}

/// The scene with an egg whose foot stands still and whose top is drawn round the middle, while a target squeezes it.
fn scene_that_deforms() -> Scene {
    let mut scene = scene();
    let mut egg = ball(1, 16);
    let vertices = egg.positions.len();
    let joint = |node, from: DVec3| Joint { node, joint_from_mesh: DAffine3::from_translation(-from) };
    let rest = Shape {
        origin: DVec3::ZERO,
        positions: egg.positions.clone(),
        normals: egg.normals.clone(),
        tangents: egg.tangents.clone(),
    };
    let squeezed = egg.positions.iter().map(|p| Vec3::new(0.0, 0.0, -0.6 * p.z)).collect();
    let share = |p: &Vec3| (p.y * 0.5 + 0.5).clamp(0.0, 1.0);
    let target = MorphTarget { positions: squeezed, ..MorphTarget::default() };
    egg.deformation = Some(Arc::new(Deformation {
        rest,
        node: 3,
        targets: vec![target],
        weights: vec![0.0],
        skin: Some(Skin {
            joints: Arc::new(vec![joint(3, DVec3::ZERO), joint(1, DVec3::new(0.0, 0.8, 0.0))]),
            first: (0..=vertices as u32).map(|i| 2 * i).collect(),
            influences: egg.positions.iter().flat_map(|p| [(0, 1.0 - share(p)), (1, share(p))]).collect(),
        }),
        flattens: false,
        flat_normals: false,
    }));
    let foot = Parts { translation: DVec3::new(-2.0, 1.2, 1.0), ..Parts::default() };
    scene.nodes.push(Node { name: String::new(), parent: None, rest: Rest::Parts(foot), lights: vec![] });
    let squeeze = Channel {
        node: 3,
        times_secs: vec![0.0, 2.0, 4.0],
        track: Track::Weights(vec![0.0, 1.0, 0.0]),
        interpolation: Interpolation::Linear,
    };
    scene.animations[0].channels.push(squeeze);
    place(&mut scene, egg, DAffine3::IDENTITY);
    // Pebbles keep the bounds, and so the near plane, those of the scene that stands still.
    for corner in [DVec3::new(-8.0, -2.0, -8.0), DVec3::new(8.0, 5.0, 8.0)] {
        let small = DAffine3::from_scale_rotation_translation(DVec3::splat(0.01), DQuat::IDENTITY, corner);
        place(&mut scene, ball(0, 4), small);
    }
    let posed = Arc::new(scene).posed(0.0);
    Arc::unwrap_or_clone(posed)
}

/// The scene as it is at a time, with nothing left that moves.
fn frozen(scene: &Scene, time_secs: f64) -> Arc<Scene> {
    let pose = scene.at(time_secs);
    let (instances, lighting) = (pose.instances, pose.lighting);
    let shaped = Arc::unwrap_or_clone(Arc::new(scene.clone()).posed(time_secs));
    Arc::new(Scene { instances, lighting, animations: Vec::new(), ..shaped })
}

fn camera() -> Camera {
    Camera::look_at(DVec3::new(0.5, 3.5, 7.5), DVec3::new(0.0, 0.8, 0.0))
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
        assert_eq!(first.color, other.color);
        assert_eq!(first.range, other.range);
    }
    // A whole turn later the ball is where it was: four seconds are sixteen epochs.
    assert_eq!(first.color, direct(&mut moving, &at_epoch(&job, 21)).color);
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
    let color = frame.color.expect("colour was asked for");
    let expected: Vec<u8> = pixels.iter().flat_map(|&p| color[p as usize * 3..][..3].to_vec()).collect();
    let differing =
        expected.as_chunks::<3>().0.iter().zip(some.color.as_chunks::<3>().0).filter(|(a, b)| a != b);
    // Another way to see triangles may choose another one along edges.
    assert!(differing.count() * 50 <= pixels.len());
}

#[test]
fn samples_from_an_octree_move_too() {
    let scene = Arc::new(scene_that_deforms());
    let mut moving = sampler(&scene);
    let knobs = MegaViews { map_side: 128, levels: 7, block: 1 };
    let bytes_at = |sampler: &mut argus_sampler::GpuSampler, epoch, sampling| {
        let eye = DVec3::new(-0.2, 2.6, 2.2);
        let mut job = sample_job(&scene, omni_rig(eye, 96), 0, true);
        let index = job.info.rig.nearest(&Camera { eye, ..camera() }, 1)[0];
        let info = SampleSetInfo { epoch_secs: EPOCH_SECS, sampling, ..(*job.info).clone() };
        job.info = Arc::new(info.at_version(&scene, Version::of_epoch(epoch, epoch)));
        job.ids = vec![SampleId { version: epoch, camera: index }];
        let sample = sample(sampler, &job);
        [PlaneKind::Radiance, PlaneKind::InverseRange].map(|kind| host_bytes(&sample, kind))
    };
    let mapped = Sampling::MegaViews(knobs);
    let [first, other, again] = [2, 7, 2].map(|epoch| bytes_at(&mut moving, epoch, mapped));
    assert!(first == again && first != other);
    assert!(other == bytes_at(&mut sampler(&scene), 7, mapped), "what came before leaves no trace");

    // Where the ball came or went, triangles of that time have the same range, and those of another have not.
    let [was, is] = [2, 7].map(|epoch| floats(&bytes_at(&mut moving, epoch, Sampling::Triangles)[1]));
    // Three cells, metres.
    let is_near = |a: f32, b: f32| a == b || (1.0 / a - 1.0 / b).abs() < 0.3;
    let ours = floats(&other[1]);
    let moved: Vec<usize> = (0..is.len()).filter(|&i| !is_near(was[i], is[i])).collect();
    assert!(moved.len() > 30, "{} texels show motion", moved.len());
    let share =
        |of: &[f32]| moved.iter().filter(|&&i| is_near(ours[i], of[i])).count() as f64 / moved.len() as f64;
    let (now, then) = (share(&is), share(&was));
    assert!(now > 0.7 && then < 0.2, "{now} of its time, {then} of another");
}

#[test]
fn a_scene_that_stands_still_is_the_same_at_all_times_and_is_never_posed() {
    let mut sampler = sampler(&frozen(&scene(), 1.0));
    let job = view_job(camera(), SIZE, 1);
    let (first, later) = (direct(&mut sampler, &job), direct(&mut sampler, &at_epoch(&job, 1000)));
    assert_eq!(first.color, later.color);
    assert!(later.stages.iter().all(|stage| stage.name != "pose"), "{:?}", later.stages);
}
