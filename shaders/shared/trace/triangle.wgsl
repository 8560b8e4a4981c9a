// Setup of a leaf's triangles. All rays of a tile start at the eye, so a triangle's edge functions are linear across the
// image, and a ray costs only additions (Olano and Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates",
// 1997).

import package::shared::trace::pyramid::{Block, Pyramid, ROUNDING};
import package::shared::trace::trees::{
    CUTOUT, CUTOUT_KIND, ONE_SIDED, REFERENCE_FIRST, record_place, reference_count, triangles,
};

// Linear functions of the position in the block (x, y, 1): three edge functions, at least zero inside the triangle, and the
// inverse distance.
struct Prepared {
    u: vec3f,
    v: vec3f,
    w: vec3f,
    inverse: vec3f,
}

// The function dot(n, ray) of the position in the block.
fn linear(pyramid: Pyramid, n: vec3f) -> vec3f {
    return vec3f(dot(n, pyramid.right), dot(n, pyramid.down), dot(n, pyramid.first));
}

fn sum_of_parts(n: vec3f) -> f32 {
    return abs(n.x) + abs(n.y) + abs(n.z);
}

// Sets up a triangle: its first corner relative to the eye, and its edges. `longest` bounds the components of the rays'
// directions. Edges are moved outwards by their rounding error, so that no ray slips between two triangles. A triangle in
// a plane with the eye is not visible.
fn prepare(pyramid: Pyramid, a: vec3f, e1: vec3f, e2: vec3f, longest: f32) -> Prepared {
    let normal = cross(e1, e2);
    let volume = dot(normal, a);
    let flat = !(abs(volume) > 1e-36);
    let scale = select(1.0 / volume, 0.0, flat);
    let n = linear(pyramid, normal) * scale;
    var u = linear(pyramid, cross(e2, a)) * scale;
    var v = linear(pyramid, cross(a, e1)) * scale;
    var w = n - u - v;
    let slack = ROUNDING * longest * abs(scale) * sum_of_parts(a);
    let slack_u = slack * sum_of_parts(e2);
    let slack_v = slack * sum_of_parts(e1);
    u.z += slack_u;
    v.z += slack_v;
    w.z += slack_u + slack_v;
    return Prepared(u, v, w, n);
}

// The largest value of a function in the block.
fn largest_in_block(f: vec3f, extent: vec2f) -> f32 {
    return f.z + max(f.x * extent.x, 0.0) + max(f.y * extent.y, 0.0);
}

// The value of a function at a position in the block.
fn at_place(f: vec3f, place: vec2f) -> f32 {
    return f.z + f.x * place.x + f.y * place.y;
}

fn from_lane(f: vec3f, lane: u32) -> vec3f {
    return vec3f(subgroupShuffle(f.x, lane), subgroupShuffle(f.y, lane), subgroupShuffle(f.z, lane));
}

fn prepared_by_lane(prepared: Prepared, lane: u32) -> Prepared {
    return Prepared(
        from_lane(prepared.u, lane), from_lane(prepared.v, lane), from_lane(prepared.w, lane),
        from_lane(prepared.inverse, lane),
    );
}

// The triangle of a leaf that a lane sets up.
struct Leaf {
    prepared: Prepared,
    // Index in `triangles`.
    triangle: u32,
    // Instance, primitive and flags from its texels.
    instance: u32,
    primitive: u32,
    flags: u32,
    // Whether the packet may see it.
    seen: bool,
}

// Sets up a leaf's triangles, one per lane. Triangles of another kind or beyond `horizon` (inverse distance) are not seen.
fn leaf_of(
    pyramid: Pyramid, block: Block, lane: u32, reference: u32, kind: u32, longest: f32, horizon: f32,
) -> Leaf {
    let count = reference_count(reference);
    let triangle = min(lane, count - 1u) + (reference & REFERENCE_FIRST);
    let t0 = textureLoad(triangles, record_place(3u * triangle), 0);
    let t1 = textureLoad(triangles, record_place(3u * triangle + 1u), 0);
    let t2 = textureLoad(triangles, record_place(3u * triangle + 2u), 0);
    let corner = bitcast<vec3f>(t0.xyz);
    let a = corner - pyramid.eye;
    let e1 = bitcast<vec3f>(t1.xyz) - corner;
    let e2 = bitcast<vec3f>(t2.xyz) - corner;
    let prepared = prepare(pyramid, a, e1, e2, longest);
    let from_behind = !(dot(cross(e1, e2), a) < 0.0);
    let is_cutout = (t2.w & CUTOUT) != 0u;
    let seen = lane < count && is_cutout == (kind == CUTOUT_KIND)
        && !(from_behind && (t2.w & ONE_SIDED) != 0u)
        && largest_in_block(prepared.inverse, block.extent) > horizon
        && largest_in_block(prepared.u, block.extent) >= 0.0
        && largest_in_block(prepared.v, block.extent) >= 0.0
        && largest_in_block(prepared.w, block.extent) >= 0.0;
    return Leaf(prepared, triangle, t0.w, t1.w, t2.w, seen);
}
