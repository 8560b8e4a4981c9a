//! Program: `shaders/sampler/scattered_rays.wgsl`. Traces scattered rays: nearest hits, or the share of light that passes.

use std::sync::{Arc, OnceLock};

use argus_gpu::{Commands, ComputePipeline, Gpu, LONGEST_PASS_MS, PendingReadback, wgpu};
use argus_shaders::layout::sampler::ScatteredQuery;
use argus_shaders::sampler::SCATTERED_RAYS;

use crate::light_rays::device::{DevicePlaced, DeviceTrees};

/// Most rays of the first dispatches, on a GPU and on a software driver. At the least rates known, they take a fifth of
/// [`LONGEST_PASS_MS`].
const FIRST_RAYS: [u32; 2] = [1 << 22, 1 << 15];
/// Share of [`LONGEST_PASS_MS`] that a dispatch may take by the measured rate.
const SHARE_OF_LONGEST: f64 = 0.2;
/// Invocations of a workgroup, as the program declares, and rays that each traces one after another: the fastest of those measured
/// on an H200 (`docs/gpu.md`).
const LANES: u32 = 128;
const RAYS_EACH: u32 = 4;
/// Most workgroups along the first axis of a dispatch.
const ACROSS: u32 = 1 << 15;

/// What is found of each ray.
#[derive(Clone, Copy)]
pub(crate) enum Sought<'a> {
    /// The nearest hit, as `ScatteredHit` of the program.
    Nearest(&'a wgpu::Buffer),
    /// The share of light that passes, an f32.
    Passed(&'a wgpu::Buffer),
}

/// A tracer with the trees that it walks, about an eye.
#[derive(Clone, Copy)]
pub(crate) struct Tracing<'a> {
    pub(crate) rays: &'a ScatteredRays,
    pub(crate) trees: &'a DeviceTrees,
    pub(crate) placed: &'a DevicePlaced,
}

/// One ray an invocation at a time.
pub(crate) struct ScatteredRays {
    /// By whether there are several placed objects, and whether the nearest hit is sought.
    pipelines: [[OnceLock<ComputePipeline>; 2]; 2],
    /// Set by walks that were cut off.
    unfinished: wgpu::Buffer,
    /// Bound in the place of results that are not sought.
    unused: wgpu::Buffer,
    /// Most rays of a dispatch.
    most_rays: u32,
}

impl Tracing<'_> {
    /// Traces the first `count` rays of a buffer. `name` is the row in the timing table.
    pub(crate) fn record_as(
        self,
        name: &str,
        commands: &mut Commands,
        gpu: &Arc<Gpu>,
        rays: &wgpu::Buffer,
        count: u32,
        sought: Sought<'_>,
    ) {
        let Self { rays: tracer, trees, placed } = self;
        let pipeline = tracer.pipeline(gpu, trees, placed, sought);
        let (hits, passed) = match sought {
            Sought::Nearest(hits) => (hits, &tracer.unused),
            Sought::Passed(passed) => (&tracer.unused, passed),
        };
        for first in (0..count).step_by(tracer.most_rays as usize) {
            let end = first.saturating_add(tracer.most_rays).min(count);
            let [min, max] = placed.around.map(|corner| corner.to_array());
            let query = ScatteredQuery { min, first, max, end };
            let query = gpu.upload("rays of a dispatch", &[query], wgpu::BufferUsages::UNIFORM);
            commands
                .compute(name, pipeline)
                .read("query", &query)
                .read("rays", rays)
                .read("nodes", &trees.nodes)
                .read("top", &placed.top)
                .read("triangles", &trees.triangles)
                .read("placed", &placed.placed)
                .read("masks", &trees.masks)
                .read("mask_triangles", &trees.mask_triangles)
                .read("mask_texels", &trees.mask_texels)
                .write("hits", hits)
                .write("passed", passed)
                .write("unfinished", &tracer.unfinished)
                .dispatch(ScatteredRays::groups(end - first));
        }
    }
}

impl ScatteredRays {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        Self {
            pipelines: Default::default(),
            unfinished: gpu.buffer("unfinished rays", 4, usage),
            unused: gpu.buffer("results that are not sought", 64, wgpu::BufferUsages::STORAGE),
            most_rays: FIRST_RAYS[usize::from(gpu.is_software())],
        }
    }

    /// Bounds dispatches by a measured rate.
    pub(crate) fn bound_by(&mut self, rays_per_ms: f64) {
        let most = rays_per_ms * LONGEST_PASS_MS * SHARE_OF_LONGEST;
        self.most_rays = (most as u32).clamp(1 << 12, 1 << 26);
    }

    /// Forgets walks that were cut off.
    pub(crate) fn clear_unfinished(&self, commands: &mut Commands) {
        commands.clear(&self.unfinished);
    }

    /// Reads back whether any walk was cut off: not zero if so.
    pub(crate) fn read_unfinished(&self, commands: &mut Commands) -> PendingReadback {
        commands.read_buffer(&self.unfinished, 0..4)
    }

    /// Workgroups for a number of rays.
    fn groups(rays: u32) -> [u32; 3] {
        let groups = rays.div_ceil(LANES * RAYS_EACH);
        let across = groups.clamp(1, ACROSS);
        [across, groups.div_ceil(across), 1]
    }

    fn pipeline(
        &self,
        gpu: &Gpu,
        trees: &DeviceTrees,
        placed: &DevicePlaced,
        sought: Sought<'_>,
    ) -> &ComputePipeline {
        let is_nearest = matches!(sought, Sought::Nearest(_));
        let [objects, nearest] = [placed.has_objects, is_nearest].map(usize::from);
        self.pipelines[objects][nearest].get_or_init(|| {
            let flag = |set: bool| f64::from(u8::from(set));
            let constants = [
                ("has_objects", flag(placed.has_objects)),
                ("has_masks", flag(trees.has_masks)),
                ("has_transparent", flag(trees.has_transparent)),
                ("rays_each", f64::from(RAYS_EACH)),
            ];
            let entry = if is_nearest { "nearest" } else { "passing" };
            // SAFETY: each iteration of the walk takes a bit from a finite number of groups of children, since trees have
            // no cycles; the loop over triangles takes a bit of a word; and the others have constant bounds. Indices are
            // those of trees that the host built, no deeper than the stack, and of rays below the number of rays, for
            // each of which there is room for a result.
            unsafe { gpu.compute_pipeline_unchecked(&SCATTERED_RAYS, entry, &constants) }
        })
    }
}
