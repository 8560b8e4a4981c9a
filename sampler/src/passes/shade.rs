//! Program: `shaders/sampler/shade.wgsl`. The radiance that each sub-sample sees.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::sampler::SHADE;

use super::TileContext;
use crate::mirrors::Mirrored;
use crate::resident::Features;
use crate::scratch::Guides;

/// What is shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shading {
    /// Everything that reaches the eye, for a direct view.
    View,
    /// What does not depend on the viewer, for a sample.
    Sample,
}

/// Shades visible surfaces.
pub(crate) struct Shade {
    view: ComputePipeline,
    pixels: ComputePipeline,
    sample: ComputePipeline,
    glossy: bool,
    /// Bound where nothing is kept for indirect light or reflections.
    unused: wgpu::Buffer,
}

impl Shade {
    /// For a scene with those features; `keeps_guides` for passes that add indirect light, `reflects` where surfaces look
    /// up what is around them.
    pub(crate) fn new(gpu: &Gpu, features: Features, keeps_guides: bool, reflects: bool) -> Self {
        let mut constants = features.constants(keeps_guides).to_vec();
        constants.push(("reflects", f64::from(u8::from(reflects))));
        let pipeline = |entry| gpu.compute_pipeline_with(&SHADE, entry, &constants);
        let sample = if features.specular { "shade_glossy_sample" } else { "shade_sample" };
        Self {
            view: pipeline("shade_view"),
            pixels: pipeline("shade_pixels"),
            sample: pipeline(sample),
            glossy: features.specular,
            unused: gpu.buffer("unused", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Shades a tile's visibility buffer.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        mirrored: &Mirrored,
        shading: Shading,
    ) {
        let TileContext { gpu, eye, targets, tile, rays, .. } = context;
        let (guides, albedos) = targets.guides.as_ref().map_or((&self.unused, &self.unused), Guides::both);
        if targets.guides.is_some() {
            // The sky keeps none.
            commands.clear(guides);
        }
        let (name, pipeline) = match (shading, self.glossy) {
            (Shading::View, _) if context.places.is_some() => ("shade pixels", &self.pixels),
            (Shading::View, _) => ("shade view", &self.view),
            (Shading::Sample, false) => ("shade sample", &self.sample),
            (Shading::Sample, true) => ("shade glossy sample", &self.sample),
        };
        let mut call = context
            .with_surfaces(commands.compute(name, pipeline))
            .read("rays", rays)
            .read("visibility", &targets.visibility)
            .write("guides", guides)
            .write("guide_albedos", albedos)
            .write("shaded", &targets.shaded);
        let around;
        match (shading, &targets.gloss) {
            (Shading::View, _) => {
                let about_eye = mirrored.surroundings.around(eye.position);
                around = gpu.upload("around", &[about_eye], wgpu::BufferUsages::UNIFORM);
                call = call.read("map_of_instance", &mirrored.map_of_instance).read("around", &around);
                for (name, resource) in mirrored.surroundings.bindings() {
                    call = call.read(name, resource);
                }
            }
            (Shading::Sample, Some(gloss)) if self.glossy => {
                call = call
                    .write("gloss", gloss)
                    .read("map_of_instance", &mirrored.map_of_instance)
                    .write("reflectors", targets.reflectors.as_ref().unwrap_or(&self.unused));
            }
            (Shading::Sample, _) => (),
        }
        if let Some(places) = &context.places {
            call = call.read("places", places);
        }
        let [width, height] = tile.sub_samples();
        call.dispatch_threads([width, height, 1]);
    }
}
