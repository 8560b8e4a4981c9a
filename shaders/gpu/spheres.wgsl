// Program of gpu/src/hierarchy/spheres.rs: a perfect binary tree of balls and cones of normals over points of surfaces
// (ManyLoDs, section 4), made anew or fitted to where the triangles are now.
//
// Nodes are in the order of a heap, the root first. Coordinates are in edges of the root cube.

import package::shared::cone::{cos_of_sum, direction_of, widened};
import package::shared::corners::corner;
import package::shared::hilbert::hilbert_code;
import package::shared::linear::linear_index;

struct SphereStep {
    // Points, or nodes of the level.
    count: u32,
    // First node of the level.
    first: u32,
}

var<immediate> step: SphereStep;

// Triangle, barycentric coordinates of its second and third corner (f32), share of its area (f32).
@group(0) @binding(1) var<storage, read> samples: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> ordered: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> keys: array<vec2u>;
@group(0) @binding(4) var<storage, read> sorted: array<vec2u>;
// Mean position (f32), and 256 times the first child plus a bit for each of both children.
@group(0) @binding(5) var<storage, read_write> nodes: array<vec4u>;
// Center and radius.
@group(0) @binding(6) var<storage, read_write> spheres: array<vec4f>;
// Axis of the cone of normals, and the cosine of its half angle.
@group(0) @binding(7) var<storage, read_write> cones: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> parents: array<u32>;
// How far balls moved and grew since they were first fitted, in units of `MOVES`, each level's most summed; then the
// most of the update at hand, f32 bits.
@group(0) @binding(9) var<storage, read_write> moved: array<atomic<u32>, 4>;

// What a parent's ball is larger than it must be, so that whatever is computed of it in f32 is never less than what is
// computed of its children's.
const WIDER: f32 = 1e-5;
const PAD: f32 = 2e-6;
// Units of motion in an edge of the root: 2^22.
const MOVES: f32 = 4194304.0;

fn position_of(sample: vec4u) -> vec3f {
    let a = corner(sample.x, 0u);
    let s = bitcast<f32>(sample.y);
    let t = bitcast<f32>(sample.z);
    return a + (corner(sample.x, 1u) - a) * s + (corner(sample.x, 2u) - a) * t;
}

@compute @workgroup_size(64)
fn sample_keys(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        let cell = clamp(position_of(samples[at]) * 1024.0, vec3f(0.0), vec3f(1023.0));
        keys[at] = vec2u(at, hilbert_code(vec3u(cell)));
    }
}

@compute @workgroup_size(64)
fn order_samples(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        ordered[at] = samples[sorted[at].x];
    }
}

// Leaves a node, and how much its ball is another than before.
fn store(node: u32, mean: vec3f, links: u32, sphere: vec4f, cone: vec4f) {
    let before = spheres[node];
    let shift = bitcast<u32>(distance(before.xyz, sphere.xyz));
    let growth = bitcast<u32>(abs(before.w - sphere.w));
    // Most are less than what others found: an atomic load is cheaper than a maximum.
    if shift > atomicLoad(&moved[2]) {
        atomicMax(&moved[2], shift);
    }
    if growth > atomicLoad(&moved[3]) {
        atomicMax(&moved[3], growth);
    }
    nodes[node] = vec4u(bitcast<vec3u>(mean), links);
    spheres[node] = sphere;
    cones[node] = cone;
    parents[node] = (max(node, 1u) - 1u) / 2u;
}

// A leaf's ball has the area that the point stands for by its square.
@compute @workgroup_size(64)
fn fit_leaves(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let sample = samples[at];
    let position = position_of(sample);
    let a = corner(sample.x, 0u);
    let normal = cross(corner(sample.x, 1u) - a, corner(sample.x, 2u) - a);
    let area = 0.5 * length(normal) * bitcast<f32>(sample.w);
    let sphere = vec4f(position, sqrt(max(area, 0.0)) + PAD);
    store(step.first + at, position, 0u, sphere, vec4f(direction_of(normal), 1.0));
}

// The smallest ball about two, and the cone about two cones.
@compute @workgroup_size(64)
fn fit_nodes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let node = step.first + at;
    let child = 2u * node + 1u;
    let a = spheres[child];
    let b = spheres[child + 1u];
    let apart = distance(a.xyz, b.xyz);
    let larger = max(a.w, b.w);
    // One of them may hold the other.
    let held = apart + min(a.w, b.w) <= larger;
    let radius = select(0.5 * (apart + a.w + b.w), larger, held);
    let along = clamp((radius - a.w) / max(apart, 1e-37), 0.0, 1.0);
    let center = select(mix(a.xyz, b.xyz, along), select(b.xyz, a.xyz, a.w >= b.w), held);
    let mean = 0.5 * (bitcast<vec3f>(nodes[child].xyz) + bitcast<vec3f>(nodes[child + 1u].xyz));
    let axis = direction_of(cones[child].xyz + cones[child + 1u].xyz);
    let one = cos_of_sum(clamp(dot(axis, cones[child].xyz), -1.0, 1.0), cones[child].w);
    let other = cos_of_sum(clamp(dot(axis, cones[child + 1u].xyz), -1.0, 1.0), cones[child + 1u].w);
    store(node, mean, child * 256u + 3u, vec4f(center, radius * (1.0 + WIDER) + PAD), vec4f(axis, widened(min(one, other))));
}

fn moves(bits: u32) -> u32 {
    let amount = bitcast<f32>(bits);
    return select(0u, u32(min(amount, 64.0) * MOVES) + 2u, bits != 0u);
}

// Adds the update at hand to what came before it.
@compute @workgroup_size(1)
fn sum_moves() {
    atomicAdd(&moved[0], moves(atomicExchange(&moved[2], 0u)));
    atomicAdd(&moved[1], moves(atomicExchange(&moved[3], 0u)));
}
