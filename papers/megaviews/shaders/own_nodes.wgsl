// Program of `papers/megaviews/src/passes/own_nodes.rs`: finds octree nodes whose surfaces all belong to one reflector.

import package::shared::linear::{linear_index};

struct OwnLevel {
    // First node of the level, and number of nodes.
    first: u32,
    count: u32,
}

var<immediate> level: OwnLevel;

// Triangles that each leaf shows on its front and on its back.
@group(0) @binding(0) var<storage, read> facing: array<vec2u>;
// For each triangle of the octree its instance and its index in the mesh.
@group(0) @binding(1) var<storage, read> triangle_ids: array<vec2u>;
// For each instance 1 + the index of its probe; 0 for none.
@group(0) @binding(2) var<storage, read> probe_of_instance: array<u32>;
// w is 256 × first child + a bit for each child.
@group(0) @binding(3) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(4) var<storage, read_write> owners: array<u32>;

fn owner_of(triangle: u32) -> u32 {
    return probe_of_instance[min(triangle_ids[triangle].x, arrayLength(&probe_of_instance) - 1u)];
}

@compute @workgroup_size(64)
fn own_leaves(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let leaf = linear_index(group, groups, local);
    if leaf >= level.count {
        return;
    }
    let shown = facing[leaf];
    let owner = owner_of(shown.x);
    owners[leaf] = select(0u, owner, owner_of(shown.y) == owner);
}

@compute @workgroup_size(64)
fn own_nodes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= level.count {
        return;
    }
    let links = nodes[level.first + at].w;
    let first = links >> 8u;
    let end = min(first + countOneBits(links & 255u), arrayLength(&owners));
    var owner = owners[first];
    for (var child = first; child < end; child++) {
        owner = select(0u, owner, owners[child] == owner);
    }
    owners[level.first + at] = owner;
}
