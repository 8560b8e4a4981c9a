//! Programs: `shaders/compositor/collect.wgsl` and `mend.wgsl`. Lists the pixels that the warp left over, and tries them in
//! all samples.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::RenderError;

use crate::drawing::{Canvas, Extra, Splatted, Variant};

/// The pass: two dispatches a piece, the list and what is done with it.
#[derive(Debug, Default)]
pub(crate) struct MendPass {
    collect: BTreeMap<&'static str, ComputePipeline>,
    mend: BTreeMap<Variant, ComputePipeline>,
}

/// Invocations of a workgroup; the programs', held to them by test.
const GROUP: u32 = 64;

/// The most of them.
const GROUPS: u32 = 16;

/// Places of a list beside one a pixel: two counts an invocation, and what is rounded up.
pub(crate) const COUNTS: u32 = 3 * GROUP * GROUPS;

/// Workgroups that share a piece's list on this device.
pub(crate) fn groups(gpu: &Gpu) -> u32 {
    // The software driver runs them one after another, and even those that find nothing to do are not free.
    if gpu.is_software() { 1 } else { GROUPS }
}

impl MendPass {
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        canvas: &Canvas<'_>,
        splatted: &Splatted,
    ) -> Result<(), RenderError> {
        // What is written to a range that is not there is dropped: one pipeline does.
        let variant = Variant { range: true, between_levels: false, ..canvas.variant };
        let entry = variant.entry_point();
        let collect = self
            .collect
            .entry(entry)
            .or_insert_with(|| gpu.compute_pipeline(&argus_shaders::compositor::COLLECT, entry));
        let mend = self.mend.entry(variant).or_insert_with(|| {
            gpu.compute_pipeline_with(&argus_shaders::compositor::MEND, entry, &variant.constants())
        });
        let groups = groups(gpu);
        let image = if variant.fine { "linear_image" } else { "shown_image" };
        let mut pass = commands.compute_pass("collect pixels");
        for draw in canvas.draws {
            pass.call(collect)
                .read("view", &draw.view)
                .read(image, &canvas.targets.color.view)
                .write("unsettled", &splatted.unsettled)
                .dispatch([groups, 1, 1]);
        }
        drop(pass);
        let storage = canvas.targets.storage(variant);
        let mut pass = commands.compute_pass("mend pixels");
        for draw in canvas.draws {
            let call = pass.call(mend).read("view", &draw.view);
            let mut bindings = canvas.shared.bindings()?;
            bindings.extend([
                Extra::read("depths", &splatted.depths),
                Extra::write("unsettled", &splatted.unsettled),
                Extra::read("cells", &splatted.cells),
            ]);
            let call = bindings.iter().chain(&storage).fold(call, |call, extra| extra.bind(call));
            call.dispatch([groups, 1, 1]);
        }
        Ok(())
    }
}
