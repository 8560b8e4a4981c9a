//! Fuses maps with their parents, and looks up texels of unfused maps. Program: `shaders/fuse.wgsl`.

use crate::layout::Fusion;
use crate::programs::FUSE;
use argus_gpu::wgpu::Buffer;

use super::MapSet;
use super::traverse::{TraversalInputs, Traverse, with_maps};
use argus_gpu::{Commands, ComputePipeline, Gpu};

/// The pipelines.
#[derive(Debug)]
pub(super) struct Fuse {
    fuse: ComputePipeline,
    query: ComputePipeline,
}

impl Fuse {
    /// Pipelines for maps of this layout.
    pub(super) fn new(gpu: &Gpu, maps: &MapSet) -> Self {
        let constants = maps.constants();
        let pipeline = |entry| gpu.compute_pipeline_with(&FUSE, entry, &constants);
        Self { fuse: pipeline("fuse"), query: pipeline("query") }
    }

    /// Fuses from the root's map to those of the leaves.
    pub(super) fn run(&self, commands: &mut Commands, traverse: &Traverse, inputs: &TraversalInputs<'_>) {
        let arguments = traverse.prepare_fusion(commands, inputs);
        for level in 0..=inputs.views.depth {
            let step = Self::step(inputs, level);
            let call = commands
                .compute("fuse", &self.fuse)
                .read("nodes", &inputs.octree.nodes)
                .read("maps", &inputs.views.maps)
                .read("map_levels", &inputs.views.map_levels);
            with_maps(call, inputs.maps)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_indirect(arguments, 16 * u64::from(level));
        }
    }

    /// Looks up a texel of a map for each of `count` queries (map, texel): inverse range and node.
    pub(super) fn query(
        &self,
        commands: &mut Commands,
        inputs: &TraversalInputs<'_>,
        queries: &Buffer,
        count: u32,
        answers: &Buffer,
    ) {
        let step = Self::step(inputs, count);
        let call = commands
            .compute("query", &self.query)
            .read("nodes", &inputs.octree.nodes)
            .read("maps", &inputs.views.maps)
            .read("queries", queries)
            .write("answers", answers);
        with_maps(call, inputs.maps).immediates(bytemuck::bytes_of(&step)).dispatch_linear(u64::from(count));
    }

    fn step(inputs: &TraversalInputs<'_>, level: u32) -> Fusion {
        let edge = inputs.octree.root.edge as f32;
        Fusion { side: inputs.settings.side, edge, map_shift: inputs.maps.shift, level }
    }
}
