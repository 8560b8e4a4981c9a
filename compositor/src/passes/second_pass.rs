//! Programs: `shaders/compositor/collect.wgsl` and `second_pass.wgsl`. Lists the pixels that the warp did not settle, and looks
//! them up in all samples.

use std::collections::BTreeMap;

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::RenderError;

use crate::draw_batch::{DrawBatch, NamedBinding, Variant};

/// Two dispatches a piece: list the pixels, then look them up.
#[derive(Debug, Default)]
pub(crate) struct SecondPass {
    /// By [`Variant::linear`].
    collect: BTreeMap<bool, ComputePipeline>,
    look_up: BTreeMap<Variant, ComputePipeline>,
}

/// Invocations of a workgroup, as the programs declare.
const GROUP: u32 = 64;

/// Most workgroups of a dispatch.
const GROUPS: u32 = 16;

/// Words of a piece's list beside one a pixel: two counters an invocation, and rounding.
pub(crate) const COUNTER_WORDS: u32 = 3 * GROUP * GROUPS;

/// Workgroups of a dispatch on this device.
pub(crate) fn groups(gpu: &Gpu) -> u32 {
    gpu.list_workgroups(GROUPS)
}

impl SecondPass {
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        batch: &DrawBatch<'_>,
    ) -> Result<(), RenderError> {
        let variant = Variant { between_levels: false, ..batch.variant.of_compute() };
        let collect = self.collect.entry(variant.linear).or_insert_with(|| {
            let constants = [("linear", f64::from(u8::from(variant.linear)))];
            gpu.compute_pipeline_with(&argus_shaders::compositor::COLLECT, "collect_pixels", &constants)
        });
        let look_up = self.look_up.entry(variant).or_insert_with(|| {
            gpu.compute_pipeline_with(
                &argus_shaders::compositor::SECOND_PASS,
                "look_up_pixels",
                &variant.constants(),
            )
        });
        let (targets, splat) = (batch.targets.drawn(), batch.splat);
        let groups = groups(gpu);
        let mut pass = commands.compute_pass("collect pixels");
        for draw in batch.pieces {
            pass.call(collect)
                .read("view", &draw.view)
                .read("srgb_image", &targets.srgb.view)
                .read("linear_image", &targets.linear.view)
                .write("unsettled", &splat.unsettled)
                .dispatch([groups, 1, 1]);
        }
        drop(pass);
        let storage = batch.storage();
        let mut pass = commands.compute_pass("second pass");
        for draw in batch.pieces {
            let call = pass.call(look_up).read("view", &draw.view);
            let mut bindings = batch.shared.bindings()?;
            bindings.extend([
                NamedBinding::read("depths", &splat.depths),
                NamedBinding::write("unsettled", &splat.unsettled),
                NamedBinding::read("cells", &splat.cells),
            ]);
            let call = bindings.iter().chain(&storage).fold(call, |call, binding| binding.bind(call));
            call.dispatch([groups, 1, 1]);
        }
        Ok(())
    }
}
