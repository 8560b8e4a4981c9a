// Program of gpu/src/hierarchy/sort.rs: one digit of a stable radix sort of 64-bit keys.
//
// An invocation takes a run of keys and counts them by digit in two 64-bit words of eight 8-bit counters, so that the
// order within a run needs neither barriers nor memory of its own.

import package::shared::linear::linear_index;

struct Digit {
    count: u32,
    // Runs that the keys fall into.
    runs: u32,
    // Lowest bit of the digit.
    shift: u32,
}

var<immediate> digit: Digit;

@group(0) @binding(0) var<storage, read> keys: array<u64>;
// By digit, then by run: how many keys, and after a scan, where the first goes.
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> sorted: array<u64>;

const RUN: u32 = 64u;

@compute @workgroup_size(64)
fn histogram(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let run = linear_index(group, groups, local);
    if run >= digit.runs {
        return;
    }
    var low = 0lu;
    var high = 0lu;
    for (var i = 0u; i < RUN; i++) {
        let index = run * RUN + i;
        if index < digit.count {
            let value = u32(keys[index] >> digit.shift) & 15u;
            let one = 1lu << (8u * (value & 7u));
            if value < 8u {
                low += one;
            } else {
                high += one;
            }
        }
    }
    for (var value = 0u; value < 8u; value++) {
        counts[value * digit.runs + run] = u32(low >> (8u * value)) & 255u;
        counts[(value + 8u) * digit.runs + run] = u32(high >> (8u * value)) & 255u;
    }
}

@compute @workgroup_size(64)
fn scatter(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let run = linear_index(group, groups, local);
    if run >= digit.runs {
        return;
    }
    var low = 0lu;
    var high = 0lu;
    for (var i = 0u; i < RUN; i++) {
        let index = run * RUN + i;
        if index < digit.count {
            let key = keys[index];
            let value = u32(key >> digit.shift) & 15u;
            let shift = 8u * (value & 7u);
            var rank = u32(low >> shift) & 255u;
            if value < 8u {
                low += 1lu << shift;
            } else {
                rank = u32(high >> shift) & 255u;
                high += 1lu << shift;
            }
            sorted[counts[value * digit.runs + run] + rank] = key;
        }
    }
}
