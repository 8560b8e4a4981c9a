//! Program: `shaders/compositor/linear.wgsl`. The cluster paper's search, and the fetch at
//! what it found.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Draw, Pipelines, Shared, Variant, draw_pieces};
use crate::targets::Target;

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct LinearPass(Pipelines);

impl LinearPass {
    pub(crate) fn new() -> Self {
        Self(Pipelines::new(&argus_shaders::compositor::LINEAR))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        variant: Variant,
        shared: &Shared<'_>,
        draws: &[Draw<'_>],
        targets: [&Target; 2],
    ) -> Result<(), RenderError> {
        let pipeline = self.0.get(gpu, variant);
        draw_pieces(commands, "search views", pipeline, variant, shared, draws, targets)
    }
}
