//! Program: `shaders/choose_receivers.wgsl`. Selects the sub-samples of a tile that receive light for their
//! neighbours.

use crate::layout::{Blocks, Chosen};
use crate::programs::CHOOSE_RECEIVERS;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use argus_sampler::plug::GBuffer;

/// Most receivers of a block, as in `shaders/shared/receivers.wgsl`.
pub(crate) const OF_BLOCK: usize = 2;

/// One workgroup a block.
pub(crate) struct ChooseReceivers {
    pipeline: ComputePipeline,
}

/// A tile's blocks, on the host and as a uniform.
pub(crate) struct BlockUniform {
    pub(crate) blocks: Blocks,
    pub(crate) uniform: wgpu::Buffer,
}

impl BlockUniform {
    /// The blocks of a tile. `size` and `block` are in sub-samples; light is shared over `reach` blocks.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], block: [u32; 2], reach: u32) -> Self {
        let count = [0, 1].map(|i| size[i].div_ceil(block[i]));
        let blocks = Blocks { size, block, count, reach, _pad: 0 };
        Self { blocks, uniform: gpu.upload("blocks", &[blocks], wgpu::BufferUsages::UNIFORM) }
    }

    /// Number of blocks of the tile.
    pub(crate) fn len(&self) -> usize {
        self.blocks.count.map(|n| n as usize).iter().product()
    }
}

impl ChooseReceivers {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&CHOOSE_RECEIVERS, "choose_receivers") }
    }

    /// Selects up to [`OF_BLOCK`] receivers of each block. Returns a buffer of [`Chosen`], block by block.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        layout: &BlockUniform,
        g_buffer: &GBuffer,
    ) -> wgpu::Buffer {
        let bytes = (layout.len() * OF_BLOCK * size_of::<Chosen>()) as u64;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let chosen = gpu.buffer("chosen receivers", bytes, usage);
        let [columns, rows] = layout.blocks.count;
        commands
            .compute("choose receivers", &self.pipeline)
            .read("blocks", &layout.uniform)
            .read("g_surfaces", &g_buffer.surfaces)
            .write("chosen", &chosen)
            .dispatch([columns, rows, 1]);
        chosen
    }
}
