//! Program: `shaders/compositor/mend.wgsl`. Tries pixels that the warp left over in all samples.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Extra, Splatted, Variant};

/// The pass: one dispatch a piece.
#[derive(Debug, Default)]
pub(crate) struct MendPass(BTreeMap<Variant, ComputePipeline>);

impl MendPass {
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        splatted: &Splatted,
    ) -> Result<(), RenderError> {
        // What is written to a range that is not there is dropped: one pipeline does.
        let variant = Variant { range: true, ..canvas.variant };
        let pipeline = self.0.entry(variant).or_insert_with(|| {
            let program = &argus_shaders::compositor::MEND;
            gpu.compute_pipeline_with(program, variant.entry_point(), &variant.constants())
        });
        let mut bindings = canvas.shared.bindings()?;
        bindings.extend([
            Extra::read("depths", &splatted.depths),
            Extra::read("unsettled", &splatted.unsettled),
            Extra::read("cells", &splatted.cells),
        ]);
        // Workgroups that share a piece's list. Its length is only known on the device, and an indirect dispatch costs
        // more than workgroups that find nothing to do; on a software driver even those are not free.
        let groups = if gpu.is_software() { 1 } else { 16 };
        let storage = canvas.targets.storage(variant);
        let mut pass = commands.compute_pass("mend pixels");
        for draw in canvas.draws {
            let mut call = pass.call(pipeline).read("view", &draw.view);
            for extra in &bindings {
                call = call.read(extra.name, extra.resource);
            }
            for extra in &storage {
                call = call.write(extra.name, extra.resource);
            }
            call.dispatch([groups, 1, 1]);
        }
        Ok(())
    }
}
