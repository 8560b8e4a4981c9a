// Program of `sampler/src/passes/trace_cutouts.rs`: traces cut-outs in front of the opaque surfaces of `trace.wgsl`.

import package::shared::trace::alpha::{Corners, corners_of, passes_alpha_test};
import package::shared::trace::follow::follow;
import package::shared::trace::found::{Found, Lane, nearer};
import package::shared::trace::packet::{is_inside, packet_at};
import package::shared::trace::pyramid::{NOWHERE, rays};
import package::shared::trace::trees::{CUTOUT_KIND, OF_TRIANGLE, ids_of, placed};
import package::shared::trace::triangle::{Leaf, at_place, from_lane, prepared_by_lane};

@group(0) @binding(5) var visibility: texture_storage_2d<rg32uint, write>;

// Inverse distance of each sub-sample's opaque surface, 0 for sky.
@group(0) @binding(6) var<storage, read> inverse_distances: array<f32>;

// Set if a packet ended early: see `Found.is_cut`.
@group(0) @binding(7) var<storage, read_write> unfinished: atomic<u32>;

// The kind of triangles that this program tests.
const KIND: u32 = CUTOUT_KIND;

// Tests the cut-outs of a leaf; packets of cut-outs have one row. Each sub-sample tests alpha of the nearest triangle,
// then of the next while it is transparent. All lanes test together, because the alpha test dominates the cost.
fn meet(lane: Lane, tree: u32, leaf: Leaf, found: ptr<function, Found>) {
    let of_tree = placed[tree].instance;
    let mine = corners_of(leaf, select(of_tree, leaf.instance, of_tree == OF_TRIANGLE));
    let seen = subgroupBallot(leaf.seen).x;
    let behind = (*found).inverse[0];
    var seen_through = NOWHERE;
    var ended = false;
    loop {
        var u = 0.0;
        var v = 0.0;
        var inverse = behind;
        var chosen = 0u;
        var left = seen;
        while left != 0u {
            let which = firstTrailingBit(left);
            left &= left - 1u;
            let f = prepared_by_lane(leaf.prepared, which);
            let at = vec4f(
                at_place(f.u, lane.at), at_place(f.v, lane.at), at_place(f.w, lane.at), at_place(f.inverse, lane.at),
            );
            let takes = nearer(at.x, at.y, at.z, at.w, inverse) && at.w < seen_through;
            u = select(u, at.x, takes);
            v = select(v, at.y, takes);
            inverse = select(inverse, at.w, takes);
            chosen = select(chosen, which, takes);
        }
        (*found).is_cut = (*found).is_cut || left != 0u;
        let corners = Corners(
            from_lane(mine.a, chosen), from_lane(mine.b, chosen), from_lane(mine.c, chosen),
            subgroupShuffle(mine.material, chosen),
        );
        let triangle = subgroupShuffle(leaf.triangle, chosen);
        let met = inverse > behind;
        let stays = met && passes_alpha_test(corners, u, v, inverse);
        (*found).inverse[0] = select((*found).inverse[0], inverse, stays);
        (*found).triangle[0] = select((*found).triangle[0], triangle, stays);
        (*found).tree[0] = select((*found).tree[0], tree, stays);
        // Sub-samples that hit a surface are done.
        seen_through = select(inverse, 0.0, stays || !met);
        if !subgroupAny(met && !stays) {
            ended = true;
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || !ended;
}

// Each lane has one row.
@compute @workgroup_size(64)
fn trace_cutouts(
    @builtin(workgroup_id) group: vec3u, @builtin(subgroup_id) subgroup: u32, @builtin(subgroup_size) size: u32,
    @builtin(subgroup_invocation_id) index: u32,
) {
    let packet = packet_at(group, subgroup, size, index, 1u);
    let inside = is_inside(packet.at);
    let cell = min(packet.at.y * rays.width + packet.at.x, arrayLength(&inverse_distances) - 1u);
    let behind = inverse_distances[cell];
    var found: Found;
    found.inverse[0] = select(NOWHERE, behind, inside);
    follow(packet.block, packet.lane, &found);
    if found.is_cut {
        atomicMax(&unfinished, 1u);
    }
    if inside && found.inverse[0] > behind {
        textureStore(visibility, packet.at, vec4u(ids_of(found.triangle[0], found.tree[0]), 0u, 0u));
    }
}
