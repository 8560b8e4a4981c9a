//! Makes pixels of a view, or planes of a sample, of what was shaded.

use argus_scene::Output;

use super::part::{PartJob, PartOutput, RenderedPart};
use crate::frame::Frame;

/// Resolves a frame and submits it. The result is read back when it is waited for.
pub(super) fn image(mut frame: Frame<'_>, job: &PartJob<'_>) -> RenderedPart {
    let Frame { commands, context, arriving, .. } = &mut frame;
    if let PartOutput::Texels(planes) = job.output {
        job.programs.resolve.record(commands, context, job.settings, planes, arriving.as_ref());
    }
    let (mut images, mut ranges) = (Vec::new(), Vec::new());
    if let PartOutput::Pixels(outputs) = job.output {
        for output in outputs.iter() {
            let pending = match output {
                Output::Color => job.resolve_view.record_color(commands, context, job.exposure),
                Output::Radiance => job.resolve_view.record_radiance(commands, context),
                Output::Range => job.resolve_view.record_range(commands, context),
                // Not of this pass.
                _ => continue,
            };
            images.push((output, pending));
        }
        if outputs.has(Output::Range) {
            ranges = job.layers.iter().filter_map(|ray| Some((ray.at, ray.shown()?.1 as f32))).collect();
        }
    }
    let outcome = frame.outcome.take();
    let outcome = outcome.map(|outcome| frame.commands.read_buffer(&outcome, 0..outcome.size()));
    RenderedPart { submitted: frame.commands.submit(), images, outcome, ranges }
}
