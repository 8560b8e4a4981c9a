// Traversal of all placed trees by a packet. The importing program defines which triangles it looks for (KIND), and how a
// packet intersects the triangles of a leaf (meet).
//
// Each body of a loop starts with the leaf, and checks that there is one. Quirk: loop-body-once.

import package::program::{KIND, meet};
import package::shared::trace::found::{Found, Lane, farthest, limit_of};
import package::shared::trace::pyramid::Block;
import package::shared::trace::trees::{REFERENCE_FIRST, REFERENCE_LEAF};
import package::shared::trace::triangle::leaf_of;
import package::shared::trace::walk::{NO_LEAF, Stack, next_leaf, walk_of_top, walk_of_tree};

// Traverses one tree.
fn follow_tree(block: Block, lane: Lane, tree: u32, found: ptr<function, Found>) {
    let walk = walk_of_tree(block, lane.index, tree);
    var stack: Stack;
    var waiting = walk.waiting;
    var horizon = farthest(found);
    var reference = next_leaf(walk.pyramid, KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            let leaf = leaf_of(walk.pyramid, block, lane.index, reference, KIND, walk.longest, horizon);
            meet(lane, tree, leaf, found);
        }
        horizon = farthest(found);
        reference = next_leaf(walk.pyramid, KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}

// Traverses all trees that the packet may see, nearest first.
fn follow(block: Block, lane: Lane, found: ptr<function, Found>) {
    let walk = walk_of_top(block, lane.index, KIND);
    var stack: Stack;
    var waiting = walk.waiting;
    var limit = limit_of(farthest(found));
    var reference = next_leaf(walk.pyramid, KIND, lane.index, limit, true, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            follow_tree(block, lane, reference & REFERENCE_FIRST, found);
        }
        limit = limit_of(farthest(found));
        reference = next_leaf(walk.pyramid, KIND, lane.index, limit, true, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}
