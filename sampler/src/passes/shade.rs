//! Program: `shaders/sampler/shade.wgsl`. Shades each sub-sample of a direct view.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::sampler::SHADE;

use super::{ProbeBindings, TileContext};
use crate::resident::{Features, GBufferUse};
use crate::scratch::GBuffer;

/// Shades visible surfaces.
pub(crate) struct Shade {
    view: ComputePipeline,
    pixels: ComputePipeline,
    rays: ComputePipeline,
    /// Bound without indirect light.
    unused: wgpu::Buffer,
}

impl Shade {
    /// The pipelines for a scene's features. `reflects` looks up
    /// reflection probes.
    pub(crate) fn new(gpu: &Gpu, features: Features, g_buffer: GBufferUse, reflects: bool) -> Self {
        Self::with(gpu, features, g_buffer, [reflects, false])
    }

    /// The pipelines that leave reflections of the scene to a later pass, and note which reflector each sub-sample shows.
    pub(crate) fn deferring(gpu: &Gpu, features: Features, g_buffer: GBufferUse) -> Self {
        Self::with(gpu, features, g_buffer, [true, true])
    }

    fn with(gpu: &Gpu, features: Features, g_buffer: GBufferUse, [reflects, defers]: [bool; 2]) -> Self {
        let mut constants = features.constants(g_buffer).to_vec();
        constants.push(("reflects", f64::from(u8::from(reflects))));
        constants.push(("defers_reflection", f64::from(u8::from(defers))));
        let pipeline = |entry| gpu.compute_pipeline_with(&SHADE, entry, &constants);
        Self {
            view: pipeline("shade_view"),
            pixels: pipeline("shade_pixels"),
            rays: pipeline("shade_rays"),
            unused: gpu.buffer("unused", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Shades a tile's visibility buffer, view-dependent reflection included.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        probe_bindings: &ProbeBindings,
    ) {
        let TileContext { gpu, eye, targets, tile, rays, .. } = context;
        let (g_buffer, materials) =
            targets.g_buffer.as_ref().map_or((&self.unused, &self.unused), GBuffer::both);
        if targets.g_buffer.is_some() {
            // Sky has no surface.
            commands.clear(g_buffer);
        }
        let (name, pipeline) = match (&context.places, &context.directions) {
            (Some(_), _) => ("shade pixels", &self.pixels),
            (None, Some(_)) => ("shade rays", &self.rays),
            (None, None) => ("shade view", &self.view),
        };
        let about_eye = probe_bindings.probes.uniform(eye.position);
        let around = gpu.upload("around", &[about_eye], wgpu::BufferUsages::UNIFORM);
        let mut call = context
            .with_surfaces(commands.compute(name, pipeline))
            .read("environment_map", context.resident.environment.view())
            .read("rays", rays)
            .read("visibility", &targets.visibility)
            .write("g_surfaces", g_buffer)
            .write("g_materials", materials)
            .write("shaded", &targets.shaded)
            .write("reflectors", targets.reflectors.as_ref().unwrap_or(&self.unused))
            .read("probe_of_instance", &probe_bindings.probe_of_instance)
            .read("probes", &around);
        for (name, resource) in probe_bindings.probes.bindings() {
            call = call.read(name, resource);
        }
        if let Some(places) = &context.places {
            call = call.read("places", places);
        }
        if let Some(directions) = &context.directions {
            call = call.read("directions", directions);
        }
        let [width, height] = tile.sub_samples();
        call.dispatch_threads([width, height, 1]);
    }
}
