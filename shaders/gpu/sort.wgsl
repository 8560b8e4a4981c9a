// Program of gpu/src/sort.rs: sorts 64-bit keys by one digit of 4 bits; a stable radix sort.
//
// Each invocation counts a run of keys by digit, in two 64-bit words of eight 8-bit counters each. So ranks within a run
// need neither barriers nor memory.

import package::shared::linear::linear_index;

struct Digit {
    count: u32,
    // Number of runs of keys.
    runs: u32,
    // Lowest bit of the digit.
    shift: u32,
}

var<immediate> digit: Digit;

@group(0) @binding(0) var<storage, read> keys: array<u64>;
// Number of keys by digit, then by run. After a scan: index of the first such key in `sorted`.
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> sorted: array<u64>;

// Keys of a run.
const RUN: u32 = 64u;

// Counts the keys of each run by digit.
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

// Moves each key to its sorted position.
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
