//! Program: `shaders/compositor/warp.wgsl`. Fetches each pixel's colour at its splatted depth.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::{DrawBatch, NamedBinding};
use crate::search_pipelines::SearchPipelines;

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct WarpPass(SearchPipelines);

impl WarpPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "warp views";

    pub(crate) fn new() -> Self {
        Self(SearchPipelines::with_display(&argus_shaders::compositor::WARP, Self::NAME))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        self.0.record(gpu, commands, batch, &[NamedBinding::read("depths", &batch.splat.depths)])
    }
}
