// Depth-first traversal of a tree, nearest child first, by all lanes of a packet together.

import package::shared::rays::ray_through;
import package::shared::trace::pyramid::{Block, NOWHERE, Pyramid, nearness, pyramid_in_tree, pyramid_of, rays};
import package::shared::trace::trees::{
    Child, REFERENCE_FIRST, REFERENCE_LEAF, children, placed, record_place, reference_count, top,
};

// Most levels of a tree. The host builds no deeper trees.
const MOST_LEVELS: u32 = 24;

// Results of `next_leaf` that are no reference: no leaf is left, or a loop was cut off.
const NO_LEAF: u32 = 0;
const CUT: u32 = 1;

// A child that waits to be visited, one per lane.
struct Waiting {
    // Lower bound of its distance; NOWHERE for none.
    near: f32,
    reference: u32,
}

// The waiting children of each ancestor of the current node.
struct Stack {
    near: array<f32, MOST_LEVELS>,
    reference: array<u32, MOST_LEVELS>,
    height: u32,
}

// The children of a node that the packet may see, one per lane.
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

// Finds the next leaf, nearest first. NO_LEAF if none is nearer than `limit`; CUT if a loop was cut off. Levels without
// waiting children are not pushed, so the stack is at most as high as the tree.
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

// Start of a traversal at the root of a tree.
struct Walk {
    pyramid: Pyramid,
    waiting: Waiting,
    // Bound of the components of the rays' directions.
    longest: f32,
}

fn walk_from(pyramid: Pyramid, block: Block, lane: u32, root: u32, wanted: bool) -> Walk {
    let corner = abs(pyramid.first) + abs(pyramid.right) * block.extent.x + abs(pyramid.down) * block.extent.y;
    let waits = wanted && lane == 0u;
    return Walk(pyramid, Waiting(select(NOWHERE, 0.0, waits), root), max(corner.x, max(corner.y, corner.z)));
}

// Start of the traversal of a placed tree.
fn walk_of_tree(block: Block, lane: u32, tree: u32) -> Walk {
    return walk_from(pyramid_in_tree(placed[tree], block), block, lane, placed[tree].root, true);
}

// Start of the traversal of the tree over all placed trees.
fn walk_of_top(block: Block, lane: u32, kind: u32) -> Walk {
    let pyramid = pyramid_of(vec3f(0.0), ray_through(rays, block.begin), rays.right, rays.down, block.extent);
    return walk_from(pyramid, block, lane, top[0].reference, (top[0].kinds & kind) != 0u);
}
