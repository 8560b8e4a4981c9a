//! Program: `shaders/sampler/gather_rays.wgsl`. Texels gather what lit leaves reflect.

use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu, wgpu};
use argus_shaders::layout::surface_light::GatherQuery;
use argus_shaders::sampler::GATHER_RAYS;
use glam::Vec2;

use super::scattered_rays::{Sought, Tracing};
use super::smooth_texels::{SmoothTexels, TexelImage};
use crate::lit_leaves::LeavesAbout;
use crate::lit_tile::LitTexels;

/// Row of the timing table.
const GATHER: &str = "gather paths";
/// Slots whose rays are cast by a texel around which no block shows its surface.
const SLOTS_ALONE: u32 = 4;
/// Slots by which the second surface of a block is ahead: it casts other rays than the first.
const SLOTS_AHEAD: [u32; 2] = [0, 32];

/// A program for each step.
pub(crate) struct GatherRays {
    halve: ComputePipeline,
    cast_rays: ComputePipeline,
    sum_rays: ComputePipeline,
    spread: ComputePipeline,
    cast_listed: ComputePipeline,
    sum_listed: ComputePipeline,
    /// Points of the unit disc: those of each slot for the first ray, then for the second, and so on.
    points: wgpu::Buffer,
}

/// Blocks of 2×2 texels of a tile.
#[derive(Clone, Copy)]
struct Blocks {
    first: [u32; 2],
    size: [u32; 2],
}

impl Blocks {
    fn of(texels: &LitTexels) -> Self {
        let first = texels.first.map(|at| at / 2);
        let size = [0, 1].map(|axis| {
            let last = texels.first[axis] + texels.size[axis].max(1) - 1;
            last / 2 - first[axis] + 1
        });
        Self { first, size }
    }

    fn query(self, gpu: &Gpu, slot: u32, ray: u32, rays: u32) -> wgpu::Buffer {
        let query =
            GatherQuery { size: self.size, first: self.first, slot, ray, share: 1.0 / rays as f32, _pad: 0 };
        gpu.upload("rays that gather", &[query], wgpu::BufferUsages::UNIFORM)
    }
}

impl GatherRays {
    /// `points`: of the unit disc, for all slots and the most rays of a texel.
    pub(crate) fn new(gpu: &Gpu, points: &[Vec2]) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&GATHER_RAYS, entry);
        let points: Vec<[f32; 2]> = points.iter().map(|point| point.to_array()).collect();
        Self {
            halve: pipeline("halve"),
            cast_rays: pipeline("cast_rays"),
            sum_rays: pipeline("sum_rays"),
            spread: pipeline("spread"),
            cast_listed: pipeline("cast_listed"),
            sum_listed: pipeline("sum_listed"),
            points: gpu.upload("points that gather", &points, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Leaves irradiance / π of other surfaces. `rays`: of a texel that shares what it finds.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        leaves: &LeavesAbout<'_>,
        rays: u32,
        smooth: &SmoothTexels,
    ) {
        let (gpu, found, blocks) = (&texels.gpu, texels.found(), Blocks::of(texels));
        let whole = blocks.query(gpu, 0, 0, 1);
        let [one, other] = &found.members;
        let image = |members| TexelImage { size: blocks.size, members };
        texels
            .bind(commands.compute(GATHER, &self.halve))
            .read("gather_query", &whole)
            .write("members", one)
            .write("other_members", other)
            .dispatch_linear(image(one).count());
        for (layer, ahead) in SLOTS_AHEAD.into_iter().enumerate() {
            let (members, values) = (&found.members[layer], &found.work[layer]);
            commands.clear(values);
            for ray in 0..rays {
                let query = blocks.query(gpu, ahead, ray, rays);
                self.cast(commands, texels, tracing, leaves, &query, image(members), values);
            }
            smooth.record_as(GATHER, commands, texels, image(members), values, &found.spare);
        }
        commands.clear(&found.list_count);
        texels
            .bind(commands.compute(GATHER, &self.spread))
            .read("gather_query", &whole)
            .write("members", one)
            .write("other_members", other)
            .write("found", &found.work[0])
            .write("other_found", &found.work[1])
            .write("list_count", &found.list_count)
            .write("list", &found.list)
            .write("indirect", &found.indirect)
            .dispatch_linear(u64::from(texels.count));
        for slot in 0..SLOTS_ALONE {
            for ray in 0..rays {
                let query = blocks.query(gpu, slot, ray, rays * SLOTS_ALONE);
                self.cast_listed(commands, texels, tracing, leaves, &query);
            }
        }
    }

    /// A ray of each point of an image of blocks.
    #[allow(clippy::too_many_arguments, reason = "what a ray is cast from, through and into")]
    fn cast(
        &self,
        commands: &mut Commands,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        leaves: &LeavesAbout<'_>,
        query: &wgpu::Buffer,
        image: TexelImage<'_>,
        values: &wgpu::Buffer,
    ) {
        let (buffers, found, count) = (&texels.buffers, texels.found(), image.count());
        texels
            .bind(commands.compute(GATHER, &self.cast_rays))
            .read("gather_query", query)
            .read("disc_points", &self.points)
            .write("gather_rays", &buffers.rays)
            .write("members", image.members)
            .dispatch_linear(count);
        let sought = Sought::Nearest(&found.hits);
        tracing.record_as(GATHER, commands, &texels.gpu, &buffers.rays, count as u32, sought);
        let call: ComputeCall<'_> = commands.compute(GATHER, &self.sum_rays);
        leaves
            .bind(call)
            .read("gather_query", query)
            .write("gather_rays", &buffers.rays)
            .read("hits", &found.hits)
            .write("members", image.members)
            .write("found", values)
            .dispatch_linear(count);
    }

    /// A ray of each listed texel. How many there are is known to the device alone, so rays for all are dispatched; those that there
    /// are not end at once.
    fn cast_listed(
        &self,
        commands: &mut Commands,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        leaves: &LeavesAbout<'_>,
        query: &wgpu::Buffer,
    ) {
        let (buffers, found, count) = (&texels.buffers, texels.found(), u64::from(texels.count));
        texels
            .bind(commands.compute(GATHER, &self.cast_listed))
            .read("gather_query", query)
            .read("disc_points", &self.points)
            .write("gather_rays", &buffers.rays)
            .write("list_count", &found.list_count)
            .write("list", &found.list)
            .dispatch_linear(count);
        let sought = Sought::Nearest(&found.hits);
        tracing.record_as(GATHER, commands, &texels.gpu, &buffers.rays, texels.count, sought);
        leaves
            .bind(commands.compute(GATHER, &self.sum_listed))
            .read("gather_query", query)
            .write("gather_rays", &buffers.rays)
            .read("hits", &found.hits)
            .write("list_count", &found.list_count)
            .write("list", &found.list)
            .write("indirect", &found.indirect)
            .dispatch_linear(count);
    }
}
