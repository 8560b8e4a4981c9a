// Program of papers/manylods/src/spheres.rs: a perfect binary tree of bounding spheres and normal cones over surface points
// (ManyLoDs, section 4). It is built once, and refitted when triangles move.
//
// Nodes are in heap order, the root first. Coordinates are in edges of the root cube.

import package::megaviews::shared::cone::{cos_of_sum, direction_of, widened};
import package::megaviews::shared::corners::corner;
import package::manylods::shared::hilbert::hilbert_code;
import package::shared::linear::linear_index;

struct SphereStep {
    // Number of points, or of nodes of the level.
    count: u32,
    // First node of the level.
    first: u32,
}

var<immediate> step: SphereStep;

// Surface points: triangle; barycentric weights of its second and third corner (f32 bits); share of its area (f32 bits).
@group(0) @binding(1) var<storage, read> samples: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> ordered: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> keys: array<vec2u>;
@group(0) @binding(4) var<storage, read> sorted: array<vec2u>;
// Mean position (f32 bits); 256 × the first child + a bit for each child.
@group(0) @binding(5) var<storage, read_write> nodes: array<vec4u>;
// Centre and radius of each node's sphere.
@group(0) @binding(6) var<storage, read_write> spheres: array<vec4f>;
// Axis of the cone of normals, and the cosine of its half angle.
@group(0) @binding(7) var<storage, read_write> cones: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> parents: array<u32>;
// Accumulated motion and growth of the spheres since the build, in units of 1 / `MOVES` edges; then the largest motion and
// growth of the current update, f32 bits.
@group(0) @binding(9) var<storage, read_write> moved: array<atomic<u32>, 4>;

// Relative and absolute padding of a parent's radius, so that f32 tests of a parent never contradict those of its children.
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

// Writes the position of each point along a Hilbert curve, to sort by.
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

// Writes the points in sorted order.
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

// Writes a node, and records the motion and growth of its sphere.
fn store(node: u32, mean: vec3f, links: u32, sphere: vec4f, cone: vec4f) {
    let before = spheres[node];
    let shift = bitcast<u32>(distance(before.xyz, sphere.xyz));
    let growth = bitcast<u32>(abs(before.w - sphere.w));
    // Most values are below the maximum so far, and an atomic load is cheaper than an atomic maximum.
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

// Fits leaves. The squared radius of a leaf's sphere is the area that its point represents.
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

// Fits inner nodes: the smallest sphere around the children's spheres, and a cone around their cones.
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
    // One child's sphere may contain the other's.
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

// A length in edges, f32 bits, as units of motion, rounded up.
fn moves(bits: u32) -> u32 {
    let amount = bitcast<f32>(bits);
    return select(0u, u32(min(amount, 64.0) * MOVES) + 2u, bits != 0u);
}

// Adds the motion and growth of the current update to the accumulated ones.
@compute @workgroup_size(1)
fn sum_moves() {
    atomicAdd(&moved[0], moves(atomicExchange(&moved[2], 0u)));
    atomicAdd(&moved[1], moves(atomicExchange(&moved[3], 0u)));
}
