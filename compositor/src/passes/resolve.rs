//! Program: `shaders/compositor/resolve.wgsl`. Averages the sub-pixels of supersampled views.

use argus_gpu::{ColorTarget, Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_shaders::layout::compositor::Resolve;

use crate::drawing::{CONFIDENCE, Drawn, RANGE, SHOWN};
use crate::layout::Piece;

/// The pass: one draw a piece.
#[derive(Debug)]
pub(crate) struct ResolvePass {
    /// Without confidence, and with it.
    pipelines: [RenderPipeline; 2],
}

impl ResolvePass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |targets| {
            gpu.render_pipeline(&RenderPipelineDesc {
                program: &argus_shaders::compositor::RESOLVE,
                vertex: "vertex",
                fragment: Some("average"),
                buffers: &[],
                targets,
                depth: None,
                primitive: wgpu::PrimitiveState::default(),
                constants: &[],
            })
        };
        Self { pipelines: [pipeline(&[SHOWN, RANGE][..]), pipeline(&[SHOWN, RANGE, CONFIDENCE])] }
    }

    /// Averages pieces of the fine targets into the final ones; each comes with its exposure.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        pieces: &[(Piece, f32)],
        confident: bool,
        fine: Drawn<'_>,
        shown: Drawn<'_>,
    ) {
        let pipeline = &self.pipelines[usize::from(confident)];
        let colors =
            [shown.color, shown.range, shown.confidence].map(|t| ColorTarget { view: &t.view, clear: None });
        let colors = if confident { &colors[..] } else { &colors[..2] };
        let mut pass = commands.render("average sub-pixels", colors, None);
        for (piece, exposure) in pieces {
            let resolve = Resolve {
                source_origin: piece.fine_target(),
                target_origin: piece.target,
                side: piece.side,
                exposure: *exposure,
            };
            pass.viewport(piece.target[0], piece.target[1], piece.part.width, piece.part.height);
            let raw = pass
                .draw(pipeline)
                .read("radiance_target", &fine.color.view)
                .read("range_target", &fine.range.view)
                .read("confidence_target", &fine.confidence.view)
                .begin();
            raw.set_immediates(0, bytemuck::bytes_of(&resolve));
            raw.draw(0..3, 0..1);
        }
    }
}
