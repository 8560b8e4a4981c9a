// Program of `papers/virtual-lights/src/passes/choose_receivers.rs`: selects the sub-samples that receive light for a block. The first
// is the one nearest to the block's centre that sees a surface. If the block sees another surface, the second is the one
// that agrees least with the first.

import package::shared::receiver::{Receiver, receiver_of};
import package::virtual_lights::shared::receivers::{Blocks, Chosen, MOST_OF_BLOCK, OF_BLOCK};

@group(0) @binding(0) var<uniform> blocks: Blocks;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> chosen: array<Chosen>;

// Distance from the first receiver's plane, as a share of its range, beyond which a point belongs to another surface.
const PLANE: f32 = 0.02;
// 1 - cosine between normals beyond which a point belongs to another surface.
const BENT: f32 = 0.3;
// Step in which disagreement is compared.
const STEP: f32 = 1.0 / 64.0;
const GROUP: u32 = 64u;

// Key of the first receiver; the least wins. Squared distance from the block's centre in half sub-samples, then the index
// in the block.
var<workgroup> nearest: atomic<u32>;
// Key of the second receiver; the greatest wins. Steps of disagreement, then 2^16 - index.
var<workgroup> farthest: atomic<u32>;

fn place_of(corner: vec2u, i: u32) -> vec2u {
    return corner + vec2u(i % blocks.block.x, i / blocks.block.x);
}

fn receiver_at(place: vec2u) -> Receiver {
    let clamped = min(place, blocks.size - 1u);
    var receiver = receiver_of(g_surfaces[clamped.y * blocks.size.x + clamped.x]);
    receiver.exists = receiver.exists & all(place < blocks.size);
    return receiver;
}

// Disagreement; 1 or more is another surface.
fn disagreement(first: Receiver, other: Receiver) -> f32 {
    let range = max(length(first.position), 1e-20);
    let off = abs(dot(first.normal, other.position - first.position)) / (PLANE * range);
    return max(off, (1.0 - dot(first.normal, other.normal)) / BENT);
}

fn keep(at: u32, receiver: Receiver, place: vec2u, exists: bool) {
    chosen[at] = Chosen(receiver.position, place.x | (place.y << 16u), receiver.normal, select(0u, 1u, exists));
}

@compute @workgroup_size(GROUP)
fn choose_receivers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let corner = group.xy * blocks.block;
    // The bound is not uniform alone: see resolve_view.wgsl.
    let all_of_block = min(min(blocks.block.x * blocks.block.y, MOST_OF_BLOCK), arrayLength(&g_surfaces) * MOST_OF_BLOCK);
    if local == 0u {
        atomicStore(&nearest, 0xffffffffu);
        atomicStore(&farthest, 0u);
    }
    workgroupBarrier();
    for (var i = local; i < all_of_block; i += GROUP) {
        let place = place_of(corner, i);
        let off = vec2i(2u * (place - corner) + 1u) - vec2i(blocks.block);
        if receiver_at(place).exists {
            atomicMin(&nearest, (u32(dot(off, off)) << 16u) | i);
        }
    }
    workgroupBarrier();
    let first_key = atomicLoad(&nearest);
    let first_place = place_of(corner, first_key & 0xffffu);
    let first = receiver_at(first_place);
    if first_key != 0xffffffffu {
        for (var i = local; i < all_of_block; i += GROUP) {
            let other = receiver_at(place_of(corner, i));
            // Nothing that is not finite is more than 1.
            let disagrees = disagreement(first, other);
            if other.exists && disagrees >= 1.0 {
                let steps = u32(min((disagrees - 1.0) / STEP, 65534.0)) + 1u;
                atomicMax(&farthest, (steps << 16u) | (0xffffu - i));
            }
        }
    }
    workgroupBarrier();
    if local == 0u {
        let second_key = atomicLoad(&farthest);
        let second_place = place_of(corner, 0xffffu - (second_key & 0xffffu));
        let at = OF_BLOCK * (group.y * blocks.count.x + group.x);
        keep(at, first, first_place, first_key != 0xffffffffu);
        keep(at + 1u, receiver_at(second_place), second_place, second_key != 0u);
    }
}
