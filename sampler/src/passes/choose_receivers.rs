//! Program: `shaders/sampler/choose_receivers.wgsl`. Which sub-samples of a tile receive light for those around them.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::{Blocks, Chosen};
use argus_shaders::sampler::CHOOSE_RECEIVERS;

use crate::scratch::Guides;

/// Receivers of a block, at most; as `shaders/shared/receivers.wgsl` has it.
pub(crate) const OF_BLOCK: usize = 2;

/// Chooses receivers.
pub(crate) struct ChooseReceivers {
    pipeline: ComputePipeline,
}

/// A tile's blocks, and the same as a uniform.
pub(crate) struct BlockUniform {
    pub(crate) blocks: Blocks,
    pub(crate) uniform: wgpu::Buffer,
}

impl BlockUniform {
    /// Of a tile of `size` sub-samples in blocks of `block`, whose light reaches `reach` blocks far.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], block: [u32; 2], reach: u32) -> Self {
        let count = [0, 1].map(|i| size[i].div_ceil(block[i]));
        let blocks = Blocks { size, block, count, reach, _pad: 0 };
        Self { blocks, uniform: gpu.upload("blocks", &[blocks], wgpu::BufferUsages::UNIFORM) }
    }

    /// Blocks of the tile.
    pub(crate) fn len(&self) -> usize {
        self.blocks.count.map(|n| n as usize).iter().product()
    }
}

impl ChooseReceivers {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&CHOOSE_RECEIVERS, "choose_receivers") }
    }

    /// Up to [`OF_BLOCK`] of each block, as [`Chosen`], block by block.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        layout: &BlockUniform,
        guides: &Guides,
    ) -> wgpu::Buffer {
        let bytes = (layout.len() * OF_BLOCK * size_of::<Chosen>()) as u64;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let chosen = gpu.buffer("chosen receivers", bytes, usage);
        let [columns, rows] = layout.blocks.count;
        commands
            .compute("choose receivers", &self.pipeline)
            .read("blocks", &layout.uniform)
            .read("guides", &guides.surfaces)
            .write("chosen", &chosen)
            .dispatch([columns, rows, 1]);
        chosen
    }
}
