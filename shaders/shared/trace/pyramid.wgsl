// The pyramid around a packet's rays, which culls boxes.

import package::shared::rays::{Rays, ray_through};
import package::shared::trace::trees::PlacedTree;

@group(0) @binding(0) var<uniform> rays: Rays;

// Distance of nothing: finite, and farther than any hit.
const NOWHERE: f32 = 3e38;
// Relative rounding error of a few operations, by their largest operand.
const ROUNDING: f32 = 5e-7;

// Sub-samples of a packet, as positions in the tile.
struct Block {
    // The first sub-sample, and the offset from it to the last.
    begin: vec2f,
    extent: vec2f,
}

// A packet's pyramid, in the space of a tree or about the eye.
struct Pyramid {
    eye: vec3f,
    // Ray of the block's first sub-sample, and the steps to the next one in its row and in its column.
    first: vec3f,
    right: vec3f,
    down: vec3f,
    // Inward normals of the sides.
    sides: array<vec3f, 4>,
    // Dot product with a point relative to the eye: its distance along the rays, in units of their directions.
    ahead: vec3f,
}

// A side's normal, pointing to the side of `inside`.
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

// Lower bound of a box's distance; NOWHERE if the box is outside the pyramid. Boxes are padded by rounding errors, so that
// none is missed.
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

// The packet's pyramid in the space of a tree.
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
