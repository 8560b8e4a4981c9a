//! Program: `shaders/sampler/arriving_light.wgsl`. Sums the light that arrives at texels.

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
    /// The rest, which was found on the CPU.
    Rest,
    /// Nothing blocks it.
    Open,
}

/// Irradiance / π of the open sky: rows of so many directions around, from straight down to straight up.
#[derive(Clone, Copy)]
pub(crate) struct SkyTable<'a> {
    pub(crate) entries: &'a [Vec3],
    pub(crate) columns: usize,
}

/// One program for each source of the sky's light, with and without a rest.
pub(crate) struct ArrivingLight {
    pipelines: [[ComputePipeline; 2]; 3],
}

impl ArrivingLight {
    pub(crate) fn new(gpu: &Gpu, features: Features) -> Self {
        let flag = |set: bool| f64::from(u8::from(set));
        let pipeline = |sky: SkyFrom, has_rest: bool| {
            let constants = [
                ("has_sky_rays", flag(sky == SkyFrom::Rays)),
                ("sky_in_rest", flag(sky == SkyFrom::Rest)),
                ("has_rest", flag(has_rest)),
                ("is_glossy", flag(features.specular)),
                features.sky_constant(),
            ];
            gpu.compute_pipeline_with(&ARRIVING_LIGHT, "sum_light", &constants)
        };
        let both = |sky| [pipeline(sky, false), pipeline(sky, true)];
        Self { pipelines: [SkyFrom::Rays, SkyFrom::Rest, SkyFrom::Open].map(both) }
    }

    /// Returns [`crate::lit_tile::Arriving`] of each texel. `rest`: light that was found on the CPU.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        texels: &LitTexels,
        sky: SkyFrom,
        table: SkyTable<'_>,
        rest: Option<&wgpu::Buffer>,
    ) -> wgpu::Buffer {
        let (gpu, buffers) = (context.gpu, &texels.buffers);
        let query = ArrivingQuery { columns: table.columns.max(1) as u32 };
        let query = gpu.upload("arriving light", &[query], wgpu::BufferUsages::UNIFORM);
        let entries: Vec<[f32; 4]> = table.entries.iter().map(|light| light.extend(0.0).to_array()).collect();
        let table = match entries.is_empty() {
            true => gpu.upload("open sky", &[[0.0f32; 4]], wgpu::BufferUsages::STORAGE),
            false => gpu.upload("open sky", &entries, wgpu::BufferUsages::STORAGE),
        };
        let count = u64::from(texels.count);
        let arriving = gpu.buffer("arriving light", count * 16, wgpu::BufferUsages::STORAGE);
        // Without a rest another buffer is bound in its place, and not read.
        texels
            .bind(commands.compute(SHARED_STAGE, &self.pipelines[sky as usize][usize::from(rest.is_some())]))
            .read("arriving_query", &query)
            .read("lighting", &context.eye.lighting)
            .read("lit", &buffers.lit)
            .read("seen", &buffers.seen)
            .read("sky_sums", &buffers.sky[0])
            .read("sky_table", &table)
            .read("rest", rest.unwrap_or(&buffers.lit))
            .write("arriving", &arriving)
            .dispatch_linear(count);
        arriving
    }
}
