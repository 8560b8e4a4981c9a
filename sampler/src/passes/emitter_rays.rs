//! Program: `shaders/sampler/emitter_rays.wgsl`. Rays from texels to points of emitting triangles, and what arrives.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::surface_light::{EmitterPoint, EmitterQuery};
use argus_shaders::sampler::EMITTER_RAYS;

use super::scattered_rays::{Sought, Tracing};
use super::smooth_texels::{SmoothTexels, TexelImage};
use crate::lit_tile::LitTexels;

/// Row of the timing table.
const EMITTERS: &str = "trace emitters";

/// Programs for rays and for sums.
pub(crate) struct EmitterRays {
    cast_rays: ComputePipeline,
    sum_rays: ComputePipeline,
}

impl EmitterRays {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let [cast_rays, sum_rays] =
            ["cast_rays", "sum_rays"].map(|entry| gpu.compute_pipeline(&EMITTER_RAYS, entry));
        Self { cast_rays, sum_rays }
    }

    /// Leaves irradiance / π of emitters. `points`: a point for each slot, of the first ray, then of the second, and so on; there are
    /// `rays` of a texel. `smooth`: what neighbours share it by.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        points: &[EmitterPoint],
        rays: u32,
        smooth: Option<&SmoothTexels>,
    ) {
        let (gpu, buffers, found) = (&texels.gpu, &texels.buffers, texels.found());
        let points = gpu.upload("points of emitters", points, wgpu::BufferUsages::STORAGE);
        let count = u64::from(texels.count);
        commands.clear(&found.emitted);
        for ray in 0..rays {
            let query = EmitterQuery { ray };
            let query = gpu.upload("rays to emitters", &[query], wgpu::BufferUsages::UNIFORM);
            texels
                .bind(commands.compute(EMITTERS, &self.cast_rays))
                .read("emitter_query", &query)
                .read("emitter_points", &points)
                .write("emitter_rays", &buffers.rays)
                .write("members", &found.members[0])
                .dispatch_linear(count);
            let sought = Sought::Passed(&buffers.passed);
            tracing.record_as(EMITTERS, commands, gpu, &buffers.rays, texels.count, sought);
            texels
                .bind(commands.compute(EMITTERS, &self.sum_rays))
                .read("emitter_query", &query)
                .read("emitter_points", &points)
                .write("emitter_rays", &buffers.rays)
                .read("passed", &buffers.passed)
                .write("emitted", &found.emitted)
                .dispatch_linear(count);
        }
        if let Some(smooth) = smooth {
            let image = TexelImage { size: texels.size, members: &found.members[0] };
            smooth.record_as(EMITTERS, commands, texels, image, &found.emitted, &found.spare);
        }
    }
}
