//! Program: `shaders/compositor/warp.wgsl`. Fetches each pixel's colour at the depth that was splatted for it.

use argus_gpu::{Commands, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Drawing, Extra, Splatted};

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct WarpPass(Drawing);

impl WarpPass {
    /// Its row in the timing table.
    pub(crate) const NAME: &str = "warp views";

    pub(crate) fn new() -> Self {
        Self(Drawing::of_display(&argus_shaders::compositor::WARP, Self::NAME))
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
