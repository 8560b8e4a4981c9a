// The nearest hits of a lane's sub-samples.

import package::shared::trace::pyramid::NOWHERE;
import package::shared::trace::triangle::{Prepared, at_place};

// Rows of sub-samples of a lane: 1, 2, 4 or 8. Large packets share more of the traversal; small ones test fewer triangles
// that they do not hit.
override rows: u32 = 8;
// Inverse distance of the near plane, in units of the rays' directions. As with the rasteriser, nothing nearer is visible.
override nearest_inverse: f32 = 1e30;

// A lane of a packet.
struct Lane {
    index: u32,
    // Position of its first sub-sample in the block, and rows from one of its sub-samples to the next.
    at: vec2f,
    step: f32,
}

// The nearest hit of each row. Indexed only by constants, which keeps the arrays in registers.
struct Found {
    // Inverse distance in units of the ray's direction; 0 without a hit.
    inverse: array<f32, 8>,
    // Index in `triangles`.
    triangle: array<u32, 8>,
    // Index in `placed`.
    tree: array<u32, 8>,
    // A loop was cut off, so that the hits are invalid. Quirk: loop-limit.
    is_cut: bool,
}

// Whether a hit is inside the triangle, behind the near plane and nearer than `best`.
fn nearer(u: f32, v: f32, w: f32, inverse: f32, best: f32) -> bool {
    return min(u, min(v, w)) >= 0.0 && inverse > best && inverse <= nearest_inverse;
}

// Keeps the nearer of a row's hit so far and its hit of a triangle.
fn take_row(row: u32, f: Prepared, lane: Lane, triangle: u32, tree: u32, found: ptr<function, Found>) {
    let place = vec2f(lane.at.x, lane.at.y + f32(row) * lane.step);
    let inverse = at_place(f.inverse, place);
    let best = (*found).inverse[row];
    let takes = nearer(at_place(f.u, place), at_place(f.v, place), at_place(f.w, place), inverse, best);
    (*found).inverse[row] = select(best, inverse, takes);
    (*found).triangle[row] = select((*found).triangle[row], triangle, takes);
    (*found).tree[row] = select((*found).tree[row], tree, takes);
}

// Inverse distance of the farthest hit of the packet; 0 if a sub-sample has no hit.
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

// Distance beyond which the traversal need not search.
fn limit_of(horizon: f32) -> f32 {
    return select(NOWHERE, 1.0 / max(horizon, 1e-37), horizon > 1e-37);
}
