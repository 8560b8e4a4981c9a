//! Compares the crowd's last views with their references.

use anyhow::bail;
use argus_client::Client;
use argus_client::load::{burst, direct_view, patient};
use argus_scene::{Frame, metrics};
use image::RgbImage;

use crate::demo::crowd::Shown;
use crate::demo::kind::{KINDS, kind_of};
use crate::output::image_of;
use crate::sheet::Entry;

/// Samples a side of a reference's pixel.
const REFERENCE_SIDE: u32 = 4;
/// References in work at once. Nothing is timed.
const IN_FLIGHT: usize = 4;

/// One viewer's images and their errors.
pub(crate) struct Judged {
    /// The view as the crowd got it.
    pub(crate) shown: RgbImage,
    /// The reference: the view from triangles, sixteen samples a pixel.
    pub(crate) truth: RgbImage,
    /// FLIP map of the two.
    pub(crate) difference: RgbImage,
    /// Mean FLIP of the view as the crowd got it.
    pub(crate) flip: f64,
    /// Mean FLIP of the view from triangles at one sample a pixel: the cost of aliasing alone.
    pub(crate) flip_direct: f64,
    /// How the view was answered.
    kind: &'static str,
}

impl Judged {
    fn of(shown: &Frame, truth: &Frame, direct: &Frame) -> anyhow::Result<Self> {
        let kind = KINDS[kind_of(shown)];
        let (shown, truth, direct) = (image_of(shown)?, image_of(truth)?, image_of(direct)?);
        Ok(Self {
            difference: metrics::flip_map(&truth, &shown)?,
            flip: metrics::compare(&truth, &shown)?.flip_mean,
            flip_direct: metrics::compare(&truth, &direct)?.flip_mean,
            kind,
            shown,
            truth,
        })
    }

    /// The viewer's row of the contact sheet.
    pub(crate) fn entry(&self, index: usize) -> Entry<'_> {
        Entry {
            shown: &self.shown,
            reference: &self.truth,
            difference: &self.difference,
            caption: format!("view {index}: {}, mean FLIP {:.3}", self.kind, self.flip),
        }
    }
}

/// Judges views. The service renders their references: the same cameras, at the moments that the frames show.
///
/// # Errors
/// There are no views, or a reference is not answered.
pub(crate) async fn all(client: &Client, views: Vec<Shown>) -> anyhow::Result<Vec<Judged>> {
    anyhow::ensure!(!views.is_empty(), "none of the crowd's views was answered");
    let needed = views.iter().flat_map(|Shown { camera, frame, .. }| {
        [REFERENCE_SIDE, 1].map(|side| direct_view(frame, *camera, frame.provenance.state, side))
    });
    let mut frames: Vec<Option<Frame>> = vec![None; 2 * views.len()];
    let keep = |i: usize, answer: argus_client::Answer| frames[i] = Some(answer.frame);
    let outcome = burst(client, needed.collect(), IN_FLIGHT, &patient(), keep).await;
    if let Some(error) = outcome.first_error {
        bail!("{} of {} references were not answered: {error}", outcome.failed, outcome.views);
    }
    let judge = |(shown, pair): (&Shown, &[Option<Frame>])| match pair {
        [Some(truth), Some(direct)] => Judged::of(&shown.frame, truth, direct),
        _ => bail!("a reference is missing"),
    };
    views.iter().zip(frames.chunks_exact(2)).map(judge).collect()
}
