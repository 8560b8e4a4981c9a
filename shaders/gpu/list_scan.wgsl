// Program of gpu/src/list_scan.rs: exclusive prefix sums, in place, of a list whose length is known on the device only.
//
// As `scan.wgsl`: each invocation sums a run of values, and the sums of runs are scanned in the same way. `advance` computes the
// workgroups of all dispatches.

import package::shared::linear::{LINEAR_GROUP, linear_index};

struct ListStep {
    // Index of the list.
    list: u32,
    // Level of sums: 0 is the list itself.
    level: u32,
    // Most elements of the list.
    capacity: u32,
    // Index in `total` of the length that the list should have, and what is added to it.
    word: u32,
    more: u32,
}

var<immediate> step: ListStep;

// Two words a list: its length, 0 if it does not fit; and the length that it should have.
@group(0) @binding(0) var<storage, read_write> lengths: array<vec2u>;
// Has the length that the list should have.
@group(0) @binding(1) var<storage, read> total: array<u32>;
// Four words for each level: workgroups of an invocation for each element, and one word that is not used. Entry 0 is for the
// list, and entry i + 1 for the runs of level i.
@group(0) @binding(2) var<storage, read_write> arguments: array<vec4u>;
@group(0) @binding(3) var<storage, read> length_of: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> sums: array<u32>;

// Binary logarithm of the values of a run.
const RUN_BITS: u32 = 5u;
const RUN: u32 = 32u;
// Levels of sums of 2^32 values.
const LEVELS: u32 = 7u;

fn workgroups(invocations: u32) -> vec4u {
    let groups = invocations / LINEAR_GROUP + select(0u, 1u, invocations % LINEAR_GROUP != 0u);
    let across = min(groups, 32768u);
    return vec4u(across, (groups + max(across, 1u) - 1u) / max(across, 1u), 1u, 0u);
}

// Values of a level: one for each run of the level below.
fn values_of(length: u32, level: u32) -> u32 {
    var count = length;
    for (var i = 0u; i < LEVELS; i++) {
        if i < level {
            count = (count >> RUN_BITS) + select(0u, 1u, (count & (RUN - 1u)) != 0u);
        }
    }
    return count;
}

// Sets the length of a list, and the workgroups for it.
@compute @workgroup_size(1)
fn advance() {
    let wanted = total[step.word] + step.more;
    let length = select(0u, wanted, wanted <= step.capacity);
    lengths[step.list] = vec2u(length, wanted);
    arguments[0] = workgroups(length);
    for (var level = 0u; level < LEVELS; level++) {
        // One invocation at least, which writes the sum of an empty list.
        arguments[level + 1u] = workgroups(max(values_of(length, level + 1u), 1u));
    }
}

// Sums each run.
@compute @workgroup_size(64)
fn reduce(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let count = values_of(length_of[step.list].x, step.level);
    let first = at * RUN;
    if first >= count && at != 0u {
        return;
    }
    var sum = 0u;
    for (var i = 0u; i < RUN; i++) {
        if first + i < count {
            sum += values[first + i];
        }
    }
    sums[at] = sum;
}

// Replaces the values of a run by their exclusive prefix sums, starting from `before`.
fn spread_run(first: u32, count: u32, before: u32) {
    var sum = before;
    for (var i = 0u; i < RUN; i++) {
        if first + i < count {
            let value = values[first + i];
            values[first + i] = sum;
            sum += value;
        }
    }
}

// Scans each run, starting from its scanned sum.
@compute @workgroup_size(64)
fn spread(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let count = values_of(length_of[step.list].x, step.level);
    if at < (count + RUN - 1u) / RUN {
        spread_run(at * RUN, count, sums[at]);
    }
}

// Scans the last level, which is one run. Its sum is the total, which `reduce` wrote to `sums`.
@compute @workgroup_size(1)
fn spread_top() {
    spread_run(0u, values_of(length_of[step.list].x, step.level), 0u);
}
