//! Program: `shaders/compositor/highlight.wgsl`. Adds what a viewer alone sees of glossy surfaces.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Extra, Splatted, Variant};
use crate::passes::mend::groups;

/// The pass: one dispatch a piece, after its left-over pixels are listed.
#[derive(Debug, Default)]
pub(crate) struct HighlightPass(BTreeMap<Variant, ComputePipeline>);

impl HighlightPass {
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        splatted: &Splatted,
    ) -> Result<(), RenderError> {
        // What is written to a range that is not there is dropped: one pipeline does.
        let variant = Variant { range: true, between_levels: false, ..canvas.variant };
        let pipeline = self.0.entry(variant).or_insert_with(|| {
            let program = &argus_shaders::compositor::HIGHLIGHT;
            gpu.compute_pipeline_with(program, variant.entry_point(), &variant.constants())
        });
        let storage = canvas.targets.storage(variant);
        let mut pass = commands.compute_pass("add highlights");
        for draw in canvas.draws {
            let call = pass.call(pipeline).read("view", &draw.view);
            let mut bindings = canvas.shared.bindings()?;
            bindings.push(Extra::read("depths", &splatted.depths));
            bindings.push(Extra::read("unsettled", &splatted.unsettled));
            let call = bindings.iter().chain(&storage).fold(call, |call, extra| extra.bind(call));
            call.dispatch([groups(gpu), 1, 1]);
        }
        Ok(())
    }
}
