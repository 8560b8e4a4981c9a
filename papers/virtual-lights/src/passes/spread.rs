//! Program: `shaders/spread.wgsl`. Interpolates the receivers' light at sub-samples.

use crate::programs::SPREAD;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use super::BlockUniform;
use argus_sampler::plug::{GBuffer, TileContext};

/// One invocation a sub-sample.
pub(crate) struct Spread {
    pipeline: ComputePipeline,
}

/// Inputs.
pub(crate) struct SpreadFrom<'a> {
    pub(crate) layout: &'a BlockUniform,
    pub(crate) g_buffer: &'a GBuffer,
    /// Two words a block: indices of its receivers.
    pub(crate) of_blocks: &'a wgpu::Buffer,
    pub(crate) receivers: &'a wgpu::Buffer,
    /// Irradiance / π and mean inverse distance of each receiver.
    pub(crate) received: &'a wgpu::Buffer,
}

impl Spread {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&SPREAD, "spread") }
    }

    /// Adds the reflected light to radiance.
    pub(crate) fn record(&self, commands: &mut Commands, context: &TileContext<'_>, from: &SpreadFrom<'_>) {
        let [width, height] = from.layout.blocks.size;
        commands
            .compute("spread light", &self.pipeline)
            .read("blocks", &from.layout.uniform)
            .read("g_surfaces", &from.g_buffer.surfaces)
            .read("g_materials", &from.g_buffer.materials)
            .read("of_blocks", from.of_blocks)
            .read("receivers", from.receivers)
            .read("received", from.received)
            .write("shaded", &context.targets.shaded)
            .dispatch_threads([width, height, 1]);
    }
}
