//! Program: `shaders/sampler/gather.wgsl`. Light that each sub-sample's surface receives from VPLs.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::vpl::{BLOCK, LIST_WORDS};
use argus_shaders::sampler::GATHER;

/// Memory of a tile's indirect light, kept for the next tile of the same size.
#[derive(Clone)]
pub(crate) struct IndirectScratch {
    size: [u32; 2],
    /// What shading leaves of each sub-sample's surface: position and normal.
    pub(crate) guides: wgpu::Buffer,
    /// And its albedo.
    pub(crate) albedos: wgpu::Buffer,
    /// VPLs that each block may be lit by.
    pub(crate) lists: wgpu::Buffer,
    /// Irradiance by π, as it was gathered and as the filter's rows leave it.
    pub(crate) light: [wgpu::Buffer; 2],
}

impl IndirectScratch {
    /// For that many sub-samples.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let all = u64::from(size[0]) * u64::from(size[1]);
        let [columns, rows] = blocks(size).map(u64::from);
        let storage = wgpu::BufferUsages::STORAGE;
        let cleared = storage | wgpu::BufferUsages::COPY_DST;
        let light = || gpu.buffer("indirect light", all * 16, storage);
        Self {
            size,
            guides: gpu.buffer("guides", all * 16, cleared),
            albedos: gpu.buffer("guide albedos", all * 4, storage),
            lists: gpu.buffer("lists of VPLs", columns * rows * u64::from(LIST_WORDS) * 4, storage),
            light: [light(), light()],
        }
    }

    /// The sub-samples that it is for.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }
}

/// Blocks of a tile: columns, rows.
pub(crate) fn blocks(size: [u32; 2]) -> [u32; 2] {
    size.map(|n| n.div_ceil(BLOCK))
}

/// A tile whose light is gathered.
pub(crate) struct Gathered<'a> {
    pub(crate) scratch: &'a IndirectScratch,
    /// What the passes are told, a uniform.
    pub(crate) gathering: wgpu::Buffer,
}

impl Gathered<'_> {
    pub(crate) fn blocks(&self) -> [u32; 2] {
        blocks(self.scratch.size)
    }
}

/// Gathers light.
pub(crate) struct Gather {
    pipeline: ComputePipeline,
}

impl Gather {
    /// From VPLs that have maps, or have none.
    pub(crate) fn new(gpu: &Gpu, has_maps: bool) -> Self {
        let constants = [("has_maps", f64::from(u8::from(has_maps)))];
        Self { pipeline: gpu.compute_pipeline_with(&GATHER, "gather", &constants) }
    }

    /// From the VPLs of the tile's lists.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        gathered: &Gathered<'_>,
        vpls: &wgpu::Buffer,
        maps: &wgpu::Buffer,
    ) {
        let [width, height] = gathered.scratch.size;
        commands
            .compute("gather VPLs", &self.pipeline)
            .read("gathering", &gathered.gathering)
            .read("guides", &gathered.scratch.guides)
            .read("vpls", vpls)
            .read("lists", &gathered.scratch.lists)
            .read("maps", maps)
            .write("gathered", &gathered.scratch.light[0])
            .dispatch_threads([width, height, 1]);
    }
}
