//! Program: `shaders/compositor/splat.wgsl`. Projects the texels of samples into the cells of a view.

use argus_gpu::quirks::MAX_WORKGROUPS;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::Splat;

use crate::draw_batch::{SplatBuffers, SplatCall};
use crate::pool::Pool;

/// One dispatch a view, sample and face.
#[derive(Debug)]
pub(crate) struct SplatPass {
    points: ComputePipeline,
    squares: ComputePipeline,
}

impl SplatPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&argus_shaders::compositor::SPLAT, entry);
        Self { points: pipeline("splat_block"), squares: pipeline("splat_squares") }
    }

    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        splat: &SplatBuffers,
        blocks: &wgpu::Buffer,
        calls: &[SplatCall],
        pool: &Pool,
    ) -> Result<(), RenderError> {
        for (name, pipeline, sparse) in
            [("splat samples", &self.points, false), ("splat squares", &self.squares, true)]
        {
            if !calls.iter().any(|call| call.sparse == sparse) {
                continue;
            }
            commands
                .compute(name, pipeline)
                .read("inverse_range", pool.view(PlaneKind::InverseRange)?)
                .read("blocks", blocks)
                .write("cells", &splat.cells)
                .each(|pass| {
                    for call in calls.iter().filter(|call| call.sparse == sparse) {
                        for begin in (0..call.block_count).step_by(MAX_WORKGROUPS as usize) {
                            let splat = Splat { first_block: call.splat.first_block + begin, ..call.splat };
                            pass.set_immediates(0, bytemuck::bytes_of(&splat));
                            pass.dispatch_workgroups((call.block_count - begin).min(MAX_WORKGROUPS), 1, 1);
                        }
                    }
                });
        }
        Ok(())
    }
}
