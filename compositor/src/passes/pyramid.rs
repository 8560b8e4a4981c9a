//! Program: `shaders/compositor/pyramid.wgsl`. Marches each pixel's ray through pyramids of the samples' nearest
//! surfaces.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::{DrawBatch, NamedBinding};
use crate::search_pipelines::SearchPipelines;

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct PyramidPass(SearchPipelines);

impl PyramidPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "follow rays";

    pub(crate) fn new() -> Self {
        Self(SearchPipelines::new(&argus_shaders::compositor::PYRAMID, Self::NAME))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        let extras = [NamedBinding::read("nearest_surfaces", batch.shared.pool.pyramids()?)];
        self.0.record(gpu, commands, batch, &extras)
    }
}
