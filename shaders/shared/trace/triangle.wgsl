// Triangles of a leaf, made ready so that a ray costs additions: all rays of a tile start at the eye, so a triangle's
// edge functions are linear across the image (Olano, Greer: "Triangle Scan Conversion using 2D Homogeneous
// Coordinates", 1997).

import package::shared::trace::pyramid::{Block, Pyramid, ROUNDING};
import package::shared::trace::trees::{
    CUTOUT, CUTOUT_KIND, ONE_SIDED, REFERENCE_FIRST, record_place, reference_count, triangles,
};

// A triangle's functions of the place in the block (x, y, 1): three that are at least zero inside, and the inverse
// distance.
struct Prepared {
    u: vec3f,
    v: vec3f,
    w: vec3f,
    inverse: vec3f,
}

fn linear(pyramid: Pyramid, n: vec3f) -> vec3f {
    return vec3f(dot(n, pyramid.right), dot(n, pyramid.down), dot(n, pyramid.first));
}

fn sum_of_parts(n: vec3f) -> f32 {
    return abs(n.x) + abs(n.y) + abs(n.z);
}

// Corners about the eye; `longest` bounds the parts of the rays' directions. Edges are moved outwards by what rounding
// may move them, so that no ray slips between two triangles; the distance is not. What has no volume with the eye is
// edge-on, and not seen.
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

// The largest value in the block.
fn most(f: vec3f, extent: vec2f) -> f32 {
    return f.z + max(f.x * extent.x, 0.0) + max(f.y * extent.y, 0.0);
}

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

// A leaf's triangles, one to a lane.
struct Leaf {
    prepared: Prepared,
    // Position in `triangles`; its first texel's w, and so on.
    triangle: u32,
    instance: u32,
    primitive: u32,
    flags: u32,
    // The packet may see it.
    seen: bool,
}

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
        && most(prepared.inverse, block.extent) > horizon
        && most(prepared.u, block.extent) >= 0.0
        && most(prepared.v, block.extent) >= 0.0
        && most(prepared.w, block.extent) >= 0.0;
    return Leaf(prepared, triangle, t0.w, t1.w, t2.w, seen);
}
