//! Program: `shaders/compositor/build_pyramid.wgsl`. Builds the pyramid of a sample's nearest surfaces.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::compositor::BuildPyramid;

/// One dispatch a sample, when a pyramid search first reads it.
#[derive(Debug)]
pub(crate) struct BuildPyramidPass {
    pipeline: ComputePipeline,
}

/// Texels on a side of the tile that a workgroup reduces to one cell.
pub(crate) const TILE: u32 = 64;

impl BuildPyramidPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&argus_shaders::compositor::BUILD_PYRAMID, "build_tile") }
    }

    /// Builds all levels of the sample in a layer. `size` is in texels.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        inverse_range: &wgpu::TextureView,
        size: [u32; 2],
        levels: &wgpu::TextureView,
        layer: u32,
    ) {
        let [width, height] = size;
        commands
            .compute("make pyramid", &self.pipeline)
            .read("inverse_range", inverse_range)
            .write("levels", levels)
            .immediates(bytemuck::bytes_of(&BuildPyramid { layer, width, height }))
            .dispatch([width.div_ceil(TILE), height.div_ceil(TILE), 1]);
    }
}
