//! Views that are rendered and timed.

use std::time::Instant;

use anyhow::Result;
use argus_sampler::GpuSampler;
use argus_scene::{Cancel, Sampler as _, ViewJob};
use image::RgbImage;

use crate::bench::image_of;

/// Renders a view. Returns the seconds that it took, and its image.
///
/// # Errors
/// A render that fails.
pub(super) fn timed(sampler: &mut GpuSampler, job: &ViewJob) -> Result<(f64, RgbImage)> {
    let begin = Instant::now();
    let frame = sampler.render_views(std::slice::from_ref(job), &Cancel::new()).remove(0)?;
    let image = image_of(&frame)?;
    Ok((begin.elapsed().as_secs_f64(), image))
}
