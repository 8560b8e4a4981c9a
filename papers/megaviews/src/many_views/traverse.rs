//! Traverses scene and views together. Programs: `shaders/traverse.wgsl`, `queue.wgsl` and `fill.wgsl`.

use crate::layout::{FillStep, PairStep, QueueStep};
use crate::programs::{FILL, QUEUE, TRAVERSE};
use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::counters::{entry, overflow};
use super::schedule::{Part, Step};
use super::view_octree::ViewOctree;
use super::{MapSet, Occlusion, Settings};
use crate::hierarchy::Octree;
use argus_gpu::{Commands, ComputeCall, ComputePipeline, Gpu};

/// The pipelines for one texel format, number of arrays, threshold and culling.
#[derive(Debug)]
pub(super) struct Traverse {
    /// By what is divided (scene, views), and by whether the result is pairs of leaves.
    divide: [[ComputePipeline; 2]; 2],
    fill: ComputePipeline,
    prepare: ComputePipeline,
    prepare_fusion: ComputePipeline,
    seed_views: ComputePipeline,
    seed_nodes: ComputePipeline,
}

/// Two queues of pairs, counters, and indirect arguments.
#[derive(Debug)]
pub(super) struct Queues {
    pub(super) capacity: u32,
    pub(super) pairs: [Buffer; 2],
    pub(super) counters: Buffer,
    arguments: Buffer,
}

/// Inputs of a traversal.
pub(super) struct TraversalInputs<'a> {
    pub(super) octree: &'a Octree,
    pub(super) views: &'a ViewOctree,
    pub(super) maps: &'a MapSet,
    pub(super) queues: &'a Queues,
    pub(super) settings: &'a Settings,
    pub(super) steps: &'a [Step],
    pub(super) owners: Option<&'a NodeOwners>,
}

/// Nodes that belong to one view, such as the nodes of the object around the view. They are culled for that view.
#[derive(Debug, Clone)]
pub struct NodeOwners {
    /// A word a node of the octree: 1 + the index of the view that everything in the node belongs to, or 0.
    pub owners: Buffer,
    /// Index of the first view of a list.
    pub first: u32,
}

impl Queues {
    pub(super) fn new(gpu: &Gpu, capacity: u32, counter_words: u32) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let queue = || gpu.buffer("queue of pairs", u64::from(capacity) * 8, usage);
        Self {
            capacity,
            pairs: [queue(), queue()],
            counters: gpu.buffer("counters", u64::from(counter_words) * 4, usage),
            arguments: gpu.buffer("workgroups", 64 * 16, usage | BufferUsages::INDIRECT),
        }
    }
}

/// Binds every array of maps.
pub fn with_maps<'a>(mut call: ComputeCall<'a>, maps: &'a MapSet) -> ComputeCall<'a> {
    for (name, array) in maps.bindings() {
        call = call.write(name, array);
    }
    call
}

impl Traverse {
    /// Pipelines for maps of this layout.
    pub(super) fn new(gpu: &Gpu, settings: &Settings, maps: &MapSet, leaves_out: bool) -> Self {
        let of_maps = maps.constants();
        let divide = |views: bool, leaves: bool| {
            let owners = [
                ("divides_views", f64::from(views)),
                ("leaves", f64::from(leaves)),
                ("culls", f64::from(settings.culling)),
                ("occludes", f64::from(settings.occlusion != Occlusion::Off)),
                ("alone", f64::from(!settings.sharing)),
                ("leaves_out", f64::from(leaves_out)),
                ("reach", f64::from(settings.threshold.ceil())),
                ("own_disc", f64::from(settings.disc)),
                ("shared_disc", f64::from(settings.shared_disc)),
            ];
            gpu.compute_pipeline_with(&TRAVERSE, "divide", &[&owners[..], &of_maps].concat())
        };
        Self {
            divide: [false, true].map(|views| [false, true].map(|leaves| divide(views, leaves))),
            fill: gpu.compute_pipeline_with(
                &FILL,
                "fill",
                &[&[("own_cell", f64::from(settings.own_cell))][..], &of_maps].concat(),
            ),
            prepare: gpu.compute_pipeline(&QUEUE, "prepare"),
            prepare_fusion: gpu.compute_pipeline(&QUEUE, "prepare_fusion"),
            seed_views: gpu.compute_pipeline(&QUEUE, "seed_views"),
            seed_nodes: gpu.compute_pipeline(&QUEUE, "seed_nodes"),
        }
    }

    /// Traverses the pairs of one part in one shell. `pass` is the index of the pass.
    pub(super) fn run(
        &self,
        commands: &mut Commands,
        inputs: &TraversalInputs<'_>,
        pass: u32,
        part: Part,
        shell: [f32; 2],
    ) {
        let TraversalInputs { octree, views, queues, steps, .. } = inputs;
        let first = entry(pass, 0, steps.len());
        let mut seed = QueueStep {
            counters: first,
            overflow: overflow(pass, steps.len()),
            arguments: 0,
            group: 64,
            scene_node: octree.root_node(),
            first_view: 0,
            count: 1,
            level: 0,
            maps: inputs.maps.capacity,
        };
        match part {
            Part::Octants { .. } => {
                if !inputs.settings.scene_hierarchy {
                    [seed.scene_node, seed.count] = octree.leaves();
                }
                commands
                    .compute("seed", &self.seed_nodes)
                    .write("counters", &queues.counters)
                    .write("queue", &queues.pairs[0])
                    .read("levels", &views.nodes.levels)
                    .read("map_total", views.map_total())
                    .immediates(bytemuck::bytes_of(&seed))
                    .dispatch_linear(u64::from(seed.count));
            }
            Part::Views { first, count } => {
                (seed.first_view, seed.count) = (first, count);
                commands
                    .compute("seed", &self.seed_views)
                    .write("counters", &queues.counters)
                    .write("queue", &queues.pairs[0])
                    .immediates(bytemuck::bytes_of(&seed))
                    .dispatch_linear(u64::from(count));
            }
        }
        for (index, step) in steps.iter().enumerate() {
            self.prepare(commands, queues, entry(pass, index, steps.len()), overflow(pass, steps.len()));
            self.divide(commands, inputs, [pass, index as u32], step, part, shell);
        }
        let last = entry(pass, steps.len(), steps.len());
        self.prepare(commands, queues, last, overflow(pass, steps.len()));
        self.fill(commands, inputs, last);
    }

    fn prepare(&self, commands: &mut Commands, queues: &Queues, counters: u32, overflow: u32) {
        let step = QueueStep { counters, overflow, group: 64, ..bytemuck::Zeroable::zeroed() };
        commands
            .compute("prepare", &self.prepare)
            .write("counters", &queues.counters)
            .write("arguments", &queues.arguments)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch([1, 1, 1]);
    }

    fn divide(
        &self,
        commands: &mut Commands,
        inputs: &TraversalInputs<'_>,
        [pass, index]: [u32; 2],
        step: &Step,
        part: Part,
        [near, far]: [f32; 2],
    ) {
        let TraversalInputs { octree, views, maps, queues, settings, steps, owners } = inputs;
        let index = index as usize;
        let cells = (1u32 << step.scene_level) as f32;
        let mut pairs = PairStep {
            cells,
            radius: 0.75f32.sqrt() / cells,
            side: settings.side as f32,
            threshold: settings.threshold,
            edge: octree.root.edge as f32,
            capacity: queues.capacity,
            counters_in: entry(pass, index, steps.len()),
            counters_out: entry(pass, index + 1, steps.len()),
            overflow: overflow(pass, steps.len()),
            octant: 8,
            counted: 1,
            map_shift: maps.shift,
            near,
            far,
            leaf_views: u32::from(step.view_level == views.depth),
            first_owner: owners.map_or(0, |owners| owners.first),
        };
        if let Part::Octants { level, .. } = part {
            if step.divides_views && step.view_level <= level {
                pairs.octant = part.octant(step.view_level);
            }
            pairs.counted = u32::from(part.counts(step));
        }
        let pipeline = &self.divide[usize::from(step.divides_views)][usize::from(step.leaves)];
        let name = if step.divides_views { "divide views" } else { "divide scene" };
        let call = commands
            .compute(name, pipeline)
            .read("nodes", &octree.nodes)
            .read("view_bounds", &views.bounds)
            .read("view_links", &views.links)
            .read("view_maps", &views.node_maps)
            .read("queue", &queues.pairs[index % 2])
            .write("next", &queues.pairs[(index + 1) % 2])
            .write("counters", &queues.counters)
            // Not read if views own no nodes.
            .read("owners", owners.map_or(&octree.codes, |owners| &owners.owners));
        with_maps(call, maps).immediates(bytemuck::bytes_of(&pairs)).dispatch_indirect(&queues.arguments, 0);
    }

    fn fill(&self, commands: &mut Commands, inputs: &TraversalInputs<'_>, counters: u32) {
        let TraversalInputs { octree, views, maps, queues, settings, steps, .. } = inputs;
        let cells = (1u32 << octree.depth) as f32;
        let step = FillStep {
            cells,
            radius: 0.75f32.sqrt() / cells,
            side: settings.side,
            edge: octree.root.edge as f32,
            capacity: queues.capacity,
            counters,
            map_shift: maps.shift,
        };
        let call = commands
            .compute("fill", &self.fill)
            .read("nodes", &octree.nodes)
            .read("view_links", &views.links)
            .read("view_maps", &views.node_maps)
            .read("queue", &queues.pairs[steps.len() % 2])
            .write("counters", &queues.counters);
        with_maps(call, maps).immediates(bytemuck::bytes_of(&step)).dispatch_indirect(&queues.arguments, 0);
    }

    /// Computes the indirect arguments of each level's fusion. Returns their buffer, 16 bytes a level.
    pub(super) fn prepare_fusion<'a>(
        &self,
        commands: &mut Commands,
        inputs: &'a TraversalInputs<'_>,
    ) -> &'a Buffer {
        let texels = 2 * inputs.settings.side * inputs.settings.side;
        for level in 0..=inputs.views.depth {
            let step = QueueStep {
                arguments: 4 * level,
                group: texels.div_ceil(64),
                level,
                ..bytemuck::Zeroable::zeroed()
            };
            commands
                .compute("prepare", &self.prepare_fusion)
                .write("counters", &inputs.queues.counters)
                .write("arguments", &inputs.queues.arguments)
                .read("map_levels", &inputs.views.map_levels)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch([1, 1, 1]);
        }
        &inputs.queues.arguments
    }
}
