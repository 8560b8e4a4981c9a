// A packet's rays in one shape, to cull boxes with.

import package::shared::rays::{Rays, ray_through};
import package::shared::trace::trees::PlacedTree;

@group(0) @binding(0) var<uniform> rays: Rays;

// Farther than anything, and not infinite.
const NOWHERE: f32 = 3e38;
// Covers the rounding of a few operations, as a share of their largest operand.
const ROUNDING: f32 = 5e-7;

// Sub-samples of a packet, in the tile.
struct Block {
    // The first, and from it to the last.
    begin: vec2f,
    extent: vec2f,
}

// A packet's pyramid in some space, about that space's zero.
struct Pyramid {
    eye: vec3f,
    // Ray of the block's first sub-sample; to the next one in its row, in its column.
    first: vec3f,
    right: vec3f,
    down: vec3f,
    // Normals of the sides, inwards.
    sides: array<vec3f, 4>,
    // Dotted with a point about the eye: how far along the rays it is, in units of their directions.
    ahead: vec3f,
}

fn inwards(normal: vec3f, inside: vec3f) -> vec3f {
    return select(-normal, normal, dot(normal, inside) >= 0.0);
}

fn pyramid_of(eye: vec3f, first: vec3f, right: vec3f, down: vec3f, extent: vec2f) -> Pyramid {
    let last = first + right * extent.x + down * extent.y;
    let middle = (first + last) * 0.5;
    let facing = cross(right, down);
    return Pyramid(
        eye, first, right, down,
        array(
            inwards(cross(down, first), middle), inwards(cross(right, first), middle),
            inwards(cross(down, last), middle), inwards(cross(right, last), middle),
        ),
        facing / dot(facing, middle),
    );
}

// How near a box is, at least; NOWHERE if it is outside the pyramid. Boxes of points are never missed: what rounding
// may move is added.
fn nearness(pyramid: Pyramid, low: vec3f, high: vec3f) -> f32 {
    let a = low - pyramid.eye;
    let b = high - pyramid.eye;
    let center = (a + b) * 0.5;
    let half = (b - a) * 0.5 + (abs(a) + abs(b)) * ROUNDING;
    let middle = dot(pyramid.ahead, center);
    let reach = dot(abs(pyramid.ahead), half);
    var seen = middle + reach > 0.0;
    for (var i = 0; i < 4; i++) {
        let side = pyramid.sides[i];
        seen = seen && dot(side, center) + dot(abs(side), half) >= 0.0;
    }
    return select(NOWHERE, max(middle - reach, 0.0), seen);
}

// The packet's pyramid where a tree is.
fn pyramid_in_tree(tree: PlacedTree, block: Block) -> Pyramid {
    let x = tree.tree_from_eye_x;
    let y = tree.tree_from_eye_y;
    let z = tree.tree_from_eye_z;
    let first = ray_through(rays, block.begin);
    return pyramid_of(
        vec3f(x.w, y.w, z.w), vec3f(dot(x.xyz, first), dot(y.xyz, first), dot(z.xyz, first)),
        vec3f(dot(x.xyz, rays.right), dot(y.xyz, rays.right), dot(z.xyz, rays.right)),
        vec3f(dot(x.xyz, rays.down), dot(y.xyz, rays.down), dot(z.xyz, rays.down)), block.extent,
    );
}
