//! Program: `shaders/compositor/reproject.wgsl`. Projects the pixels of an earlier frame into the cells of a view.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::compositor::Reproject;

use crate::draw_batch::SplatBuffers;

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

    /// Reads `words`, the pixels of earlier frames. Records nothing if no piece starts from one.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        splat: &SplatBuffers,
        words: &wgpu::Buffer,
        calls: &[Reproject],
    ) {
        if calls.is_empty() {
            return;
        }
        let [x, y, _] = self.pipeline.workgroup_size();
        commands.compute(Self::NAME, &self.pipeline).read("words", words).write("cells", &splat.cells).each(
            |pass| {
                for call in calls {
                    pass.set_immediates(0, bytemuck::bytes_of(call));
                    pass.dispatch_workgroups(call.columns.div_ceil(x), call.rows.div_ceil(y), 1);
                }
            },
        );
    }
}
