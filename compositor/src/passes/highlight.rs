//! Program: `shaders/compositor/highlight.wgsl`. Adds view-dependent reflection to glossy pixels.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::{DrawBatch, NamedBinding, Variant};
use crate::passes::second_pass::groups;

/// One dispatch a piece, after the second pass has listed its glossy pixels.
#[derive(Debug, Default)]
pub(crate) struct HighlightPass(BTreeMap<Variant, ComputePipeline>);

impl HighlightPass {
    /// Records nothing if the samples are not glossy.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        if !batch.variant.glossy {
            return Ok(());
        }
        let variant = Variant { between_levels: false, ..batch.variant.of_compute() };
        let pipeline = self.0.entry(variant).or_insert_with(|| {
            let program = &argus_shaders::compositor::HIGHLIGHT;
            gpu.compute_pipeline_with(program, "add_highlights", &variant.constants())
        });
        let (storage, splat) = (batch.storage(), batch.splat);
        let mut pass = commands.compute_pass("add highlights");
        for draw in batch.pieces {
            let call = pass.call(pipeline).read("view", &draw.view);
            let mut bindings = batch.shared.bindings()?;
            bindings.push(NamedBinding::read("depths", &splat.depths));
            bindings.push(NamedBinding::read("unsettled", &splat.unsettled));
            let call = bindings.iter().chain(&storage).fold(call, |call, binding| binding.bind(call));
            call.dispatch([groups(gpu), 1, 1]);
        }
        Ok(())
    }
}
