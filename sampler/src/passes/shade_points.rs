//! Program: `shaders/sampler/shade_points.wgsl`. Shades points of reflection probes.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::sampler::SHADE_POINTS;

use super::TileContext;
use crate::resident::{Features, GBufferUse};
use crate::scratch::GBuffer;

/// Shades points with the functions that shade surfaces.
pub(crate) struct ShadePoints {
    shade: ComputePipeline,
    keep: ComputePipeline,
    /// Bound without indirect light.
    unused: wgpu::Buffer,
}

impl ShadePoints {
    /// The pipelines for a scene's features.
    pub(crate) fn new(gpu: &Gpu, features: Features, g_buffer: GBufferUse) -> Self {
        Self {
            shade: gpu.compute_pipeline_with(&SHADE_POINTS, "shade_points", &features.constants(g_buffer)),
            keep: gpu.compute_pipeline(&SHADE_POINTS, "keep_points"),
            unused: gpu.buffer("no G-buffer", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Shades the chunk's points in its image, which is the context's tile. `chunk` is a uniform
    /// ([`argus_shaders::layout::sampler::LeafChunk`]), and `points` are [`argus_shaders::layout::sampler::ProbePoint`].
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        chunk: &wgpu::Buffer,
        points: &wgpu::Buffer,
    ) {
        let TileContext { targets, tile, .. } = context;
        let (g_buffer, materials) =
            targets.g_buffer.as_ref().map_or((&self.unused, &self.unused), GBuffer::both);
        if targets.g_buffer.is_some() {
            // Texels beyond the last point have no surface.
            commands.clear(g_buffer);
        }
        let [width, height] = tile.sub_samples();
        context
            .with_surfaces(commands.compute("shade points", &self.shade))
            .read("chunk", chunk)
            .read("points", points)
            .write("g_surfaces", g_buffer)
            .write("g_materials", materials)
            .write("shaded", &targets.shaded)
            .dispatch_threads([width, height, 1]);
    }

    /// Stores the chunk's radiance as words of rgb9e5, once all light is added.
    pub(crate) fn keep(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        chunk: &wgpu::Buffer,
        radiance: &wgpu::Buffer,
    ) {
        let [width, height] = context.tile.sub_samples();
        commands
            .compute("keep points", &self.keep)
            .read("chunk", chunk)
            .write("shaded", &context.targets.shaded)
            .write("radiance_of_points", radiance)
            .dispatch_threads([width, height, 1]);
    }
}
