//! Program: `shaders/compositor/reproject.wgsl`. Projects the pixels of an earlier frame into the cells of a view.

use argus_gpu::{Commands, ComputePipeline, Gpu};

use crate::chunk::ChunkInputs;

/// One dispatch a piece.
#[derive(Debug)]
pub(crate) struct ReprojectPass {
    pipeline: ComputePipeline,
}

impl ReprojectPass {
    /// Row in the timing table.
    pub(crate) const NAME: &str = "reproject frames";

    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::REPROJECT, "reproject_pixel") }
    }

    /// Records nothing if no piece starts from an earlier frame.
    pub(crate) fn record(&self, commands: &mut Commands, inputs: &ChunkInputs) {
        if inputs.reprojects.is_empty() {
            return;
        }
        let [x, y, _] = self.pipeline.workgroup_size();
        commands
            .compute(Self::NAME, &self.pipeline)
            .read("words", &inputs.words)
            .write("cells", &inputs.splat.cells)
            .each(|pass| {
                for call in &inputs.reprojects {
                    pass.set_immediates(0, bytemuck::bytes_of(call));
                    pass.dispatch_workgroups(call.columns.div_ceil(x), call.rows.div_ceil(y), 1);
                }
            });
    }
}
