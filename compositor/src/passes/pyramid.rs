//! Program: `shaders/compositor/pyramid.wgsl`. Follows each pixel's ray through pyramids of the samples' nearest
//! surfaces.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Drawing, Extra};

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct PyramidPass(Drawing);

impl PyramidPass {
    /// Its row in the timing table.
    pub(crate) const NAME: &str = "follow rays";

    pub(crate) fn new() -> Self {
        Self(Drawing::new(&argus_shaders::compositor::PYRAMID, Self::NAME))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
    ) -> Result<(), RenderError> {
        let extras = [Extra::read("nearest_surfaces", canvas.shared.pool.pyramids()?)];
        self.0.record(gpu, commands, canvas, &extras)
    }
}
