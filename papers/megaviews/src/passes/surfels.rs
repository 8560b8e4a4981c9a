//! Program: `shaders/surfels.wgsl`. Makes the surfels of an octree's nodes, from leaves to root.

use crate::hierarchy::Octree;
use crate::layout::NodeLevel;
use crate::programs::SURFELS;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use super::Leaves;
use argus_sampler::plug::TileContext;

/// Stores leaves and averages inner nodes.
pub(crate) struct Surfels {
    keep_leaves: ComputePipeline,
    average: ComputePipeline,
}

impl Surfels {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&SURFELS, entry);
        Self { keep_leaves: pipeline("keep_leaves"), average: pipeline("average_surfels") }
    }

    /// Stores the radiance of a chunk's leaves.
    pub(crate) fn keep(&self, commands: &mut Commands, context: &TileContext<'_>, leaves: &Leaves<'_>) {
        let [width, height] = context.tile.sub_samples();
        commands
            .compute("keep leaves", &self.keep_leaves)
            .read("chunk", leaves.chunk)
            .read("shaded", &context.targets.shaded)
            .write("surfels", leaves.surfels)
            .dispatch_threads([width, height, 1]);
    }

    /// Averages inner nodes, level by level.
    pub(crate) fn average(&self, commands: &mut Commands, octree: &Octree, surfels: &wgpu::Buffer) {
        for &[first, count] in octree.levels[..octree.depth as usize].iter().rev() {
            let level = NodeLevel { first, count, edge: octree.root.edge as f32 };
            commands
                .compute("average surfels", &self.average)
                .read("nodes", &octree.nodes)
                .read("weights", &octree.weights)
                .write("surfels", surfels)
                .immediates(bytemuck::bytes_of(&level))
                .dispatch_linear(u64::from(count));
        }
    }
}
