// The way down a tree, nearest first, that all lanes of a packet go together.

import package::shared::rays::ray_through;
import package::shared::trace::pyramid::{Block, NOWHERE, Pyramid, nearness, pyramid_in_tree, pyramid_of, rays};
import package::shared::trace::trees::{
    Child, REFERENCE_FIRST, REFERENCE_LEAF, children, placed, record_place, reference_count, top,
};

// Deepest level of a tree; the host builds no deeper one.
const MOST_LEVELS: u32 = 24;

// No reference to a leaf: what a search for one answers where there is none, and where it did not come to its end.
const NO_LEAF: u32 = 0;
const CUT: u32 = 1;

// Children that wait at some node, one to a lane: how near, and what.
struct Waiting {
    near: f32,
    reference: u32,
}

// One level of the way down, each: children that were left waiting there.
struct Stack {
    near: array<f32, MOST_LEVELS>,
    reference: array<u32, MOST_LEVELS>,
    height: u32,
}

// The children of a node, those that a packet may see.
fn open(pyramid: Pyramid, reference: u32, kind: u32, lane: u32, of_top: bool) -> Waiting {
    let mine = min(lane, reference_count(reference) - 1u) + (reference & REFERENCE_FIRST);
    var child: Child;
    if of_top {
        child = top[mine];
    } else {
        let low = textureLoad(children, record_place(2u * mine), 0);
        let high = textureLoad(children, record_place(2u * mine + 1u), 0);
        child = Child(bitcast<vec3f>(low.xyz), low.w, bitcast<vec3f>(high.xyz), high.w);
    }
    let wanted = lane < reference_count(reference) && (child.kinds & kind) != 0u;
    return Waiting(select(NOWHERE, nearness(pyramid, child.min, child.max), wanted), child.reference);
}

// Down to the next leaf, nearest first; NO_LEAF if there is none before `limit`, CUT if a loop was ended. A level is
// left on the stack only while children wait there, so the stack is never higher than the tree has levels.
fn next_leaf(
    pyramid: Pyramid, kind: u32, lane: u32, limit: f32, of_top: bool, stack: ptr<function, Stack>,
    waiting: ptr<function, Waiting>,
) -> u32 {
    var leaf = CUT;
    loop {
        var nearest = subgroupMin((*waiting).near);
        while !(nearest < limit) && (*stack).height > 0u {
            (*stack).height -= 1u;
            *waiting = Waiting((*stack).near[(*stack).height], (*stack).reference[(*stack).height]);
            nearest = subgroupMin((*waiting).near);
        }
        if !(nearest < limit) {
            leaf = select(NO_LEAF, CUT, (*stack).height > 0u);
            break;
        }
        let which = firstTrailingBit(subgroupBallot((*waiting).near == nearest).x);
        let reference = subgroupShuffle((*waiting).reference, which);
        (*waiting).near = select((*waiting).near, NOWHERE, lane == which);
        if (reference & REFERENCE_LEAF) != 0u {
            leaf = reference;
            break;
        }
        (*stack).near[(*stack).height] = (*waiting).near;
        (*stack).reference[(*stack).height] = (*waiting).reference;
        let more = subgroupMin((*waiting).near) < limit;
        (*stack).height = min((*stack).height + u32(more), MOST_LEVELS - 1u);
        *waiting = open(pyramid, reference, kind, lane, of_top);
    }
    return leaf;
}

// A packet at the root of a tree.
struct Walk {
    pyramid: Pyramid,
    waiting: Waiting,
    // Bounds the parts of the rays' directions.
    longest: f32,
}

fn walk_from(pyramid: Pyramid, block: Block, lane: u32, root: u32, wanted: bool) -> Walk {
    let corner = abs(pyramid.first) + abs(pyramid.right) * block.extent.x + abs(pyramid.down) * block.extent.y;
    let waits = wanted && lane == 0u;
    return Walk(pyramid, Waiting(select(NOWHERE, 0.0, waits), root), max(corner.x, max(corner.y, corner.z)));
}

fn walk_of_tree(block: Block, lane: u32, tree: u32) -> Walk {
    return walk_from(pyramid_in_tree(placed[tree], block), block, lane, placed[tree].root, true);
}

// The tree over all that is placed, about the eye.
fn walk_of_top(block: Block, lane: u32, kind: u32) -> Walk {
    let pyramid = pyramid_of(vec3f(0.0), ray_through(rays, block.begin), rays.right, rays.down, block.extent);
    return walk_from(pyramid, block, lane, top[0].reference, (top[0].kinds & kind) != 0u);
}
