//! How close each viewer's picture comes to the truth.

use anyhow::Context;
use argus_client::Answer;
use argus_scene::metrics;
use image::RgbImage;

use crate::demo::sheet::Entry;

/// One viewer's pictures and what they are worth.
pub(crate) struct Judged {
    /// From samples.
    pub(crate) warped: RgbImage,
    /// From triangles, sixteen samples a pixel: the truth.
    pub(crate) truth: RgbImage,
    /// FLIP of the two, as a map.
    pub(crate) difference: RgbImage,
    /// FLIP of the picture from samples.
    pub(crate) flip: f64,
    /// FLIP of the view from triangles with one sample a pixel: what aliasing alone is worth.
    pub(crate) flip_direct: f64,
    /// Fraction of pixels that no sample saw.
    pub(crate) unresolved_fraction: f64,
}

impl Judged {
    /// Its row of the contact sheet.
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

/// Judges every view; the three lists are of the same viewers in the same order.
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
