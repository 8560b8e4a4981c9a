//! Program: `shaders/compositor/fill.wgsl`. Fills gaps between cells of one surface.

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_shaders::layout::compositor::Fill;

use crate::draw_batch::SplatBuffers;

/// One dispatch a piece.
#[derive(Debug)]
pub(crate) struct FillPass {
    pipeline: ComputePipeline,
}

impl FillPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::FILL, "fill_cell") }
    }

    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        splat: &SplatBuffers,
        fills: impl Iterator<Item = Fill>,
    ) {
        let [x, y, _] = self.pipeline.workgroup_size();
        commands
            .compute("fill cells", &self.pipeline)
            .read("cells", &splat.cells)
            .write("depths", &splat.depths)
            .each(|pass| {
                for call in fills {
                    let groups = [(call.columns as u32).div_ceil(x), (call.rows as u32).div_ceil(y)];
                    pass.set_immediates(0, bytemuck::bytes_of(&call));
                    pass.dispatch_workgroups(groups[0], groups[1], 1);
                }
            });
    }
}
