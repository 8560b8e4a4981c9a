//! Program: `shaders/sampler/gather.wgsl`. Light that each sub-sample's surface receives from VPLs.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::vpl::{BLOCK, LIST_WORDS};
use argus_shaders::sampler::GATHER;

use crate::scratch::Guides;

/// Memory of a tile's indirect light, kept for the next tile of the same size.
#[derive(Clone)]
pub(crate) struct IndirectScratch {
    size: [u32; 2],
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
        let light = || gpu.buffer("indirect light", all * 16, storage);
        Self {
            size,
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
    /// What shading left of the tile.
    pub(crate) guides: &'a Guides,
    /// What the passes are told, a uniform.
    pub(crate) gathering: wgpu::Buffer,
}

impl Gathered<'_> {
    pub(crate) fn blocks(&self) -> [u32; 2] {
        blocks(self.scratch.size)
    }
}

/// Most arrays that maps are spread over.
pub(crate) const MOST_ARRAYS: usize = 4;

/// How far VPLs see: dual-paraboloid maps.
pub(crate) struct Maps {
    /// One to [`MOST_ARRAYS`] of them.
    pub(crate) arrays: Vec<wgpu::Buffer>,
    /// Maps of one array: 2 to the power of this.
    pub(crate) shift: u32,
    /// Whether texels are inverse distances, 0 where there is nothing, rather than distances.
    pub(crate) inverse: bool,
    /// Metres by which what is in the maps may lie before the surface that it stands for.
    pub(crate) slack: f64,
    /// Of each VPL where its map is seen from, relative to the root, and which map it is.
    pub(crate) eyes: wgpu::Buffer,
}

impl Maps {
    /// Bytes of all.
    pub(crate) fn bytes(&self) -> u64 {
        self.arrays.iter().map(wgpu::Buffer::size).sum()
    }
}

/// Gathers light.
pub(crate) struct Gather {
    pipeline: ComputePipeline,
}

impl Gather {
    /// From VPLs with such maps, or without any.
    pub(crate) fn new(gpu: &Gpu, has_maps: bool, maps: &Maps) -> Self {
        let flag = |set: bool| f64::from(u8::from(set));
        let constants = [
            ("has_maps", flag(has_maps)),
            ("has_inverse_maps", flag(maps.inverse)),
            ("arrays", maps.arrays.len() as f64),
        ];
        Self { pipeline: gpu.compute_pipeline_with(&GATHER, "gather", &constants) }
    }

    /// From the VPLs of the tile's lists.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        gathered: &Gathered<'_>,
        vpls: &wgpu::Buffer,
        maps: &Maps,
    ) {
        let [width, height] = gathered.scratch.size;
        // Arrays that there are not stand behind no texel.
        let array = |i: usize| maps.arrays.get(i).unwrap_or(&maps.arrays[0]);
        let arrays: [&wgpu::Buffer; MOST_ARRAYS] = std::array::from_fn(array);
        commands
            .compute("gather VPLs", &self.pipeline)
            .read("gathering", &gathered.gathering)
            .read("guides", &gathered.guides.surfaces)
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
