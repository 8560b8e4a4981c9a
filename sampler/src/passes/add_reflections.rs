//! Program: `shaders/sampler/add_reflections.wgsl`. Adds what surfaces reflect of the scene to what was shaded.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::AddDirect as Parameters;
use argus_shaders::sampler::ADD_REFLECTIONS;

use super::TileContext;
use crate::scratch::GBuffer;

/// Adds arriving radiance, weighted by each surface's lobe.
pub(crate) struct AddReflections {
    pipeline: ComputePipeline,
}

impl AddReflections {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { pipeline: gpu.compute_pipeline(&ADD_REFLECTIONS, "add_reflections") }
    }

    /// Adds `arriving` to a tile: the mean radiance that each sub-sample reflects, and then that which passes through each, if
    /// any surface lets light through.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        g_buffer: &GBuffer,
        reflectors: &wgpu::Buffer,
        arriving: &wgpu::Buffer,
    ) {
        let TileContext { gpu, targets, tile, .. } = context;
        let [width, height] = tile.sub_samples();
        let parameters = Parameters { size: [width, height] };
        let parameters = gpu.upload("add reflections", &[parameters], wgpu::BufferUsages::UNIFORM);
        commands
            .compute("add reflections", &self.pipeline)
            .read("tile", &parameters)
            .read("g_surfaces", &g_buffer.surfaces)
            .read("g_materials", &g_buffer.materials)
            .read("reflectors", reflectors)
            .read("arriving", arriving)
            .write("shaded", &targets.shaded)
            .dispatch_threads([width, height, 1]);
    }
}
