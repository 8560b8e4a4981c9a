//! What is rendered with one set of effects: its time and its images.

use anyhow::{Context as _, Result};
use argus_sampler::GpuSampler;
use argus_scene::tone::display_from_radiance;
use argus_scene::{
    Cancel, Frame, LightEffects, Output, PlaneData, PlaneFormat, PlaneKind, Sample, SampleJob, Sampler as _,
    Stage, ViewJob,
};
use glam::Vec3;
use half::f16;
use image::RgbImage;

use crate::median::median;

/// Images of a rendering: views, and the faces of the sample.
#[derive(Default)]
pub(super) struct Images {
    pub(super) views: Vec<RgbImage>,
    pub(super) sample: Vec<RgbImage>,
}

/// A set of effects, and what was measured of it.
pub(super) struct Rendering {
    pub(super) effects: LightEffects,
    pub(super) sampler: GpuSampler,
    /// Of each round: milliseconds and stages, a view's mean.
    pub(super) views: Vec<(f64, Vec<Stage>)>,
    pub(super) samples: Vec<(f64, Vec<Stage>)>,
    /// With the usual rays.
    pub(super) images: Images,
    /// With many rays, and with half as many.
    pub(super) judged: Images,
    pub(super) halved: Images,
}

impl Rendering {
    pub(super) fn view_ms(&self) -> f64 {
        median(&self.views.iter().map(|(ms, _)| *ms).collect::<Vec<_>>())
    }

    pub(super) fn sample_ms(&self) -> f64 {
        median(&self.samples.iter().map(|(ms, _)| *ms).collect::<Vec<_>>())
    }
}

pub(super) fn frames(sampler: &mut GpuSampler, jobs: &[ViewJob]) -> Result<Vec<Frame>> {
    Ok(sampler.render_views(jobs, &Cancel::new()).into_iter().collect::<Result<_, _>>()?)
}

pub(super) fn sample(sampler: &mut GpuSampler, job: &SampleJob) -> Result<Sample> {
    sampler
        .render_samples(job, &Cancel::new())
        .pop()
        .context("no sample is near the view")?
        .map_err(Into::into)
}

/// Displayed views and faces of a sample.
pub(super) fn images(frames: &[Frame], sample: &Sample, exposure: f32) -> Result<Images> {
    let view = |frame: &Frame| -> Result<RgbImage> {
        let bytes = frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
        RgbImage::from_raw(frame.width, frame.height, bytes).context("the frame is short")
    };
    let plane = sample.plane(PlaneKind::Radiance).context("the sample has no radiance")?;
    let PlaneData::Host(bytes) = &plane.data else { anyhow::bail!("the sample is on the device") };
    anyhow::ensure!(plane.format == PlaneFormat::Rgba16Float, "radiance is not stored as half floats");
    let pixels: Vec<u8> = bytes
        .as_chunks::<8>()
        .0
        .iter()
        .flat_map(|&[r0, r1, g0, g1, b0, b1, ..]| {
            let [r, g, b] = [[r0, r1], [g0, g1], [b0, b1]].map(|half| f16::from_le_bytes(half).to_f32());
            display_from_radiance(Vec3::new(r, g, b), exposure)
        })
        .collect();
    let [width, height] = plane.size;
    Ok(Images {
        views: frames.iter().map(view).collect::<Result<_>>()?,
        sample: vec![RgbImage::from_raw(width, height, pixels).context("the sample is short")?],
    })
}
