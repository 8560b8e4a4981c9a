//! What tests of reflections share: rooms with reflectors, and how far a view of them is off.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::sync::Arc;

use argus_scene::reference::{Reflecting, Tracer};
use argus_scene::reflection::BOUNCES;
use argus_scene::{
    Camera, Material, ProbeSource, ReflectionProbeSet, Reflections, SampleId, SampleJob, SampleSetInfo,
    Scene, SceneState, ViewJob,
};
use glam::{DAffine3, DVec3, Vec3};

use crate::common::*;
use crate::rooms::{add_room, grey, lit_by};

pub(crate) const SIZE: [u32; 2] = [160, 120];

pub(crate) fn probes_from(scene: &Scene, source: ProbeSource) -> Option<ReflectionProbeSet> {
    let rig = omni_rig(scene.bounds().center(), 384);
    ReflectionProbeSet::of(scene, &rig, Reflections { source, ..Reflections::default() })
        .expect("the settings are in range")
}

pub(crate) fn traced(scene: &Arc<Scene>, time_secs: f64) -> Tracer {
    let tracer = Tracer::new(Arc::clone(scene)).at(time_secs);
    tracer.reflecting(Reflecting { rays: 32, bounces: BOUNCES, instances: scene.reflectors(1024) })
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

/// A room about `center` with a ball of a material in its middle.
pub(crate) fn room_with_a_ball(center: DVec3, material: Material) -> Arc<Scene> {
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

/// A room with two chrome balls side by side.
pub(crate) fn room_with_two_balls() -> (Arc<Scene>, Camera) {
    let mut scene = (*room_with_a_ball(DVec3::ZERO, chrome(0.0))).clone();
    place(
        &mut scene,
        ball(3, 24),
        DAffine3::from_translation(DVec3::X * 1.3) * DAffine3::from_scale(DVec3::splat(0.5)),
    );
    (Arc::new(scene), into_room(DVec3::X * 0.5))
}

pub(crate) fn chrome(roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, ..grey(0.9) }
}

pub(crate) fn into_room(center: DVec3) -> Camera {
    Camera { fov_deg: 70.0, ..Camera::look_at(center + DVec3::new(0.2, 0.4, 1.9), center) }
}

pub(crate) fn probes_of(scene: &Arc<Scene>, reflections: Option<ReflectionProbeSet>) -> SampleJob {
    let job = sample_job(scene, omni_rig(scene.bounds().center(), 16), 0, true);
    let info = SampleSetInfo { reflections, ..(*job.info).clone() };
    let id = SampleId { camera: SampleId::REFLECTION_PROBES, ..job.ids[0] };
    SampleJob { info: Arc::new(info), ids: vec![id], ..job }
}

/// FLIP of a direct view whose reflections are found by rays or points of its own, against traced ones.
pub(crate) fn own(name: &str, source: ProbeSource, scene: &Arc<Scene>, camera: Camera) -> f64 {
    judged_with(&format!("{name}-{}", source.name()), probes_from(scene, source), scene, camera, 0.0).0
}
