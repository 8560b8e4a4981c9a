//! Finds the cuts of all views. Program: `shaders/cut.wgsl`.

use crate::layout::CutStep;
use crate::programs::CUT;
use argus_gpu::wgpu::Buffer;

use crate::counters::QUEUES;
use crate::pool::Pool;
use crate::{CutMethod, CutSettings, CutTree};
use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu};
use argus_megaviews::many_views::ViewList;

/// Units of motion per edge of the root: `UNITS` of the program.
const UNITS: f64 = (1u32 << 22) as f64;

/// The pipelines, specialised to whether nodes are culled and entries are sorted.
#[derive(Debug)]
pub(crate) struct CutPasses {
    reset_chunks: ComputePipeline,
    move_views: ComputePipeline,
    tick: ComputePipeline,
    find_due: ComputePipeline,
    prepare_visits: ComputePipeline,
    visit: ComputePipeline,
    prepare: ComputePipeline,
    split: ComputePipeline,
    allot: ComputePipeline,
    place: ComputePipeline,
}

/// Inputs and buffers of one frame.
pub(crate) struct CutWork<'a> {
    pub(crate) tree: &'a CutTree,
    pub(crate) settings: &'a CutSettings,
    pub(crate) pool: &'a Pool,
    pub(crate) eyes: &'a Buffer,
    pub(crate) views: &'a ViewList,
    /// Whether the cuts of all views restart from the root.
    pub(crate) restart: bool,
}

impl CutPasses {
    /// Makes the pipelines.
    pub(crate) fn new(gpu: &Gpu, settings: &CutSettings) -> Self {
        let flag = |set: bool| f64::from(u8::from(set));
        let constants =
            [("culls", flag(settings.culling)), ("ordered", flag(settings.method != CutMethod::Basic))];
        // A pipeline accepts only constants that its entry point uses.
        let pipeline = |entry, names: &[&str]| {
            let given: Vec<_> = constants.into_iter().filter(|(name, _)| names.contains(name)).collect();
            gpu.compute_pipeline_with(&CUT, entry, &given)
        };
        let both = ["culls", "ordered"];
        Self {
            reset_chunks: pipeline("reset_chunks", &both),
            move_views: pipeline("move_views", &both),
            tick: pipeline("tick", &both),
            find_due: pipeline("find_due", &both),
            prepare_visits: pipeline("prepare_visits", &both),
            visit: pipeline("visit", &both),
            prepare: pipeline("prepare", &both),
            split: pipeline("split", &both),
            allot: pipeline("allot", &both),
            place: pipeline("place", &both),
        }
    }

    /// Records the passes of one frame.
    pub(crate) fn run(&self, commands: &mut Commands, work: &CutWork<'_>) {
        let CutWork { tree, settings, pool, restart, .. } = *work;
        let step = CutStep {
            views: work.views.count(),
            root: tree.root_node,
            scale: settings.side as f32 / settings.threshold,
            jump: settings.jump as f32,
            capacity: pool.capacity,
            chunks: pool.chunk_count,
            queue_in: QUEUES,
            queue_out: QUEUES,
            arguments: 0,
            lag: if matches!(settings.method, CutMethod::Lazy { .. }) {
                (settings.lag * UNITS) as u32
            } else {
                0
            },
            restart: u32::from(restart),
            deep: 1,
        };
        let ordered = settings.method != CutMethod::Basic;
        commands.clear(&pool.counters);
        if restart && ordered {
            commands
                .compute("restart", &self.reset_chunks)
                .write("chunks", &pool.chunks)
                .write("free", &pool.free)
                .write("state", &pool.state)
                .read("moved", &tree.moved)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(pool.chunk_count));
        }
        let call = commands
            .compute("move views", &self.move_views)
            .read("spheres", &tree.spheres)
            .read("views", work.views.buffer())
            .write("eyes", work.eyes)
            .write("next", &pool.queues[0]);
        bind_settled(call, pool)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(work.views.count()));
        if ordered && !restart {
            self.test_due_chunks(commands, work, step);
        }
        let max_depth = match settings.method {
            CutMethod::Lazy { edges } => edges,
            _ => u32::MAX,
        };
        for level in 0..tree.depth {
            let step = CutStep {
                queue_in: QUEUES + level,
                queue_out: QUEUES + level + 1,
                deep: u32::from(level < max_depth),
                ..step
            };
            commands
                .compute("prepare", &self.prepare)
                .write("counters", &pool.counters)
                .write("arguments", &pool.arguments)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch([1, 1, 1]);
            let call = commands
                .compute("split", &self.split)
                .read("nodes", &tree.nodes)
                .read("spheres", &tree.spheres)
                .write("eyes", work.eyes)
                .write("state", &pool.state)
                .read("queue", &pool.queues[level as usize % 2])
                .write("next", &pool.queues[(level as usize + 1) % 2]);
            bind_settled(call, pool)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_indirect(&pool.arguments, 0);
        }
        self.store(commands, pool, &step);
    }

    /// Advances the clock, and tests the entries of due chunks again.
    fn test_due_chunks(&self, commands: &mut Commands, work: &CutWork<'_>, step: CutStep) {
        let CutWork { tree, pool, .. } = *work;
        let step = bytemuck::bytes_of(&step);
        commands
            .compute("due", &self.tick)
            .read("moved", &tree.moved)
            .write("state", &pool.state)
            .write("counters", &pool.counters)
            .write("arguments", &pool.arguments)
            .immediates(step)
            .dispatch([1, 1, 1]);
        commands
            .compute("due", &self.find_due)
            .write("chunks", &pool.chunks)
            .write("free", &pool.free)
            .write("due", &pool.due)
            .write("counters", &pool.counters)
            .write("state", &pool.state)
            .immediates(step)
            .dispatch_indirect(&pool.arguments, 0);
        commands
            .compute("due", &self.prepare_visits)
            .write("counters", &pool.counters)
            .write("arguments", &pool.arguments)
            .immediates(step)
            .dispatch([1, 1, 1]);
        let call = commands
            .compute("visit", &self.visit)
            .read("nodes", &tree.nodes)
            .read("spheres", &tree.spheres)
            .read("parents", &tree.parents)
            .write("eyes", work.eyes)
            .write("due", &pool.due)
            .write("state", &pool.state)
            .write("next", &pool.queues[0]);
        bind_settled(call, pool).immediates(step).dispatch_indirect(&pool.arguments, 0);
    }

    /// Sorts the settled entries into chunks.
    fn store(&self, commands: &mut Commands, pool: &Pool, step: &CutStep) {
        commands
            .compute("place", &self.allot)
            .write("counters", &pool.counters)
            .write("state", &pool.state)
            .write("arguments", &pool.arguments)
            .immediates(bytemuck::bytes_of(step))
            .dispatch([1, 1, 1]);
        let call = commands
            .compute("place", &self.place)
            .write("chunks", &pool.chunks)
            .write("state", &pool.state)
            .write("free", &pool.free);
        bind_settled(call, pool).immediates(bytemuck::bytes_of(step)).dispatch_indirect(&pool.arguments, 0);
    }
}

/// Binds the buffers of settled entries.
fn bind_settled<'a>(call: ComputeCall<'a>, pool: &'a Pool) -> ComputeCall<'a> {
    call.write("settled", &pool.settled)
        .write("slots", &pool.slots)
        .write("entries", &pool.entries)
        .write("counters", &pool.counters)
}
