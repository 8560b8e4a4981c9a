//! Makes pixels of a view, or planes of a sample, of what was shaded.

use super::part::{Output, PartJob, RenderedPart};
use crate::frame::Frame;

/// Resolves a frame and submits it. The result is read back when it is waited for.
pub(super) fn image(mut frame: Frame<'_>, job: &PartJob<'_>) -> RenderedPart {
    let Frame { commands, context, arriving, .. } = &mut frame;
    let (mut color, mut range) = (None, None);
    if let Output::Texels(planes) = job.output {
        job.programs.resolve.record(commands, context, job.settings, planes, arriving.as_ref());
    }
    if let Output::Color | Output::ColorAndRange = job.output {
        color = Some(job.resolve_view.record_color(commands, context, job.exposure));
    }
    let mut ranges = Vec::new();
    if let Output::Range | Output::ColorAndRange = job.output {
        range = Some(job.resolve_view.record_range(commands, context));
        ranges = job.layers.iter().filter_map(|ray| Some((ray.at, ray.shown()?.1 as f32))).collect();
    }
    RenderedPart { submitted: frame.commands.submit(), color, range, ranges }
}
