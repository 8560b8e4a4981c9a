//! Program: `shaders/compositor/resolve.wgsl`. Averages the sub-pixels of supersampled views.

use argus_gpu::{ColorTarget, Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_shaders::layout::compositor::Resolve;

use crate::drawing::{RANGE, SHOWN};
use crate::layout::Piece;
use crate::targets::Target;

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct ResolvePass {
    pipeline: RenderPipeline,
}

impl ResolvePass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = gpu.render_pipeline(&RenderPipelineDesc {
            program: &argus_shaders::compositor::RESOLVE,
            vertex: "vertex",
            fragment: Some("average"),
            buffers: &[],
            targets: &[SHOWN, RANGE],
            depth: None,
            primitive: wgpu::PrimitiveState::default(),
            constants: &[],
        });
        Self { pipeline }
    }

    /// Averages pieces of the fine targets into the final ones; each comes with its exposure.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        pieces: &[(Piece, f32)],
        fine: [&Target; 2],
        shown: [&Target; 2],
    ) {
        let colors = shown.map(|target| ColorTarget { view: &target.view, clear: None });
        let mut pass = commands.render("average sub-pixels", &colors, None);
        for (piece, exposure) in pieces {
            let resolve = Resolve {
                source_origin: piece.fine_target(),
                target_origin: piece.target,
                side: piece.side,
                exposure: *exposure,
            };
            pass.viewport(piece.target[0], piece.target[1], piece.part.width, piece.part.height);
            let raw = pass
                .draw(&self.pipeline)
                .read("radiance_target", &fine[0].view)
                .read("range_target", &fine[1].view)
                .begin();
            raw.set_immediates(0, bytemuck::bytes_of(&resolve));
            raw.draw(0..3, 0..1);
        }
    }
}
