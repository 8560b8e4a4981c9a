//! Program: `shaders/map_lookup.wgsl`. Looks up the sub-samples of an omni sample in its camera's map.

use crate::hierarchy::Octree;
use crate::layout::MapLookup as Parameters;
use crate::many_views::ManyViews;
use crate::programs::MAP_LOOKUP;
use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu, wgpu};

use super::with_node_maps;
use argus_sampler::plug::{Features, TileContext};

/// Looks up nodes in maps. The pipeline depends on the number of arrays.
pub(crate) struct MapLookup {
    pipeline: ComputePipeline,
    arrays: usize,
    features: Features,
}

/// Maps of nodes, and the radiance of the nodes.
pub(crate) struct Maps<'a> {
    pub(crate) octree: &'a Octree,
    pub(crate) views: &'a ManyViews,
    pub(crate) surfels: &'a wgpu::Buffer,
    /// For each level, starting with the leaves, the index after its last node.
    pub(crate) ends: &'a wgpu::Buffer,
}

impl MapLookup {
    pub(crate) fn new(gpu: &Gpu, features: Features, arrays: usize) -> Self {
        let constants = [("arrays", arrays as f64), features.sky_constant()];
        let pipeline = gpu.compute_pipeline_with(&MAP_LOOKUP, "look_up", &constants);
        Self { pipeline, arrays, features }
    }

    /// Makes the pipeline anew if it is for another number of arrays.
    pub(crate) fn set_arrays(&mut self, gpu: &Gpu, arrays: usize) {
        if arrays != self.arrays {
            *self = Self::new(gpu, self.features, arrays);
        }
    }

    /// Looks up a tile of a camera. `view` is the camera's index in the traversal.
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
            .read("environment_map", context.resident.environment.view())
            .write("shaded", &targets.shaded)
            .dispatch_threads([width, height, 1]);
    }
}

impl Maps<'_> {
    /// The uniform of a lookup. `view` is the index of the view, or of the first one.
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

    /// Binds what `shaders/shared/lit_maps.wgsl` reads, except its uniform.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        with_node_maps(call, self.views)
            .read("nodes", &self.octree.nodes)
            .read("surfels", self.surfels)
            .read("ends", self.ends)
            .read("map_centers", self.views.map_centers())
    }
}
