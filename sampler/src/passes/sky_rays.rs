//! Program: `shaders/sampler/sky_rays.wgsl`. Rays from texels to the sky, and the share of it that they see.

use std::sync::Arc;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::sampler::SkyQuery;
use argus_shaders::sampler::SKY_RAYS;
use glam::Vec2;

use super::TileContext;
use super::scattered_rays::{Sought, Tracing};
use crate::lit_tile::LitTexels;
use crate::resident::Features;

/// Row of the timing table.
const SKY: &str = "trace sky";

/// Programs for rays, for sums, and for rows and columns of the filter's two boxes.
pub(crate) struct SkyRays {
    cast_rays: ComputePipeline,
    sum_rays: ComputePipeline,
    smooth: [ComputePipeline; 4],
    /// Points of the unit disc: those of each slot for the first ray, then for the second, and so on.
    points: wgpu::Buffer,
}

/// Rays of each texel.
pub(crate) struct AskedSky {
    /// Rays of a texel.
    pub(crate) rays: u32,
    /// Metres at which rays end.
    pub(crate) reach: f32,
    /// Whether neighbours on the same surface share what their rays found.
    pub(crate) filter: bool,
}

impl SkyRays {
    /// `reaches`: of the filter's boxes, texels. `points`: of the unit disc, for all slots and the most rays of a texel.
    pub(crate) fn new(gpu: &Gpu, features: Features, reaches: [isize; 2], points: &[Vec2]) -> Self {
        let smooth = |(reach, columns): (isize, bool)| {
            let constants = [("filter_reach", reach as f64), ("along_columns", f64::from(u8::from(columns)))];
            gpu.compute_pipeline_with(&SKY_RAYS, "smooth_sums", &constants)
        };
        let [first, second] = reaches;
        let points: Vec<[f32; 2]> = points.iter().map(|point| point.to_array()).collect();
        Self {
            cast_rays: gpu.compute_pipeline(&SKY_RAYS, "cast_rays"),
            sum_rays: gpu.compute_pipeline_with(&SKY_RAYS, "sum_rays", &[features.sky_constant()]),
            smooth: [(first, false), (first, true), (second, false), (second, true)].map(smooth),
            points: gpu.upload("points of the sky", &points, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Leaves the sums over each texel's rays in the first of the buffers for them.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        sky: AskedSky,
        texels: &LitTexels,
        tracing: Tracing<'_>,
    ) {
        let gpu: &Arc<Gpu> = context.gpu;
        let (count, buffers) = (u64::from(texels.count), &texels.buffers);
        commands.clear(&buffers.sky[0]);
        for ray in 0..sky.rays {
            let query = SkyQuery { ray, reach: sky.reach };
            let query = gpu.upload("rays to the sky", &[query], wgpu::BufferUsages::UNIFORM);
            texels
                .bind(commands.compute(SKY, &self.cast_rays))
                .read("sky_query", &query)
                .read("sky_points", &self.points)
                .write("sky_rays", &buffers.rays)
                .dispatch_linear(count);
            let sought = Sought::Passed(&buffers.passed);
            tracing.record_as(SKY, commands, gpu, &buffers.rays, texels.count, sought);
            texels
                .bind(commands.compute(SKY, &self.sum_rays))
                .read("lighting", &context.eye.lighting)
                .read("environment_map", context.resident.environment.view())
                .write("sky_rays", &buffers.rays)
                .read("passed", &buffers.passed)
                .write("sums", &buffers.sky[0])
                .dispatch_linear(count);
        }
        for (step, pipeline) in self.smooth.iter().enumerate().filter(|_| sky.filter) {
            texels
                .bind(commands.compute(SKY, pipeline))
                .read("unfiltered", &buffers.sky[step % 2])
                .write("sums", &buffers.sky[1 - step % 2])
                .dispatch_linear(count);
        }
    }
}
