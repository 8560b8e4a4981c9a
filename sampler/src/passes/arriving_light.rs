//! Program: `shaders/sampler/arriving_light.wgsl`. Sums the light that arrives at texels.

use std::sync::OnceLock;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::effects::SHARED_STAGE;
use argus_shaders::layout::sampler::ArrivingQuery;
use argus_shaders::sampler::ARRIVING_LIGHT;
use glam::Vec3;

use super::TileContext;
use crate::lit_tile::LitTexels;
use crate::resident::Features;

/// Where the light of the sky is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SkyFrom {
    /// Rays of the device.
    Rays,
    /// Light cells.
    Cells,
    /// Nothing blocks it.
    Open,
}

/// Which light was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LightParts {
    pub(crate) sky: SkyFrom,
    /// Of emitting triangles.
    pub(crate) emitters: bool,
    /// Of other surfaces.
    pub(crate) surfaces: bool,
}

/// Irradiance / π of the open sky: rows of so many directions around, from straight down to straight up.
#[derive(Clone, Copy)]
pub(crate) struct SkyTable<'a> {
    pub(crate) entries: &'a [Vec3],
    pub(crate) columns: usize,
}

/// Entries of a table of a black sky: it has a column, and no row beyond the program's.
const BLACK: usize = 66;

/// One program for each source of the sky's light, with and without that of emitters and of surfaces, made when it is first used.
pub(crate) struct ArrivingLight {
    features: Features,
    pipelines: [[OnceLock<ComputePipeline>; 4]; 3],
}

impl ArrivingLight {
    pub(crate) fn new(features: Features) -> Self {
        Self { features, pipelines: Default::default() }
    }

    fn pipeline(&self, gpu: &Gpu, parts: LightParts) -> &ComputePipeline {
        let LightParts { sky, emitters, surfaces } = parts;
        let others = usize::from(emitters) + 2 * usize::from(surfaces);
        self.pipelines[sky as usize][others].get_or_init(|| {
            let flag = |set: bool| f64::from(u8::from(set));
            let constants = [
                ("has_sky_rays", flag(sky == SkyFrom::Rays)),
                ("has_sky_share", flag(sky == SkyFrom::Cells)),
                ("has_emitted", flag(emitters)),
                ("has_indirect", flag(surfaces)),
                ("is_glossy", flag(self.features.specular)),
                self.features.sky_constant(),
            ];
            gpu.compute_pipeline_with(&ARRIVING_LIGHT, "sum_light", &constants)
        })
    }

    /// Returns [`crate::lit_tile::Arriving`] of each texel.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        texels: &LitTexels,
        parts: LightParts,
        table: SkyTable<'_>,
    ) -> wgpu::Buffer {
        let (gpu, buffers) = (context.gpu, &texels.buffers);
        let query = ArrivingQuery { columns: table.columns.max(1) as u32 };
        let query = gpu.upload("arriving light", &[query], wgpu::BufferUsages::UNIFORM);
        let mut entries: Vec<[f32; 4]> =
            table.entries.iter().map(|light| light.extend(0.0).to_array()).collect();
        if entries.is_empty() {
            entries.resize(BLACK, [0.0; 4]);
        }
        let table = gpu.upload("open sky", &entries, wgpu::BufferUsages::STORAGE);
        let count = u64::from(texels.count);
        let arriving = gpu.buffer("arriving light", count * 16, wgpu::BufferUsages::STORAGE);
        // Where light was not found, another buffer is bound in its place, and not read.
        let has_found = parts.emitters || parts.surfaces || parts.sky == SkyFrom::Cells;
        let [emitted, indirect, sky_share] = match has_found {
            true => {
                let found = texels.found();
                [&found.emitted, &found.indirect, &found.sky_share]
            }
            false => [&buffers.lit; 3],
        };
        texels
            .bind(commands.compute(SHARED_STAGE, self.pipeline(gpu, parts)))
            .read("arriving_query", &query)
            .read("lighting", &context.eye.lighting)
            .read("lit", &buffers.lit)
            .read("seen", &buffers.seen)
            .read("sky_sums", &buffers.sky[0])
            .read("sky_table", &table)
            .read("sky_share", sky_share)
            .read("emitted", emitted)
            .read("indirect", indirect)
            .write("arriving", &arriving)
            .dispatch_linear(count);
        arriving
    }
}
