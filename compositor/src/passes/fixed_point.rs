//! Program: `shaders/compositor/fixed_point.wgsl`. Searches each pixel's depth by fixed-point iteration, or linearly
//! where that does not converge.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::DrawBatch;
use crate::search_pipelines::SearchPipelines;

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct FixedPointPass(SearchPipelines);

impl FixedPointPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "iterate views";

    pub(crate) fn new() -> Self {
        Self(SearchPipelines::new(&argus_shaders::compositor::FIXED_POINT, Self::NAME))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        self.0.record(gpu, commands, batch, &[])
    }
}
