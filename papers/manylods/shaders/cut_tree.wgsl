// Program of papers/manylods/src/tree.rs: bounding spheres and parents of an octree's nodes.

import package::shared::linear::linear_index;

struct CellStep {
    // Number of nodes of the level, and the first of them.
    count: u32,
    first: u32,
    // Cells along an edge of the root on the level.
    cells: f32,
    // Padding of the spheres' radii. It grows towards the root, so that f32 tests of a node never contradict those of its
    // children.
    pad: f32,
}

var<immediate> step: CellStep;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(1) var<storage, read_write> spheres: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> parents: array<u32>;

const HALF_DIAGONAL: f32 = 0.8660255;

@compute @workgroup_size(64)
fn cells(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let node = step.first + at;
    let links = nodes[node].w;
    let center = (floor(bitcast<vec3f>(nodes[node].xyz) * step.cells) + 0.5) / step.cells;
    spheres[node] = vec4f(center, HALF_DIAGONAL / step.cells + step.pad);
    let first = links >> 8u;
    for (var i = 0u; i < countOneBits(links & 255u); i++) {
        parents[first + i] = node;
    }
    // The root is its own parent.
    if step.cells == 1.0 {
        parents[node] = node;
    }
}
