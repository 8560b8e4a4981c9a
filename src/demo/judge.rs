//! Compares the demo's views with their references.

use anyhow::Context;
use argus_client::Answer;
use argus_scene::metrics;
use image::RgbImage;

use crate::sheet::Entry;

/// One viewer's images and their errors.
pub(crate) struct Judged {
    /// The view from samples.
    pub(crate) warped: RgbImage,
    /// The reference: the view from triangles, sixteen samples a pixel.
    pub(crate) truth: RgbImage,
    /// FLIP map of the two.
    pub(crate) difference: RgbImage,
    /// Mean FLIP of the view from samples.
    pub(crate) flip: f64,
    /// Mean FLIP of the view from triangles at one sample a pixel: the cost of aliasing alone.
    pub(crate) flip_direct: f64,
    /// Fraction of pixels that no sample saw.
    pub(crate) unresolved_fraction: f64,
}

impl Judged {
    /// The viewer's row of the contact sheet.
    pub(crate) fn entry(&self, index: usize) -> Entry<'_> {
        let unresolved = self.unresolved_fraction * 100.0;
        Entry {
            warped: &self.warped,
            direct: &self.truth,
            difference: &self.difference,
            caption: format!("view {index}: mean FLIP {:.3}, unresolved {unresolved:.2}%", self.flip),
        }
    }
}

/// Judges every view. The three lists have the same viewers in the same order.
pub(crate) fn all(warped: &[Answer], direct: &[Answer], truth: &[Answer]) -> anyhow::Result<Vec<Judged>> {
    let judge = |((warped, direct), truth): ((&Answer, &Answer), &Answer)| {
        let unresolved_fraction = warped.frame.unresolved_fraction;
        let (warped, direct, truth) = (image_of(warped)?, image_of(direct)?, image_of(truth)?);
        Ok(Judged {
            difference: metrics::flip_map(&truth, &warped)?,
            flip: metrics::compare(&truth, &warped)?.flip_mean,
            flip_direct: metrics::compare(&truth, &direct)?.flip_mean,
            unresolved_fraction,
            warped,
            truth,
        })
    };
    warped.iter().zip(direct).zip(truth).map(judge).collect()
}

fn image_of(answer: &Answer) -> anyhow::Result<RgbImage> {
    let frame = &answer.frame;
    let pixels = frame.color.as_ref().context("the frame has no colour")?;
    RgbImage::from_raw(frame.width, frame.height, pixels.to_vec()).context("the frame's colour is short")
}
