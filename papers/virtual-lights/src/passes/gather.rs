//! Program: `shaders/gather.wgsl`. Gathers light from VPLs at each sub-sample.

use crate::layout::vpl::{BLOCK, LIST_WORDS};
use crate::programs::GATHER;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use argus_sampler::plug::GBuffer;

/// Buffers of a tile's indirect light, reused for tiles of the same size.
#[derive(Clone)]
pub(crate) struct IndirectScratch {
    size: [u32; 2],
    /// List of VPL groups of each block.
    pub(crate) lists: wgpu::Buffer,
    /// Irradiance / π: as gathered, and after the filter's rows.
    pub(crate) light: [wgpu::Buffer; 2],
}

impl IndirectScratch {
    /// Buffers for `size` sub-samples.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let all = u64::from(size[0]) * u64::from(size[1]);
        let [columns, rows] = blocks(size).map(u64::from);
        let storage = wgpu::BufferUsages::STORAGE;
        let light = || gpu.buffer("indirect light", all * 16, storage);
        Self {
            size,
            lists: gpu.buffer("lists of VPLs", columns * rows * u64::from(LIST_WORDS) * 4, storage),
            light: [light(), light()],
        }
    }

    /// Size in sub-samples.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }
}

/// Number of blocks of a tile: columns, rows.
pub(crate) fn blocks(size: [u32; 2]) -> [u32; 2] {
    size.map(|n| n.div_ceil(BLOCK))
}

/// Inputs of a tile.
pub(crate) struct Gathered<'a> {
    pub(crate) scratch: &'a IndirectScratch,
    /// Surfaces of the tile's sub-samples.
    pub(crate) g_buffer: &'a GBuffer,
    /// Uniform of the passes.
    pub(crate) gathering: wgpu::Buffer,
}

impl Gathered<'_> {
    pub(crate) fn blocks(&self) -> [u32; 2] {
        blocks(self.scratch.size)
    }
}

/// Most arrays that maps are stored in.
pub(crate) const MOST_ARRAYS: usize = 4;

/// Dual-paraboloid maps of distance around VPLs.
pub(crate) struct Maps {
    /// One to [`MOST_ARRAYS`] arrays.
    pub(crate) arrays: Vec<wgpu::Buffer>,
    /// Base-2 logarithm of the number of maps in one array.
    pub(crate) shift: u32,
    /// Whether texels are inverse distances (0 for none); otherwise distances.
    pub(crate) inverse: bool,
    /// Most metres by which a map's texel may lie in front of its surface.
    pub(crate) slack: f64,
    /// For each VPL the centre of its map, relative to the root, and the index of the map.
    pub(crate) eyes: wgpu::Buffer,
}

impl Maps {
    /// Bytes of all maps.
    pub(crate) fn bytes(&self) -> u64 {
        self.arrays.iter().map(wgpu::Buffer::size).sum()
    }
}

/// One invocation a sub-sample.
pub(crate) struct Gather {
    pipeline: ComputePipeline,
}

impl Gather {
    /// Pipelines for VPLs with these maps, or without maps.
    pub(crate) fn new(gpu: &Gpu, has_maps: bool, maps: &Maps) -> Self {
        let flag = |set: bool| f64::from(u8::from(set));
        let constants = [
            ("has_maps", flag(has_maps)),
            ("has_inverse_maps", flag(maps.inverse)),
            ("arrays", maps.arrays.len() as f64),
        ];
        Self { pipeline: gpu.compute_pipeline_with(&GATHER, "gather", &constants) }
    }

    /// Gathers from the VPLs of the tile's lists.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        gathered: &Gathered<'_>,
        vpls: &wgpu::Buffer,
        maps: &Maps,
    ) {
        let [width, height] = gathered.scratch.size;
        // Missing arrays are never read.
        let array = |i: usize| maps.arrays.get(i).unwrap_or(&maps.arrays[0]);
        let arrays: [&wgpu::Buffer; MOST_ARRAYS] = std::array::from_fn(array);
        commands
            .compute("gather VPLs", &self.pipeline)
            .read("gathering", &gathered.gathering)
            .read("g_surfaces", &gathered.g_buffer.surfaces)
            .read("vpls", vpls)
            .read("lists", &gathered.scratch.lists)
            .read("eyes", &maps.eyes)
            .read("maps0", arrays[0])
            .read("maps1", arrays[1])
            .read("maps2", arrays[2])
            .read("maps3", arrays[3])
            .write("gathered", &gathered.scratch.light[0])
            .dispatch_threads([width, height, 1]);
    }
}
