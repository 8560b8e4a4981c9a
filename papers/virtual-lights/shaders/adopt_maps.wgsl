// Program of `papers/virtual-lights/src/passes/adopt_maps.rs`: assigns a map of a many-views traversal to each VPL, with the map's
// centre. Views of one leaf share a map.

struct AdoptMaps {
    // Corner of the octree's root relative to the scene's centre, metres.
    octree_from_root: vec3f,
    // Length of the root's edge, metres.
    edge: f32,
    // Number of VPLs.
    count: u32,
}

@group(0) @binding(0) var<uniform> adopt: AdoptMaps;
@group(0) @binding(1) var<storage, read> map_of_view: array<u32>;
// Positions in edges of the octree's root, f32 bits.
@group(0) @binding(2) var<storage, read> map_centers: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> eyes: array<vec4u>;

@compute @workgroup_size(64)
fn adopt_maps(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= adopt.count {
        return;
    }
    let map = map_of_view[at];
    let middle = bitcast<vec3f>(map_centers[min(map, arrayLength(&map_centers) - 1u)].xyz);
    eyes[at] = vec4u(bitcast<vec3u>(middle * adopt.edge + adopt.octree_from_root), map);
}
