//! Program: `shaders/compositor/seeded.wgsl`. Fixed-point iteration from the depths of a coarse splat or of an earlier
//! frame.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::{DrawBatch, NamedBinding};
use crate::search_pipelines::SearchPipelines;

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct SeededPass(SearchPipelines);

impl SeededPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "refine views";

    pub(crate) fn new() -> Self {
        Self(SearchPipelines::new(&argus_shaders::compositor::SEEDED, Self::NAME))
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
