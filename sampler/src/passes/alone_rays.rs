//! Program: `shaders/sampler/alone_rays.wgsl`. Rays of texels that no light cells describe, to the sky and to lit leaves.

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::surface_light::AloneQuery;
use argus_shaders::sampler::ALONE_RAYS;
use glam::Vec2;

use super::TileContext;
use super::scattered_rays::{Sought, Tracing};
use super::smooth_texels::{SmoothTexels, TexelImage};
use crate::lit_leaves::LeavesAbout;
use crate::lit_tile::LitTexels;
use crate::resident::Features;

/// Row of the timing table.
const CELLS: &str = "look up light cells";

/// What rays of texels alone find light by.
#[derive(Clone, Copy)]
pub(crate) struct AloneLight<'a> {
    pub(crate) tracing: Tracing<'a>,
    pub(crate) leaves: &'a LeavesAbout<'a>,
    /// Metres beyond which a ray reaches the sky.
    pub(crate) reach: f32,
}

/// A program for each step.
pub(crate) struct AloneRays {
    cast_rays: ComputePipeline,
    sum_rays: ComputePipeline,
    keep_light: ComputePipeline,
    /// Rays of a texel.
    rays: u32,
    /// Points of the unit disc: those of each slot for the first ray, then for the second, and so on.
    points: wgpu::Buffer,
}

impl AloneRays {
    /// `rays`: of a texel. `points`: of the unit disc, for all slots and rays.
    pub(crate) fn new(gpu: &Gpu, features: Features, rays: u32, points: &[Vec2]) -> Self {
        let points: Vec<[f32; 2]> = points.iter().map(|point| point.to_array()).collect();
        Self {
            cast_rays: gpu.compute_pipeline(&ALONE_RAYS, "cast_rays"),
            sum_rays: gpu.compute_pipeline_with(&ALONE_RAYS, "sum_rays", &[features.sky_constant()]),
            keep_light: gpu.compute_pipeline(&ALONE_RAYS, "keep_light"),
            rays,
            points: gpu.upload("points of texels alone", &points, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Lights the texels that are members of the first image: the share of the sky, and irradiance / π of other surfaces.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        texels: &LitTexels,
        by: AloneLight<'_>,
        smooth: &SmoothTexels,
    ) {
        let AloneLight { tracing, leaves, reach } = by;
        let (gpu, buffers, found) = (&texels.gpu, &texels.buffers, texels.found());
        let (count, members) = (u64::from(texels.count), &found.members[0]);
        let [seen, whole, reflected] = &found.work;
        found.work.iter().for_each(|sums| {
            commands.clear(sums);
        });
        for ray in 0..self.rays {
            let query = AloneQuery { ray, reach };
            let query = gpu.upload("rays of texels alone", &[query], wgpu::BufferUsages::UNIFORM);
            texels
                .bind(commands.compute(CELLS, &self.cast_rays))
                .read("alone_query", &query)
                .read("disc_points", &self.points)
                .write("alone_rays", &buffers.rays)
                .read("members", members)
                .dispatch_linear(count);
            let sought = Sought::Nearest(&found.hits);
            tracing.record_as(CELLS, commands, gpu, &buffers.rays, texels.count, sought);
            leaves
                .bind(texels.bind_size(commands.compute(CELLS, &self.sum_rays)))
                .read("alone_query", &query)
                .read("lighting", &context.eye.lighting)
                .read("environment_map", context.resident.environment.view())
                .write("alone_rays", &buffers.rays)
                .read("hits", &found.hits)
                .read("members", members)
                .write("seen_sums", seen)
                .write("whole_sums", whole)
                .write("reflected_sums", reflected)
                .dispatch_linear(count);
        }
        let image = TexelImage { size: texels.size, members };
        for sums in &found.work {
            smooth.record_as(CELLS, commands, texels, image, sums, &found.spare);
        }
        texels
            .bind_size(commands.compute(CELLS, &self.keep_light))
            .read("members", members)
            .write("seen_sums", seen)
            .write("whole_sums", whole)
            .write("reflected_sums", reflected)
            .write("sky_share", &found.sky_share)
            .write("indirect", &found.indirect)
            .dispatch_linear(count);
    }
}

/// Joins the light of texels that would stand out, which have a 1 in w, with that of those around them. `smooth` is of every texel.
pub(crate) fn smooth_cells(commands: &mut Commands, texels: &LitTexels, smooth: &SmoothTexels) {
    let found = texels.found();
    let image = TexelImage { size: texels.size, members: &found.members[0] };
    for light in [&found.sky_share, &found.indirect] {
        smooth.record_as(CELLS, commands, texels, image, light, &found.spare);
    }
}
