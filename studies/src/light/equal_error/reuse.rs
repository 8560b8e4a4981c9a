//! Direct frames as samples of the views around them.
//!
//! A frame is made into a sample with a pinhole camera: displayed colour becomes radiance again, cut off at white and with
//! highlights as its own viewer saw them. Such samples cost nothing, because the frames were rendered for their
//! viewers. A neighbour sees past a frame's borders, so each view is warped from frames on two sides of it.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_scene::sample::{Plane, PlaneData, PlaneFormat, PlaneKind, Sample, SampleId, SampleSet};
use argus_scene::tone::linear_from_srgb;
use argus_scene::{
    Camera, Compositor as _, FaceMask, Frame, Output, Outputs, Plan, SampleCamera, ViewJob, Warp,
};
use glam::DVec3;
use half::f16;

use super::subject::{FromSamples, Subject};
use crate::bench::Bench;

impl Subject<'_> {
    /// Views warped from two direct frames each, taken `aside` of the view on the left and on the right, metres.
    pub(super) fn samples_from_frames(&self, bench: &mut Bench, aside: f64) -> Result<FromSamples> {
        let size = self.options.size;
        let mut samples = Vec::new();
        let mut plans = Vec::new();
        for view in &self.views {
            let right = (view.target - view.eye).cross(view.up).normalize_or_zero();
            let cameras = [-1.0, 1.0].map(|side| moved(bench, view, right * (side * aside)));
            let outputs = Outputs::COLOR.with(Output::Range);
            let plan = || Plan::direct(1);
            let jobs: Vec<ViewJob> =
                cameras.iter().map(|camera| bench.job(*camera, size, outputs, plan())).collect();
            let (_, frames) = bench.time(&jobs)?;
            let mut ids = Vec::new();
            for (camera, frame) in cameras.iter().zip(&frames) {
                let id = SampleId { version: bench.info.version.number, camera: samples.len() as u64 };
                samples.push(Arc::new(sample_of(frame, *camera, id, bench.info.lighting.exposure)?));
                ids.push(id);
            }
            plans.push(Plan::Warp(Warp { samples: ids, ..Warp::default() }));
        }
        let ids: Vec<SampleId> = samples.iter().map(|sample| sample.id).collect();
        bench.compositor.hold(&SampleSet { info: Arc::clone(&bench.info), samples })?;
        let jobs =
            self.views.iter().zip(plans).map(|(view, plan)| bench.job(*view, size, Outputs::COLOR, plan));
        let jobs: Vec<ViewJob> = jobs.collect();
        let found = self.composed(bench, &jobs, format!("frames, {aside:.2} m aside"), 0.0);
        bench.release(&ids);
        found
    }
}

/// A view moved by a step, as far as nothing is in the way.
fn moved(bench: &Bench, view: &Camera, step: DVec3) -> Camera {
    let eye = bench.advance(view.eye, step);
    Camera { eye, target: view.target + (eye - view.eye), ..*view }
}

/// A sample with the colour and range of a frame that was displayed with this exposure.
///
/// # Errors
/// A frame without colour or range.
fn sample_of(frame: &Frame, camera: Camera, id: SampleId, exposure: f32) -> Result<Sample> {
    let (width, height) = (frame.width, frame.height);
    let color = frame.images[Output::Color].as_ref().context("the frame has no colour")?;
    let range = frame.images[Output::Range].as_ref().context("the frame has no range")?;
    let half = |value: f32| f16::from_f32(value).to_le_bytes();
    let radiance = |byte: u8| half(linear_from_srgb(f32::from(byte) / 255.0) / exposure);
    let texel = |[r, g, b]: &[u8; 3]| [radiance(*r), radiance(*g), radiance(*b), half(1.0)].concat();
    let radiance: Vec<u8> = color.as_chunks::<3>().0.iter().flat_map(texel).collect();
    let inverse = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes).recip().to_le_bytes();
    let inverse_range: Vec<u8> = range.as_chunks::<4>().0.iter().flat_map(inverse).collect();
    let plane = |kind, format, data: Vec<u8>| Plane {
        kind,
        format,
        size: [width, height],
        data: PlaneData::Host(data.into()),
    };
    Ok(Sample {
        id,
        camera: SampleCamera::Perspective { camera, width, height },
        faces: FaceMask::ALL,
        planes: vec![
            plane(PlaneKind::Radiance, PlaneFormat::Rgba16Float, radiance),
            plane(PlaneKind::InverseRange, PlaneFormat::R32Float, inverse_range),
        ],
        stages: Vec::new(),
    })
}
