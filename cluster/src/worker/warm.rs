//! What a role is put through before anybody waits for it.
//!
//! Drivers make a program's machine code where it is first used, and the software driver takes a second and more for all
//! that a frame needs. So a role renders something that nobody asked for, whose result is thrown away.

use std::sync::Arc;

use argus_scene::{
    Camera, Cancel, Compositor, OmniLayout, Outputs, Plan, Plane, PlaneData, PlaneFormat, PlaneKind,
    RenderError, Sample, SampleCamera, SampleId, SampleJob, SampleSet, SampleSetInfo, Sampler, ViewJob, Warp,
};
use glam::DVec3;

/// Pixels of a view: enough for each program to have some.
const SIZE: [u32; 2] = [64, 48];

/// Side of a sample, texels.
const SIDE: u32 = 8;

/// No rig is placed so often.
const GENERATION: u64 = u64::MAX;

/// Renders a sample.
pub(super) fn sampler(sampler: &mut dyn Sampler, info: &Arc<SampleSetInfo>) -> Result<(), RenderError> {
    let ids = vec![SampleId { epoch: info.epoch, generation: GENERATION, index: index(info) }];
    let job = SampleJob { info: info.clone(), ids, to_host: true };
    sampler.render_samples(&job, &Cancel::default()).into_iter().try_for_each(|sample| sample.map(drop))
}

/// Reconstructs a small view from a sample of nothing in particular.
pub(super) fn compositor(
    compositor: &mut dyn Compositor,
    info: &Arc<SampleSetInfo>,
) -> Result<(), RenderError> {
    let seen_from = viewpoint(info);
    let index = index(info);
    let (sample_camera, camera) = match info.rig.camera(index)? {
        SampleCamera::Perspective { camera, .. } => {
            (SampleCamera::Perspective { camera, width: SIDE, height: SIDE }, camera)
        }
        SampleCamera::Omni { center, .. } => {
            let layout = OmniLayout::CubeFaces { face: SIDE };
            (
                SampleCamera::Omni { center, layout },
                Camera { eye: center, target: center + DVec3::X, ..seen_from },
            )
        }
    };
    let id = SampleId { epoch: info.epoch, generation: GENERATION, index };
    let sample =
        Arc::new(Sample { id, camera: sample_camera, planes: planes(&sample_camera), stages: Vec::new() });
    compositor.hold(&SampleSet { info: info.clone(), samples: vec![sample] })?;
    let plan = Plan::Warp(Warp { samples: vec![id], ..Warp::default() });
    let frames = compositor.compose(&[view(info, camera, plan)], &Cancel::default());
    compositor.release(&[id]);
    frames.into_iter().try_for_each(|frame| frame.map(drop))
}

/// One of the rig's cameras.
fn index(info: &SampleSetInfo) -> u64 {
    info.rig.nearest(&viewpoint(info), 1).first().copied().unwrap_or(0)
}

/// From outside the scene into its middle.
fn viewpoint(info: &SampleSetInfo) -> Camera {
    let (center, size) = (info.bounds.center(), info.bounds.size().max_element().max(1e-3));
    Camera::look_at(center + DVec3::splat(size), center)
}

fn view(info: &SampleSetInfo, camera: Camera, plan: Plan) -> ViewJob {
    let ([width, height], visibility) = (SIZE, info.visibility);
    let (epoch, time_secs) = (info.epoch, info.time_secs());
    // Maps of surroundings are made when somebody looks: they take what samples take.
    let (outputs, reflections, history) = (Outputs::COLOR, None, None);
    ViewJob { camera, width, height, outputs, plan, epoch, time_secs, visibility, reflections, history }
}

/// Grey, a metre away in all directions.
fn planes(camera: &SampleCamera) -> Vec<Plane> {
    let [width, height] = camera.size();
    let plane = |kind, format, texel: [u8; 4]| {
        let data = PlaneData::Host(texel.repeat((width * height) as usize).into());
        Plane { kind, format, size: [width, height], data }
    };
    vec![
        plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat, [0; 4]),
        plane(PlaneKind::InverseRange, PlaneFormat::R32Float, 1f32.to_le_bytes()),
    ]
}
