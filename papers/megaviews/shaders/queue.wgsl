// Program of papers/megaviews/src/many_views/traverse.rs: computes the workgroups of the next step of a traversal, and the first pairs.

import package::shared::linear::{LINEAR_GROUP, linear_index};

struct QueueStep {
    // Index of the queue in `counters`.
    counters: u32,
    // Index in `counters` of the overflow flag of this part of the frame. Index 0 is the flag of the maps.
    overflow: u32,
    // Index in `arguments` of the three numbers of workgroups.
    arguments: u32,
    // Pairs per workgroup.
    group: u32,
    // The scene's root, or the first of its leaves.
    scene_node: u32,
    first_view: u32,
    // Number of pairs that the traversal starts with.
    count: u32,
    // Level of the view octree.
    level: u32,
    // Number of allocated maps.
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

// Sets the workgroups for a queue. After an overflow there are none, since the frame is run again.
@compute @workgroup_size(1)
fn prepare() {
    let overflowed = (atomicLoad(&counters[0]) | atomicLoad(&counters[step.overflow])) != 0u;
    let pairs = select(atomicLoad(&counters[step.counters]), 0u, overflowed);
    arguments_for((pairs + step.group - 1u) / step.group);
}

// Sets the workgroups for the maps of a level. `group` is the number of parts of 64 texels in one map.
@compute @workgroup_size(1)
fn prepare_fusion() {
    let overflowed = atomicLoad(&counters[0]) != 0u;
    let maps = select(map_levels[step.level].y, 0u, overflowed);
    arguments_for(maps * step.group);
}

// Fills the queue with pairs of the scene's root and each view of a range.
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

// Fills the queue with pairs of the scene's root, or each of its leaves, and the root of the view octree. Sets the overflow
// flag if there are more maps than were allocated.
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
