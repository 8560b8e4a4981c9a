//! Maps that take what the maps above them hold, and texels looked up without that. Program: `shaders/gpu/fuse.wgsl`.

use argus_shaders::gpu::FUSE;
use argus_shaders::layout::gpu::Fusion;
use wgpu::Buffer;

use super::MapSet;
use super::traverse::{Traverse, Work, with_maps};
use crate::{Commands, ComputePipeline, Gpu};

/// The pipelines.
#[derive(Debug)]
pub(super) struct Fuse {
    fuse: ComputePipeline,
    query: ComputePipeline,
}

impl Fuse {
    /// For maps like these, however many.
    pub(super) fn new(gpu: &Gpu, maps: &MapSet) -> Self {
        let constants = maps.constants();
        let pipeline = |entry| gpu.compute_pipeline_with(&FUSE, entry, &constants);
        Self { fuse: pipeline("fuse"), query: pipeline("query") }
    }

    /// From the root's map down to those of the leaves.
    pub(super) fn run(&self, commands: &mut Commands, traverse: &Traverse, work: &Work<'_>) {
        let arguments = traverse.prepare_fusion(commands, work);
        for level in 0..=work.views.depth {
            let step = Self::step(work, level);
            let call = commands
                .compute("fuse", &self.fuse)
                .read("nodes", &work.octree.nodes)
                .read("maps", &work.views.maps)
                .read("map_levels", &work.views.map_levels);
            with_maps(call, work.maps)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_indirect(arguments, 16 * u64::from(level));
        }
    }

    /// Looks up a texel of a map for each of `count` queries (map, texel): inverse range and node.
    pub(super) fn query(
        &self,
        commands: &mut Commands,
        work: &Work<'_>,
        queries: &Buffer,
        count: u32,
        answers: &Buffer,
    ) {
        let step = Self::step(work, count);
        let call = commands
            .compute("query", &self.query)
            .read("nodes", &work.octree.nodes)
            .read("maps", &work.views.maps)
            .read("queries", queries)
            .write("answers", answers);
        with_maps(call, work.maps).immediates(bytemuck::bytes_of(&step)).dispatch_linear(u64::from(count));
    }

    fn step(work: &Work<'_>, level: u32) -> Fusion {
        let edge = work.octree.root.edge as f32;
        Fusion { side: work.knobs.side, edge, map_shift: work.maps.shift, level }
    }
}
