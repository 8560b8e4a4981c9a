// Program of papers/manylods/src/imperfect.rs: imperfect maps (Ritschel et al., "Imperfect Shadow Maps for Efficient
// Computation of Indirect Illumination", 2008). Random surface points are splatted into each view's map. Gaps are filled by
// pull-push: coarser levels are averaged from filled texels, and empty texels take the coarser value (Marroquim et al.,
// "Efficient Point-Based Rendering Using Image Reconstruction", 2007).

import package::shared::linear::linear_index;
import package::megaviews::shared::map_texels::{MapTexel, load_texel, put_texel, texel_place};
import package::megaviews::shared::paraboloid::paraboloid_index;

struct ImperfectStep {
    // Number of maps, of points per map, and of points to choose from.
    count: u32,
    points: u32,
    pool: u32,
    // Index of the first point among the nodes.
    first: u32,
    side: u32,
    // Length of the root's edge, metres.
    edge: f32,
    map_shift: u32,
    // Texels on a side of the written level, and of the read level: the finer one (pull) or the coarser one (push).
    to_side: u32,
    from_side: u32,
    // Offsets of both levels in `pyramid`. Level 0 is in the maps.
    to_begin: u32,
    from_begin: u32,
}

var<immediate> step: ImperfectStep;

@group(0) @binding(0) var<storage, read> nodes: array<vec4u>;
// Two vectors per view: position and half the field of view; direction.
@group(0) @binding(1) var<storage, read> views: array<vec4f>;
// Coarser levels, each of all maps: inverse ranges, 0 for none.
@group(0) @binding(2) var<storage, read_write> pyramid: array<f32>;

// Largest ratio of ranges within one surface.
const SAME: f32 = 1.25;

// PCG hash (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020).
fn hashed(seed: u32) -> u32 {
    let state = seed * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Splats random points into their maps.
@compute @workgroup_size(64)
fn splat_points(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let map = at / step.points;
    if map >= step.count {
        return;
    }
    let node = step.first + hashed(at) % step.pool;
    let d = bitcast<vec3f>(nodes[node].xyz) - views[2u * map].xyz;
    if views[2u * map].w > 1.6 || dot(d, views[2u * map + 1u].xyz) > 0.0 {
        let texel = paraboloid_index(d, step.side);
        let value = MapTexel(1.0 / max(length(d) * step.edge, 1e-37), node);
        put_texel(texel_place(map, step.map_shift, step.side, texel), value);
    }
}

fn from_level(map: u32, texel: u32) -> f32 {
    if step.from_side == step.side {
        return load_texel(texel_place(map, step.map_shift, step.side, texel)).inverse_range;
    }
    return pyramid[step.from_begin + map * 2u * step.from_side * step.from_side + texel];
}

// Pull: the mean inverse range of the nearest surface among four finer texels.
@compute @workgroup_size(64)
fn pull_up(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let side = step.to_side;
    let map = at / (2u * side * side);
    if map >= step.count {
        return;
    }
    let texel = at - map * 2u * side * side;
    let below = (texel / side) * 2u * step.from_side + (texel % side) * 2u;
    let next_row = below + step.from_side;
    let four = vec4f(from_level(map, below), from_level(map, below + 1u),
        from_level(map, next_row), from_level(map, next_row + 1u));
    let nearest = max(max(four.x, four.y), max(four.z, four.w));
    let same = select(vec4f(0.0), vec4f(1.0), (four > vec4f(0.0)) & (four * SAME >= vec4f(nearest)));
    pyramid[step.to_begin + at] = dot(four, same) / max(dot(same, vec4f(1.0)), 1.0);
}

// Push: empty texels take the coarser level's value.
@compute @workgroup_size(64)
fn push_down(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    let side = step.to_side;
    let map = at / (2u * side * side);
    if map >= step.count {
        return;
    }
    let texel = at - map * 2u * side * side;
    let above = (texel / side / 2u) * step.from_side + texel % side / 2u;
    let coarse = from_level(map, above);
    if side == step.side {
        let place = texel_place(map, step.map_shift, side, texel);
        if coarse > 0.0 && load_texel(place).inverse_range == 0.0 {
            put_texel(place, MapTexel(coarse, 0u));
        }
    } else {
        let own = pyramid[step.to_begin + at];
        pyramid[step.to_begin + at] = select(own, coarse, own == 0.0);
    }
}
