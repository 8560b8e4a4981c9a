//! Program: `shaders/compositor/resolve.wgsl`. Averages the sub-pixels of supersampled views.

use argus_gpu::{ColorTarget, Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_scene::Output;
use argus_shaders::layout::compositor::Resolve;

use crate::layout::{Chunk, Piece};
use crate::targets::{CONFIDENCE_FORMAT, ChunkTargets, RANGE_FORMAT, SRGB_FORMAT};

/// One draw a piece.
#[derive(Debug)]
pub(crate) struct ResolvePass {
    /// Without and with confidence.
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
        let formats = [SRGB_FORMAT, RANGE_FORMAT, CONFIDENCE_FORMAT];
        Self { pipelines: [pipeline(&formats[..2]), pipeline(&formats)] }
    }

    /// Averages sub-pixels into pixels. `exposure` is the factor of a piece from radiance to display-linear. Records
    /// nothing if the chunk is not supersampled.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        chunk: &Chunk,
        exposure: impl Fn(&Piece) -> f32,
        targets: &ChunkTargets,
    ) {
        let ChunkTargets { pixels, sub_pixels: Some(sub_pixels), outputs } = targets else { return };
        let pipeline = &self.pipelines[usize::from(outputs.has(Output::Confidence))];
        let colors = [&pixels.srgb, &pixels.range, &pixels.confidence]
            .map(|target| ColorTarget { view: &target.view, clear: None });
        let colors = if outputs.has(Output::Confidence) { &colors[..] } else { &colors[..2] };
        let mut pass = commands.render("average sub-pixels", colors, None);
        for piece in &chunk.pieces {
            let resolve = Resolve {
                source_origin: piece.fine_target(),
                target_origin: piece.target,
                side: piece.side,
                exposure: exposure(piece),
            };
            pass.viewport(piece.target[0], piece.target[1], piece.part.width, piece.part.height);
            let raw = pass
                .draw(pipeline)
                .read("radiance_target", &sub_pixels.linear.view)
                .read("range_target", &sub_pixels.range.view)
                .read("confidence_target", &sub_pixels.confidence.view)
                .begin();
            raw.set_immediates(0, bytemuck::bytes_of(&resolve));
            raw.draw(0..3, 0..1);
        }
    }
}
