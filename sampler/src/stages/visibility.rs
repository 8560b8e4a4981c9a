//! Finds what a part's rays see.

use argus_gpu::wgpu;
use argus_scene::RenderError;

use super::part::{Part, PartJob};
use crate::frame::Frame;

/// Fills the visibility buffer.
pub(super) fn find(frame: &mut Frame<'_>, job: &PartJob<'_>) -> Result<(), RenderError> {
    let Frame { commands, context, stages, .. } = frame;
    match job.part {
        Part::Tile(_) => job.visibility.record(commands, context, job.backend, job.lights.watch(), stages),
        Part::Pixels(list) => job.visibility.record_list(context, list, stages),
        Part::Rays(cast) => job.visibility.record_rays(context, cast, stages),
    }
}

/// What has to be read back, because the device may have given up: four bytes for [`complete`].
pub(super) fn unfinished(frame: &Frame<'_>, job: &PartJob<'_>) -> Option<wgpu::Buffer> {
    let is_tile = matches!(job.part, Part::Tile(_));
    job.visibility.unfinished(frame.context.gpu, job.backend).filter(|_| is_tile).cloned()
}

/// Fills the visibility buffer in another way, if the device gave up.
pub(super) fn complete(
    frame: &mut Frame<'_>,
    job: &PartJob<'_>,
    unfinished: &[u8],
) -> Result<(), RenderError> {
    let Frame { commands, context, stages, .. } = frame;
    job.visibility.complete(commands, context, unfinished, stages)
}
