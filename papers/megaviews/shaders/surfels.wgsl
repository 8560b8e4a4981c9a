// Program of `papers/megaviews/src/passes/surfels.rs`: makes an octree's surfels: leaves as shaded, inner nodes averaged from
// their children.

import package::shared::encode::{octahedral_from_unit, unit_from_octahedral};
import package::shared::linear::{linear_index};
import package::shared::chunk::{LeafChunk, leaf_side};
import package::megaviews::shared::surfel::{Surfel, UNSEEN, is_seen};

struct NodeLevel {
    // First node of the level, and number of nodes.
    first: u32,
    count: u32,
    // Length of the root's edge, metres.
    edge: f32,
}

var<immediate> level: NodeLevel;

@group(0) @binding(0) var<uniform> chunk: LeafChunk;
@group(0) @binding(1) var<storage, read> shaded: array<vec4f>;
// Mean position in edges of the root (f32 bits), and 256 times the first child plus a bit for each child.
@group(0) @binding(2) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> surfels: array<Surfel>;

@compute @workgroup_size(8, 8)
fn keep_leaves(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= chunk.size.x || id.y >= chunk.size.y {
        return;
    }
    let side = leaf_side(chunk, id.xy);
    let leaf = chunk.first + side / 2u;
    if leaf >= min(chunk.leaves, arrayLength(&surfels)) {
        return;
    }
    let texel = shaded[id.y * chunk.size.x + id.x];
    let radiance = select(UNSEEN, texel.rgb, texel.w > 0.0);
    if (side & 1u) == 0u {
        surfels[leaf].front = radiance;
    } else {
        surfels[leaf].back = radiance;
    }
}

fn axis_of(surfel: Surfel) -> vec3f {
    return unit_from_octahedral(unpack2x16snorm(surfel.axis));
}

fn weighed(radiance: vec3f, weight: f32) -> vec4f {
    return select(vec4f(0.0), vec4f(radiance, 1.0) * weight, is_seen(radiance));
}

fn mean_of(sum: vec4f) -> vec3f {
    return select(UNSEEN, sum.rgb / max(sum.w, 1e-30), sum.w > 0.0);
}

@compute @workgroup_size(64)
fn average_surfels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= level.count {
        return;
    }
    let node = level.first + at;
    let mean = bitcast<vec3f>(nodes[node].xyz);
    let links = nodes[node].w;
    let first = links >> 8u;
    let end = min(first + countOneBits(links & 255u), arrayLength(&surfels));
    // Sides are those of the axis of the child with the most surface, because the axes of a wall's two sides would cancel
    // out.
    var chosen = first;
    for (var child = first; child < end; child++) {
        chosen = select(chosen, child, weights[child] > weights[chosen]);
    }
    let main = axis_of(surfels[chosen]);
    var axis = vec3f(0.0);
    // Weighted radiance of visible sides, and the weight.
    var front = vec4f(0.0);
    var back = vec4f(0.0);
    var sum = 0.0;
    for (var child = first; child < end; child++) {
        let surfel = surfels[child];
        let weight = max(weights[child], 1e-30);
        let own = axis_of(surfel);
        let agrees = dot(own, main) >= 0.0;
        axis += select(-own, own, agrees) * weight;
        front += weighed(select(surfel.back, surfel.front, agrees), weight);
        back += weighed(select(surfel.front, surfel.back, agrees), weight);
        sum += weight;
    }
    // All terms are on the main axis's side, so the sum is not zero.
    axis = normalize(axis / sum);
    var offset = 0.0;
    for (var child = first; child < end; child++) {
        let there = (bitcast<vec3f>(nodes[child].xyz) - mean) * level.edge + axis_of(surfels[child]) * surfels[child].offset;
        offset += dot(axis, there) * max(weights[child], 1e-30);
    }
    surfels[node] = Surfel(mean_of(front), pack2x16snorm(octahedral_from_unit(axis)), mean_of(back), offset / sum);
}
