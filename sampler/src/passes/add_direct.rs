//! Program: `shaders/sampler/add_direct.wgsl`. Adds direct light to what was shaded.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::AddDirect as Parameters;
use argus_shaders::sampler::ADD_DIRECT;

use super::TileContext;
use crate::resident::Features;
use crate::scratch::GBuffer;

/// Adds arriving light, times albedo, and in views the reflection of lights and sky.
pub(crate) struct AddDirect {
    diffuse: ComputePipeline,
    /// With what glossy surfaces reflect.
    view: ComputePipeline,
}

impl AddDirect {
    /// The pipelines for a scene's features.
    pub(crate) fn new(gpu: &Gpu, features: Features) -> Self {
        let pipeline = |reflects: bool| {
            let constants = [("reflects_light", f64::from(u8::from(reflects))), features.sky_constant()];
            gpu.compute_pipeline_with(&ADD_DIRECT, "add_direct", &constants)
        };
        Self { diffuse: pipeline(false), view: pipeline(features.specular) }
    }

    /// Adds `arriving` ([`crate::lit_tile::Arriving`] of each sub-sample) to a tile.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        g_buffer: &GBuffer,
        arriving: &wgpu::Buffer,
        is_view: bool,
    ) {
        let TileContext { gpu, eye, targets, tile, .. } = context;
        let [width, height] = tile.sub_samples();
        let parameters = Parameters { size: [width, height] };
        let parameters = gpu.upload("add direct light", &[parameters], wgpu::BufferUsages::UNIFORM);
        let pipeline = if is_view { &self.view } else { &self.diffuse };
        commands
            .compute("add direct light", pipeline)
            .read("tile", &parameters)
            .read("lighting", &eye.lighting)
            .read("environment_map", context.resident.environment.view())
            .read("lights", &eye.lights)
            .read("g_surfaces", &g_buffer.surfaces)
            .read("g_materials", &g_buffer.materials)
            .read("arriving", arriving)
            .write("shaded", &targets.shaded)
            .dispatch_threads([width, height, 1]);
    }
}
