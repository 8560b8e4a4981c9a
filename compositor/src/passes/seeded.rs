//! Program: `shaders/compositor/seeded.wgsl`. Fixed-point steps from what a coarse splat left.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Drawing, Extra, Splatted};

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct SeededPass(Drawing);

impl SeededPass {
    /// Its row in the timing table.
    pub(crate) const NAME: &str = "refine views";

    pub(crate) fn new() -> Self {
        Self(Drawing::new(&argus_shaders::compositor::SEEDED, Self::NAME))
    }

    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        splatted: &Splatted,
    ) -> Result<(), RenderError> {
        self.0.record(gpu, commands, canvas, &[Extra::read("depths", &splatted.depths)])
    }
}
