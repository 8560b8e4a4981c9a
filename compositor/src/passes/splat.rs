//! Program: `shaders/compositor/splat.wgsl`. Projects the texels of samples into the cells of a view.

use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_scene::{PlaneKind, RenderError};
use argus_shaders::layout::compositor::Splat;

use crate::chunk::ChunkInputs;
use crate::pool::Pool;

/// One dispatch a view, sample and face.
#[derive(Debug)]
pub(crate) struct SplatPass {
    points: ComputePipeline,
    squares: ComputePipeline,
}

/// One dispatch.
#[derive(Debug)]
pub(crate) struct SplatCall {
    pub(crate) splat: Splat,
    pub(crate) block_count: u32,
    /// Whether texels are farther apart than cells, so that they are splatted as squares.
    pub(crate) sparse: bool,
}

/// Most workgroups of a dispatch in one dimension. A splat has one a block of texels.
const MAX_GROUPS: u32 = 65_535;

impl SplatPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&argus_shaders::compositor::SPLAT, entry);
        Self { points: pipeline("splat_block"), squares: pipeline("splat_squares") }
    }

    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        inputs: &ChunkInputs,
        pool: &Pool,
    ) -> Result<(), RenderError> {
        let calls = &inputs.splats;
        for (name, pipeline, sparse) in
            [("splat samples", &self.points, false), ("splat squares", &self.squares, true)]
        {
            if !calls.iter().any(|call| call.sparse == sparse) {
                continue;
            }
            commands
                .compute(name, pipeline)
                .read("inverse_range", pool.view(PlaneKind::InverseRange)?)
                .read("blocks", &inputs.blocks)
                .write("cells", &inputs.splat.cells)
                .each(|pass| {
                    for call in calls.iter().filter(|call| call.sparse == sparse) {
                        for begin in (0..call.block_count).step_by(MAX_GROUPS as usize) {
                            let splat = Splat { first_block: call.splat.first_block + begin, ..call.splat };
                            pass.set_immediates(0, bytemuck::bytes_of(&splat));
                            pass.dispatch_workgroups((call.block_count - begin).min(MAX_GROUPS), 1, 1);
                        }
                    }
                });
        }
        Ok(())
    }
}
