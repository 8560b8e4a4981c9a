//! Program: `shaders/sampler/blend.wgsl`. Blends shaded layers over what is behind them.

use std::sync::OnceLock;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::Blend as Parameters;
use argus_shaders::sampler::BLEND;

use crate::scratch::Targets;

/// Blends images of layers. Pipelines are made when they are first needed.
pub(crate) struct Blend {
    matt: OnceLock<ComputePipeline>,
    /// For samples without and with a Reflector plane.
    glossy: [OnceLock<ComputePipeline>; 2],
    /// Samples have a LightVisibility plane.
    light_seen: bool,
    /// Bound where there is nothing to read, or to write: reflectors, arriving light.
    unused: [wgpu::Buffer; 4],
}

/// An image of shaded sub-samples or texels.
#[derive(Clone, Copy)]
pub(crate) struct Shaded<'a> {
    pub(crate) targets: &'a Targets,
    /// [`crate::lit_tile::Arriving`] of each, if light was found by rays.
    pub(crate) arriving: Option<&'a wgpu::Buffer>,
}

/// Where a layer's image lies in the image behind it.
pub(crate) struct Placed {
    pub(crate) size: [u32; 2],
    pub(crate) offset: [u32; 2],
    /// Columns of the image behind.
    pub(crate) stride: u32,
}

impl Blend {
    /// The programs of a scene. `light_seen`: whether its glossy samples say which lights they see.
    pub(crate) fn new(gpu: &Gpu, light_seen: bool) -> Self {
        let unused = || gpu.buffer("unused", 16, wgpu::BufferUsages::STORAGE);
        Self {
            matt: OnceLock::new(),
            glossy: Default::default(),
            light_seen,
            unused: std::array::from_fn(|_| unused()),
        }
    }

    /// Blends a layer by `alphas`: [`crate::layers::LayerImage`]. `glossy`: the texels of a sample with gloss, with or
    /// without reflectors; `None` for those of a matt sample, and for views.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        [layer, behind]: [Shaded<'_>; 2],
        placed: &Placed,
        alphas: &[f32],
        glossy: Option<bool>,
    ) {
        let Placed { size, offset, stride } = *placed;
        let parameters = Parameters { size, offset, stride, _pad: 0 };
        let parameters = gpu.upload("blend", &[parameters], wgpu::BufferUsages::UNIFORM);
        let alphas = gpu.upload("alphas", alphas, wgpu::BufferUsages::STORAGE);
        let pipeline = match glossy {
            None => self.matt.get_or_init(|| gpu.compute_pipeline(&BLEND, "blend_matt")),
            Some(reflects) => self.glossy[usize::from(reflects)].get_or_init(|| {
                let flag = |on: bool| f64::from(u8::from(on));
                let constants = [("reflects", flag(reflects)), ("light_seen", flag(self.light_seen))];
                gpu.compute_pipeline_with(&BLEND, "blend_glossy", &constants)
            }),
        };
        let mut call = commands
            .compute("blend layers", pipeline)
            .read("blend", &parameters)
            .read("alphas", &alphas)
            .read("layer", &layer.targets.shaded)
            .write("shaded", &behind.targets.shaded);
        if let (Some(reflects), Some(above), Some(below)) =
            (glossy, &layer.targets.gloss, &behind.targets.gloss)
        {
            call = call
                .read("layer_gloss", above)
                .write("gloss", below)
                .read(
                    "layer_reflectors",
                    layer.targets.reflectors.as_ref().filter(|_| reflects).unwrap_or(&self.unused[0]),
                )
                .write(
                    "reflectors",
                    behind.targets.reflectors.as_ref().filter(|_| reflects).unwrap_or(&self.unused[1]),
                )
                .read("layer_arriving", layer.arriving.filter(|_| self.light_seen).unwrap_or(&self.unused[2]))
                .write("arriving", behind.arriving.filter(|_| self.light_seen).unwrap_or(&self.unused[3]));
        }
        call.dispatch_threads([size[0], size[1], 1]);
    }
}
