//! Program: `shaders/compositor/fill.wgsl`. Fills gaps between cells of one surface.

use argus_gpu::{Commands, ComputePipeline, Gpu};

use crate::chunk::ChunkInputs;

/// One dispatch a piece.
#[derive(Debug)]
pub(crate) struct FillPass {
    pipeline: ComputePipeline,
}

impl FillPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::FILL, "fill_cell") }
    }

    pub(crate) fn record(&self, commands: &mut Commands, inputs: &ChunkInputs) {
        let [x, y, _] = self.pipeline.workgroup_size();
        commands
            .compute("fill cells", &self.pipeline)
            .read("cells", &inputs.splat.cells)
            .write("depths", &inputs.splat.depths)
            .each(|pass| {
                for call in inputs.fills() {
                    let groups = [(call.columns as u32).div_ceil(x), (call.rows as u32).div_ceil(y)];
                    pass.set_immediates(0, bytemuck::bytes_of(&call));
                    pass.dispatch_workgroups(groups[0], groups[1], 1);
                }
            });
    }
}
