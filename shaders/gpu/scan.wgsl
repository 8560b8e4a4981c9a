// Program of gpu/src/scan.rs: exclusive prefix sums, in place.
//
// Each invocation sums a run of values, so there are no barriers. The sums of runs are scanned in the same way.

import package::shared::linear::linear_index;

struct ScanRange {
    count: u32,
}

var<immediate> range: ScanRange;

@group(0) @binding(0) var<storage, read_write> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;

// Values of a run. Must equal `RUN` of scan.rs; a test scans arrays of sizes around it.
const RUN: u32 = 32u;

// Sums each run.
@compute @workgroup_size(64)
fn reduce(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let first = at * RUN;
    if first >= range.count {
        return;
    }
    var sum = 0u;
    for (var i = 0u; i < RUN; i++) {
        let index = first + i;
        if index < range.count {
            sum += values[index];
        }
    }
    sums[at] = sum;
}

// Replaces the values of a run by their exclusive prefix sums, starting from `before`.
fn spread_run(first: u32, before: u32) {
    var sum = before;
    for (var i = 0u; i < RUN; i++) {
        let index = first + i;
        if index < range.count {
            let value = values[index];
            values[index] = sum;
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
    if at * RUN < range.count {
        spread_run(at * RUN, sums[at]);
    }
}

// Scans the last level, which is one run. Its sum is the total, which `reduce` wrote to `sums`.
@compute @workgroup_size(1)
fn spread_top(@builtin(local_invocation_index) local: u32) {
    spread_run(local, 0u);
}
