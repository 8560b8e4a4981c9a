// What a lane's sub-samples see so far.

import package::shared::trace::pyramid::NOWHERE;
import package::shared::trace::triangle::{Prepared, at_place};

// Rows of sub-samples that a lane follows: 1, 2, 4 or 8. A large packet shares more of the way down, a small one meets
// fewer triangles that are none of its own.
override rows: u32 = 8;
// Inverse distance of the near plane, in units of the rays' directions: the rasteriser shows nothing before it.
override nearest_inverse: f32 = 1e30;

// A lane of a packet.
struct Lane {
    index: u32,
    // Its first sub-sample in the block, and rows from one of its sub-samples to the next.
    at: vec2f,
    step: f32,
}

// What a lane's sub-samples see so far, by row: inverse distance in units of the ray's direction, 0 where nothing is
// seen; position in `triangles`; position in `placed`. Never indexed by a variable, or it would lie in memory.
struct Found {
    inverse: array<f32, 8>,
    triangle: array<u32, 8>,
    tree: array<u32, 8>,
    // Whether a loop ended that had not come to its end: the software driver ends loops after 65535 passes of all
    // loops of a program. What was found is then no result.
    is_cut: bool,
}

// Whether a sub-sample sees a triangle before what it sees so far.
fn nearer(u: f32, v: f32, w: f32, inverse: f32, best: f32) -> bool {
    return min(u, min(v, w)) >= 0.0 && inverse > best && inverse <= nearest_inverse;
}

fn take_row(row: u32, f: Prepared, lane: Lane, triangle: u32, tree: u32, found: ptr<function, Found>) {
    let place = vec2f(lane.at.x, lane.at.y + f32(row) * lane.step);
    let inverse = at_place(f.inverse, place);
    let best = (*found).inverse[row];
    let takes = nearer(at_place(f.u, place), at_place(f.v, place), at_place(f.w, place), inverse, best);
    (*found).inverse[row] = select(best, inverse, takes);
    (*found).triangle[row] = select((*found).triangle[row], triangle, takes);
    (*found).tree[row] = select((*found).tree[row], tree, takes);
}

// Inverse distance of the farthest that any sub-sample of the packet sees.
fn farthest(found: ptr<function, Found>) -> f32 {
    var least = (*found).inverse[0];
    if rows > 1u {
        least = min(least, (*found).inverse[1]);
    }
    if rows > 2u {
        least = min(least, min((*found).inverse[2], (*found).inverse[3]));
    }
    if rows > 4u {
        least = min(least, min((*found).inverse[4], (*found).inverse[5]));
        least = min(least, min((*found).inverse[6], (*found).inverse[7]));
    }
    return subgroupMin(least);
}

fn limit_of(horizon: f32) -> f32 {
    return select(NOWHERE, 1.0 / max(horizon, 1e-37), horizon > 1e-37);
}
