//! Program: `shaders/cull_vpls.wgsl`. Culls groups of VPLs that cannot light a block of a tile.

use crate::programs::CULL_VPLS;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use super::gather::Gathered;

/// One workgroup a block.
pub(crate) struct CullVpls {
    pipeline: ComputePipeline,
}

impl CullVpls {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&CULL_VPLS, "cull_vpls") }
    }

    /// Fills the lists of a tile's blocks. Adds to `kept` the number of blocks with surfaces and of groups that they
    /// kept.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        gathered: &Gathered<'_>,
        nodes: &wgpu::Buffer,
        kept: &wgpu::Buffer,
    ) {
        let [columns, rows] = gathered.blocks();
        commands
            .compute("cull VPLs", &self.pipeline)
            .read("gathering", &gathered.gathering)
            .read("g_surfaces", &gathered.g_buffer.surfaces)
            .read("nodes", nodes)
            .write("lists", &gathered.scratch.lists)
            .write("kept", kept)
            .dispatch_threads([columns * rows, 1, 1]);
    }
}
