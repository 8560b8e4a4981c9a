// Program of gpu/src/many_views/queue.rs: how many workgroups the next step of a traversal takes, and the first pairs.

import package::shared::linear::{LINEAR_GROUP, linear_index};

struct QueueStep {
    // Entry of `counters` for the queue.
    counters: u32,
    // Entry that says whether a queue of this part of the frame overflowed; the first of all is the maps'.
    overflow: u32,
    // Where the three numbers of workgroups go.
    arguments: u32,
    // Pairs that a workgroup takes.
    group: u32,
    // The scene's root, or the first of its leaves.
    scene_node: u32,
    first_view: u32,
    // Pairs that a traversal begins with.
    count: u32,
    // Of the view octree.
    level: u32,
    // Maps that there is room for.
    maps: u32,
}

var<immediate> step: QueueStep;

@group(0) @binding(0) var<storage, read_write> counters: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read_write> arguments: array<u32>;
@group(0) @binding(2) var<storage, read_write> queue: array<vec2u>;
@group(0) @binding(3) var<storage, read> levels: array<vec2u>;
@group(0) @binding(4) var<storage, read> map_total: array<u32>;
@group(0) @binding(5) var<storage, read> map_levels: array<vec2u>;

fn arguments_for(groups: u32) {
    let across = min(groups, 32768u);
    arguments[step.arguments] = across;
    arguments[step.arguments + 1u] = (groups + max(across, 1u) - 1u) / max(across, 1u);
    arguments[step.arguments + 2u] = 1u;
}

// After an overflow nothing follows: the frame is run again.
@compute @workgroup_size(1)
fn prepare() {
    let overflowed = (atomicLoad(&counters[0]) | atomicLoad(&counters[step.overflow])) != 0u;
    let pairs = select(atomicLoad(&counters[step.counters]), 0u, overflowed);
    arguments_for((pairs + step.group - 1u) / step.group);
}

// As many workgroups as the maps of a level have parts of 64 texels; `group` is those of one map.
@compute @workgroup_size(1)
fn prepare_fusion() {
    let overflowed = atomicLoad(&counters[0]) != 0u;
    let maps = select(map_levels[step.level].y, 0u, overflowed);
    arguments_for(maps * step.group);
}

// The scene's root with each of a range of views.
@compute @workgroup_size(64)
fn seed_views(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        queue[at] = vec2u(step.scene_node, step.first_view + at);
    }
    if at == 0u {
        atomicStore(&counters[step.counters], step.count);
    }
}

// The scene's root, or every leaf of it, with the root of the view octree. Says so where there are more maps than there is room
// for.
@compute @workgroup_size(64)
fn seed_nodes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        queue[at] = vec2u(step.scene_node + at, levels[0].x);
    }
    if at == 0u {
        if map_total[0] > step.maps {
            atomicMax(&counters[0], 1u);
        }
        atomicStore(&counters[step.counters], step.count);
    }
}
