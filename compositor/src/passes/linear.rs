//! Program: `shaders/compositor/linear.wgsl`. The linear search of the cluster paper (section 4.2).

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::DrawBatch;
use crate::search_pipelines::SearchPipelines;

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct LinearPass(SearchPipelines);

impl LinearPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "search views";

    pub(crate) fn new() -> Self {
        Self(SearchPipelines::new(&argus_shaders::compositor::LINEAR, Self::NAME))
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
