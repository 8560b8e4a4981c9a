//! Shades what a part's rays see: what is lit without rays, and the G-buffer for later light.

use crate::frame::Frame;
use crate::passes::{ProbeBindings, ResolveSample, Shade, ShadeSample};

/// The programs that shade and resolve the surfaces of a job.
pub(crate) struct SurfaceProgram<'a> {
    pub(crate) shade: &'a Shade,
    pub(crate) shade_sample: &'a ShadeSample,
    pub(crate) resolve: &'a ResolveSample,
    pub(crate) probe_bindings: &'a ProbeBindings,
}

/// Shades each sub-sample of a view, or the texels of a sample.
pub(super) fn visible(frame: &mut Frame<'_>, programs: &SurfaceProgram<'_>) {
    let Frame { commands, context, is_view, .. } = frame;
    match is_view {
        true => programs.shade.record(commands, context, programs.probe_bindings),
        false => programs.shade_sample.record(commands, context, programs.probe_bindings),
    }
}
