//! Program: `shaders/sampler/shade_sample.wgsl`. Shades one surface of each texel of a sample, once for each of its
//! triangles.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::sampler::SHADE_SAMPLE;

use super::{ProbeBindings, TileContext};
use crate::resident::{Features, GBufferUse};
use crate::scratch::GBuffer;

/// Texels that an invocation searches for split texels, as in the program.
const RUN: u32 = 64;

/// Two dispatches a tile.
pub(crate) struct ShadeSample {
    /// Shades texels that show one triangle.
    whole: ComputePipeline,
    /// Shades texels that show several triangles.
    split: ComputePipeline,
    glossy: bool,
    reflects: bool,
    /// Bound without indirect light or reflections.
    unused: wgpu::Buffer,
}

impl ShadeSample {
    /// The pipelines for a scene's features and `side` sub-samples along a texel's side. `reflects` writes the Reflector plane.
    pub(crate) fn new(
        gpu: &Gpu,
        features: Features,
        g_buffer: GBufferUse,
        reflects: bool,
        side: u32,
    ) -> Self {
        let glossy = features.specular;
        let mut constants = features.constants(g_buffer).to_vec();
        constants.push(("reflects", f64::from(u8::from(reflects && glossy))));
        constants.push(("glossy", f64::from(u8::from(glossy))));
        constants.push(("side", f64::from(side)));
        let pipeline = |entry| gpu.compute_pipeline_with(&SHADE_SAMPLE, entry, &constants);
        Self {
            whole: pipeline("shade_whole"),
            split: pipeline("shade_split"),
            glossy,
            reflects,
            unused: gpu.buffer("unused", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Shades what a tile's sub-samples see. The context has one ray a texel.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        probe_bindings: &ProbeBindings,
    ) {
        let TileContext { targets, tile, rays, .. } = context;
        let (g_buffer, materials) =
            targets.g_buffer.as_ref().map_or((&self.unused, &self.unused), GBuffer::both);
        if targets.g_buffer.is_some() {
            // Sky has no surface.
            commands.clear(g_buffer);
        }
        let gloss = targets.gloss.as_ref().filter(|_| self.glossy).unwrap_or(&self.unused);
        let reflectors = targets.reflectors.as_ref().filter(|_| self.reflects).unwrap_or(&self.unused);
        let [width, height] = tile.size;
        let runs = (width * height).div_ceil(RUN);
        for (pipeline, name, threads) in [
            (&self.whole, "shade whole texels", [width, height, 1]),
            (&self.split, "shade split texels", [runs, 1, 1]),
        ] {
            context
                .with_surfaces(commands.compute(name, pipeline))
                .read("environment_map", context.resident.environment.view())
                .read("rays", rays)
                .read("visibility", &targets.visibility)
                .read("probe_of_instance", &probe_bindings.probe_of_instance)
                .write("g_surfaces", g_buffer)
                .write("g_materials", materials)
                .write("shaded", &targets.shaded)
                .write("gloss", gloss)
                .write("reflectors", reflectors)
                .dispatch_threads(threads);
        }
    }
}
