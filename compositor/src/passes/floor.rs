//! Program: `shaders/compositor/floor.wgsl`. One colour fetch a pixel: what the searches are measured by.

use std::collections::BTreeMap;

use argus_gpu::{Commands, Gpu, RenderPipeline, RenderPipelineDesc, wgpu};
use argus_scene::{PlaneKind, RenderError};

use crate::drawing::{Canvas, Variant};

/// The pass: one draw a piece.
#[derive(Debug, Default)]
pub(crate) struct FloorPass(BTreeMap<(bool, bool), RenderPipeline>);

impl FloorPass {
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
    ) -> Result<(), RenderError> {
        let variant = Variant { confident: false, between_levels: false, ..canvas.variant };
        let pipeline = self.0.entry((variant.fine, variant.range)).or_insert_with(|| {
            gpu.render_pipeline(&RenderPipelineDesc {
                program: &argus_shaders::compositor::FLOOR,
                vertex: "vertex",
                fragment: Some(variant.entry_point()),
                buffers: &[],
                targets: &variant.formats(),
                depth: None,
                primitive: wgpu::PrimitiveState::default(),
                constants: &[],
            })
        });
        let targets = canvas.targets.attachments(variant);
        let radiance = canvas.shared.pool.view(PlaneKind::Radiance)?;
        let mut pass = commands.render("fetch colours", &targets, None);
        for draw in canvas.draws {
            let [x, y] = draw.piece.fine_target();
            let [width, height] = draw.piece.fine_size();
            pass.viewport(x, y, width, height);
            pass.draw(pipeline)
                .read("view", &draw.view)
                .read("radiance", radiance)
                .read("nearest", canvas.shared.nearest)
                .vertices(0..3, 0..1);
        }
        Ok(())
    }
}
