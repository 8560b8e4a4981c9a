// Program of `papers/virtual-lights/src/passes/imperfect.rs`: imperfect shadow maps (Ritschel et al. 2008). Surface points are splatted
// into the maps of VPLs. Gaps are filled by pull-push over coarser levels (Marroquim et al., "Efficient Point-Based
// Rendering Using Image Reconstruction", 2007).

import package::megaviews::shared::paraboloid::{paraboloid_index};
import package::virtual_lights::shared::vpl::{Vpl};

struct Imperfect {
    // Texels on a side of a hemisphere's map.
    side: u32,
    // Points of a map.
    points: u32,
    // Texels on a side of the level that is written, and of the finer (pull) or coarser (push) level that is read.
    to_side: u32,
    from_side: u32,
    // Offsets of those levels in the pyramid. Level 0 is in the maps.
    to_begin: u32,
    from_begin: u32,
    // Number of maps.
    count: u32,
    seed: u32,
}

@group(0) @binding(0) var<uniform> imperfect: Imperfect;
@group(0) @binding(1) var<storage, read> vpls: array<Vpl>;
// Relative to the root.
@group(0) @binding(2) var<storage, read> surface_points: array<vec4f>;
// Distances, f32 bits.
@group(0) @binding(3) var<storage, read_write> splats: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> maps: array<u32>;
// Coarser levels, each of all maps.
@group(0) @binding(5) var<storage, read_write> pyramid: array<u32>;

// No surface: the largest f32.
const NOTHING: u32 = 0x7f7fffffu;
// Distances this many times the nearest belong to another surface.
const SAME: f32 = 1.25;

fn hash(x: u32) -> u32 {
    var h = x;
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return h ^ (h >> 16u);
}

// Linear index of an invocation of a two-dimensional dispatch.
fn invocation(id: vec3u, groups: vec3u) -> u32 {
    return id.y * groups.x * 64u + id.x;
}

@compute @workgroup_size(64)
fn reset(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = invocation(id, groups);
    if at < arrayLength(&maps) {
        maps[at] = NOTHING;
    }
}

@compute @workgroup_size(64)
fn splat(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = invocation(id, groups);
    if at / imperfect.points >= imperfect.count {
        return;
    }
    let map = at / imperfect.points;
    let vpl = vpls[map];
    let point = surface_points[hash(at ^ hash(imperfect.seed)) % arrayLength(&surface_points)].xyz;
    let d = point - vpl.position;
    if dot(d, vpl.normal) > 0.0 || all(vpl.normal == vec3f(0.0)) {
        let texel = paraboloid_index(d, imperfect.side);
        let index = map * 2u * imperfect.side * imperfect.side + texel;
        atomicMin(&splats[min(index, arrayLength(&splats) - 1u)], bitcast<u32>(length(d)));
    }
}

fn finer(index: u32) -> u32 {
    if imperfect.from_side == imperfect.side {
        return maps[index];
    }
    return pyramid[imperfect.from_begin + index];
}

// Mean distance of the nearest surface among four texels.
@compute @workgroup_size(64)
fn pull(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = invocation(id, groups);
    let side = imperfect.to_side;
    if at >= imperfect.count * 2u * side * side {
        return;
    }
    let place = vec2u(at % side, at / side % side) * 2u;
    let first = at / (side * side) * imperfect.from_side * imperfect.from_side + place.y * imperfect.from_side + place.x;
    let below = first + imperfect.from_side;
    let words = vec4u(finer(first), finer(first + 1u), finer(below), finer(below + 1u));
    let d = bitcast<vec4f>(words);
    let nearest = min(min(d.x, d.y), min(d.z, d.w));
    let same = select(vec4f(0.0), vec4f(1.0), (words != vec4u(NOTHING)) & (d <= vec4f(nearest * SAME)));
    let count = dot(same, vec4f(1.0));
    let mean = dot(select(vec4f(0.0), d, same > vec4f(0.0)), vec4f(1.0)) / max(count, 1.0);
    pyramid[imperfect.to_begin + at] = select(NOTHING, bitcast<u32>(mean), count > 0.0);
}

// An empty texel takes its parent's distance.
@compute @workgroup_size(64)
fn push(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = invocation(id, groups);
    let side = imperfect.to_side;
    if at >= imperfect.count * 2u * side * side {
        return;
    }
    let place = vec2u(at % side, at / side % side) / 2u;
    let parent = at / (side * side) * imperfect.from_side * imperfect.from_side + place.y * imperfect.from_side + place.x;
    let coarse = pyramid[imperfect.from_begin + parent];
    if side == imperfect.side {
        maps[at] = select(maps[at], coarse, maps[at] == NOTHING);
    } else {
        let own = pyramid[imperfect.to_begin + at];
        pyramid[imperfect.to_begin + at] = select(own, coarse, own == NOTHING);
    }
}
