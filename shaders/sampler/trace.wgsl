// Program of `sampler/src/passes/trace.rs`: fills the visibility buffer by tracing opaque triangles. Cut-outs are traced
// afterwards (`trace_cutouts.wgsl`).
//
// A packet is a block of sub-samples that a subgroup traces together. A lane is in turn a child of a node (it tests a box
// against the packet's pyramid), a triangle of a leaf (it prepares the triangle), and a column of sub-samples (it tests
// them against the remaining triangles).

import package::shared::trace::follow::follow;
import package::shared::trace::found::{Found, Lane, rows, take_row};
import package::shared::trace::packet::{Packet, is_inside, packet_at};
import package::shared::trace::pyramid::{NOWHERE, rays};
import package::shared::trace::trees::{OPAQUE_KIND, ids_of};
import package::shared::trace::triangle::{Leaf, prepared_by_lane};

@group(0) @binding(5) var visibility: texture_storage_2d<rg32uint, write>;

// Inverse distance of each sub-sample's opaque surface, 0 for sky. Cut-outs are compared with it.
@group(0) @binding(6) var<storage, read_write> inverse_distances: array<f32>;

// Set if a packet ended early: see `Found.is_cut`.
@group(0) @binding(7) var<storage, read_write> unfinished: atomic<u32>;

// The kind of triangles that this program tests.
const KIND: u32 = OPAQUE_KIND;

// Whether cut-outs are traced afterwards and need the distances.
override has_cutouts: bool = true;

// Tests the opaque triangles of a leaf. Rows are unrolled. Quirk: loop-limit.
fn meet(lane: Lane, tree: u32, leaf: Leaf, found: ptr<function, Found>) {
    var left = subgroupBallot(leaf.seen).x;
    while left != 0u {
        let which = firstTrailingBit(left);
        left &= left - 1u;
        let f = prepared_by_lane(leaf.prepared, which);
        let triangle = subgroupShuffle(leaf.triangle, which);
        take_row(0u, f, lane, triangle, tree, found);
        if rows > 1u {
            take_row(1u, f, lane, triangle, tree, found);
        }
        if rows > 2u {
            take_row(2u, f, lane, triangle, tree, found);
            take_row(3u, f, lane, triangle, tree, found);
        }
        if rows > 4u {
            take_row(4u, f, lane, triangle, tree, found);
            take_row(5u, f, lane, triangle, tree, found);
            take_row(6u, f, lane, triangle, tree, found);
            take_row(7u, f, lane, triangle, tree, found);
        }
    }
    (*found).is_cut = (*found).is_cut || left != 0u;
}

fn begin_row(row: u32, packet: Packet, found: ptr<function, Found>) {
    (*found).inverse[row] = select(NOWHERE, 0.0, is_inside(packet.at + vec2u(0u, row * packet.step)));
}

fn write_row(row: u32, packet: Packet, found: ptr<function, Found>) {
    let at = packet.at + vec2u(0u, row * packet.step);
    if is_inside(at) {
        let inverse = (*found).inverse[row];
        let ids = select(vec2u(0u), ids_of((*found).triangle[row], (*found).tree[row]), inverse > 0.0);
        textureStore(visibility, at, vec4u(ids, 0u, 0u));
        if has_cutouts {
            inverse_distances[at.y * rays.width + at.x] = inverse;
        }
    }
}

// Traces opaque triangles.
@compute @workgroup_size(64)
fn trace_opaque(
    @builtin(workgroup_id) group: vec3u, @builtin(subgroup_id) subgroup: u32, @builtin(subgroup_size) size: u32,
    @builtin(subgroup_invocation_id) index: u32,
) {
    let packet = packet_at(group, subgroup, size, index, rows);
    var found: Found;
    begin_row(0u, packet, &found);
    begin_row(1u, packet, &found);
    begin_row(2u, packet, &found);
    begin_row(3u, packet, &found);
    begin_row(4u, packet, &found);
    begin_row(5u, packet, &found);
    begin_row(6u, packet, &found);
    begin_row(7u, packet, &found);
    follow(packet.block, packet.lane, &found);
    if found.is_cut {
        atomicMax(&unfinished, 1u);
    }
    write_row(0u, packet, &found);
    if rows > 1u {
        write_row(1u, packet, &found);
    }
    if rows > 2u {
        write_row(2u, packet, &found);
        write_row(3u, packet, &found);
    }
    if rows > 4u {
        write_row(4u, packet, &found);
        write_row(5u, packet, &found);
        write_row(6u, packet, &found);
        write_row(7u, packet, &found);
    }
}
