// Program of gpu/src/scattered_atomics.rs: measures atomic maxima at pseudo-random words of a buffer. Traversals write maps
// in this pattern.

import package::shared::linear::linear_index;

struct Scatter {
    // Number of words of the buffer, of 32 or 64 bits.
    words: u32,
    // Differs between dispatches, so that no dispatch finds its words in a cache.
    seed: u32,
}

var<immediate> scatter: Scatter;

// Operations of an invocation. Must equal `EACH` of scattered_atomics.rs, whose test counts them.
const EACH: u32 = 16u;

@group(0) @binding(0) var<storage, read_write> words_32: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read_write> words_64: array<atomic<u64>>;

// PCG hash (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020).
fn hash(n: u32) -> u32 {
    let state = n * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// A uniformly distributed index: the upper half of a product, which needs no division.
fn word_index(n: u32) -> u32 {
    return u32((u64(hash(n ^ scatter.seed)) * u64(scatter.words)) >> 32u);
}

@compute @workgroup_size(64)
fn scatter_32(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * EACH;
    for (var i = 0u; i < EACH; i++) {
        atomicMax(&words_32[word_index(first + i)], hash(first - i) | 1u);
    }
}

@compute @workgroup_size(64)
fn scatter_64(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * EACH;
    for (var i = 0u; i < EACH; i++) {
        let value = hash(first - i) | 1u;
        atomicMax(&words_64[word_index(first + i)], (u64(value) << 32u) | u64(first));
    }
}
