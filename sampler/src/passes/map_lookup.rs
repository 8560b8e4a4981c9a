//! Program: `shaders/sampler/map_lookup.wgsl`. What the sub-samples of an omni sample see, by its camera's map.

use argus_gpu::hierarchy::Octree;
use argus_gpu::many_views::ManyViews;
use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::MapLookup as Parameters;
use argus_shaders::sampler::MAP_LOOKUP;

use super::{TileContext, with_node_maps};

/// Looks nodes up in maps that lie in so many arrays.
pub(crate) struct MapLookup {
    pipeline: ComputePipeline,
    arrays: usize,
}

/// What is looked up.
pub(crate) struct Maps<'a> {
    pub(crate) octree: &'a Octree,
    pub(crate) views: &'a ManyViews,
    pub(crate) surfels: &'a wgpu::Buffer,
    /// Of each level of the octree, the leaves' first, the number of the node after its last.
    pub(crate) ends: &'a wgpu::Buffer,
}

impl MapLookup {
    pub(crate) fn new(gpu: &Gpu, arrays: usize) -> Self {
        let constants = [("arrays", arrays as f64)];
        Self { pipeline: gpu.compute_pipeline_with(&MAP_LOOKUP, "look_up", &constants), arrays }
    }

    /// Arrays that it knows.
    pub(crate) fn arrays(&self) -> usize {
        self.arrays
    }

    /// Shades a tile of the camera that is the `view`-th of those that maps were rendered for.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        maps: &Maps<'_>,
        view: u32,
    ) {
        let TileContext { gpu, eye, targets, tile, rays, .. } = context;
        let lookup = maps.lookup(gpu, view);
        let [width, height] = tile.sub_samples();
        maps.bind(commands.compute("look up maps", &self.pipeline))
            .read("rays", rays)
            .read("lookup", &lookup)
            .read("lighting", &eye.lighting)
            .write("shaded", &targets.shaded)
            .dispatch_threads([width, height, 1]);
    }
}

impl Maps<'_> {
    /// What a program is told of them, a uniform; `view` is the one that is looked up, or the first.
    pub(crate) fn lookup(&self, gpu: &Gpu, view: u32) -> wgpu::Buffer {
        let (octree, set) = (self.octree, self.views.maps());
        let cell = octree.root.edge * (-f64::from(octree.depth)).exp2();
        let lookup = Parameters {
            view,
            map_shift: set.shift,
            map_side: set.side,
            edge: octree.root.edge as f32,
            radius: (0.5 * 3f64.sqrt() * cell) as f32,
        };
        gpu.upload("look up", &[lookup], wgpu::BufferUsages::UNIFORM)
    }

    /// Binds what a program reads to look them up (`shaders/shared/lit_maps.wgsl`), but for what it is told.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        with_node_maps(call, self.views)
            .read("nodes", &self.octree.nodes)
            .read("surfels", self.surfels)
            .read("ends", self.ends)
            .read("map_centers", self.views.map_centers())
    }
}
