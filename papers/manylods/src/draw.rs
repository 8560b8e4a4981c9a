//! Draws the cuts of all views into their maps. Program: `shaders/cut_draw.wgsl`.

use crate::layout::DrawStep;
use crate::programs::CUT_DRAW;

use crate::CutSettings;
use crate::counters::QUEUES;
use crate::passes::CutWork;
use argus_gpu::{Commands, ComputePipeline, Gpu};
use argus_megaviews::many_views::{MapSet, with_maps};

/// Counter of the queue of leaves that cover many texels: the last one.
const LARGE: u32 = QUEUES + 31;

/// The pipelines, for one choice of texels, number of arrays, threshold and kind of leaves.
#[derive(Debug)]
pub(crate) struct DrawPasses {
    prepare_draw: ComputePipeline,
    draw: ComputePipeline,
    prepare_fill: ComputePipeline,
    fill_large: ComputePipeline,
}

impl DrawPasses {
    /// Pipelines for maps of this layout.
    pub(crate) fn new(gpu: &Gpu, settings: &CutSettings, surfels: bool, maps: &MapSet) -> Self {
        let surfels = ("surfels", f64::from(u8::from(surfels)));
        let reach = ("reach", f64::from(settings.threshold.ceil()));
        let fill = [&[surfels][..], &maps.constants()].concat();
        let disc = ("disc_of_cell", f64::from(settings.disc));
        let draw = [&fill[..], &[reach, disc]].concat();
        Self {
            prepare_draw: gpu.compute_pipeline(&CUT_DRAW, "prepare_draw"),
            draw: gpu.compute_pipeline_with(&CUT_DRAW, "draw", &draw),
            prepare_fill: gpu.compute_pipeline(&CUT_DRAW, "prepare_fill"),
            fill_large: gpu.compute_pipeline_with(&CUT_DRAW, "fill_large", &fill),
        }
    }

    pub(crate) fn run(&self, commands: &mut Commands, work: &CutWork<'_>, maps: &MapSet) {
        let CutWork { tree, settings, pool, .. } = *work;
        let step = DrawStep {
            views: work.views.count(),
            side: settings.side,
            threshold: settings.threshold,
            edge: tree.root.edge as f32,
            map_shift: maps.shift,
            capacity: pool.capacity,
            queue: LARGE,
            arguments: 0,
        };
        let step = bytemuck::bytes_of(&step);
        commands
            .compute("draw", &self.prepare_draw)
            .write("counters", &pool.counters)
            .write("state", &pool.state)
            .write("arguments", &pool.arguments)
            .immediates(step)
            .dispatch([1, 1, 1]);
        let call = commands
            .compute("draw", &self.draw)
            .read("nodes", &tree.nodes)
            .read("spheres", &tree.spheres)
            .read("eyes", work.eyes)
            .read("entries", &pool.entries)
            .read("chunks", &pool.chunks)
            .write("next", &pool.queues[0])
            .write("counters", &pool.counters)
            .write("state", &pool.state);
        with_maps(call, maps).immediates(step).dispatch_indirect(&pool.arguments, 0);
        commands
            .compute("fill", &self.prepare_fill)
            .write("counters", &pool.counters)
            .write("arguments", &pool.arguments)
            .immediates(step)
            .dispatch([1, 1, 1]);
        let call = commands
            .compute("fill", &self.fill_large)
            .read("nodes", &tree.nodes)
            .read("spheres", &tree.spheres)
            .read("cones", &tree.cones)
            .read("eyes", work.eyes)
            .read("queue", &pool.queues[0])
            .write("counters", &pool.counters);
        with_maps(call, maps).immediates(step).dispatch_indirect(&pool.arguments, 0);
    }
}
