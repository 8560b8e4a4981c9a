//! Program: `shaders/shade_leaves.wgsl`. Shades both sides of an octree's leaves.

use crate::hierarchy::Octree;
use crate::programs::SHADE_LEAVES;
use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};

use argus_sampler::plug::{Features, GBuffer, GBufferUse, TileContext};

/// Shades leaves with the functions that shade surfaces.
pub(crate) struct ShadeLeaves {
    pipeline: ComputePipeline,
    /// Bound without indirect light.
    unused: wgpu::Buffer,
}

/// Inputs and outputs.
pub(crate) struct Leaves<'a> {
    pub(crate) octree: &'a Octree,
    /// Two words a triangle of the octree: instance, and triangle of its mesh. The highest bit marks single-sided
    /// triangles.
    pub(crate) triangle_ids: &'a wgpu::Buffer,
    /// Two words a leaf: the triangles that it shows to either side.
    pub(crate) facing: &'a wgpu::Buffer,
    pub(crate) surfels: &'a wgpu::Buffer,
    /// Uniform of the chunk: [`argus_shaders::layout::sampler::LeafChunk`].
    pub(crate) chunk: &'a wgpu::Buffer,
}

impl ShadeLeaves {
    /// The pipeline for a scene's features.
    pub(crate) fn new(gpu: &Gpu, features: Features, g_buffer: GBufferUse) -> Self {
        Self {
            pipeline: gpu.compute_pipeline_with(&SHADE_LEAVES, "shade_leaves", &features.constants(g_buffer)),
            unused: gpu.buffer("no G-buffer", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Shades the chunk's image, which is the context's tile, and writes the planes of its leaves.
    pub(crate) fn record(&self, commands: &mut Commands, context: &TileContext<'_>, leaves: &Leaves<'_>) {
        let TileContext { targets, tile, .. } = context;
        let (g_buffer, materials) =
            targets.g_buffer.as_ref().map_or((&self.unused, &self.unused), GBuffer::both);
        if targets.g_buffer.is_some() {
            // Texels beyond the last leaf have no surface.
            commands.clear(g_buffer);
        }
        let [width, height] = tile.sub_samples();
        context
            .with_surfaces(commands.compute("shade leaves", &self.pipeline))
            .read("chunk", leaves.chunk)
            .read("facing", leaves.facing)
            .read("triangle_ids", leaves.triangle_ids)
            .read("nodes", &leaves.octree.nodes)
            .write("g_surfaces", g_buffer)
            .write("g_materials", materials)
            .write("shaded", &targets.shaded)
            .write("surfels", leaves.surfels)
            .dispatch_threads([width, height, 1]);
    }
}
