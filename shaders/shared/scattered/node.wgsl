// A ray against the eight boxes of a node.

import package::shared::scattered::ray::TreeRay;
import package::shared::scattered::trees::{NODE_VECTORS, nodes, top};

// Some children of a node, or some triangles of its leaves: the index of the first, and bits.
// Children: bits 24 to 31 are the places that wait, the nearest by the ray's direction in the highest bit; bits 0 to 7 are
// the places whose children are nodes. Triangles: bits 0 to 23.
struct Opened {
    children: vec2u,
    triangles: vec2u,
    // Index of the placed object if the record is one, else NO_OBJECT.
    object: u32,
}

const NO_OBJECT: u32 = 0xffffffffu;
// Bits of children that wait.
const WAITING: u32 = 0xff000000u;
// A group of one child that is a tree's root.
const ROOT_WAITS: u32 = 0x80000000u;

// The five vectors of a node.
struct Node {
    frame: vec4u,
    places: vec4u,
    first: vec4u,
    second: vec4u,
    third: vec4u,
}

fn node_at(index: u32, of_top: bool) -> Node {
    let at = index * NODE_VECTORS;
    if of_top {
        return Node(top[at], top[at + 1u], top[at + 2u], top[at + 3u], top[at + 4u]);
    }
    return Node(nodes[at], nodes[at + 1u], nodes[at + 2u], nodes[at + 3u], nodes[at + 4u]);
}

// The four bytes of a word.
fn bytes(word: u32) -> vec4f {
    return vec4f((vec4u(word) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u));
}

// Distances along a ray to four planes a coordinate: the step's length, and where coordinate zero is passed.
struct Planes {
    step: vec3f,
    near: vec3f,
    far: vec3f,
}

// The bits of those of four places whose boxes a ray passes before `limit`. Words: a byte a place. `near` and `far`: the
// planes through which it enters and leaves, by axis.
fn open_four(places: u32, near: vec3u, far: vec3u, planes: Planes, ascends: u32, limit: f32) -> u32 {
    let into = max(
        max(fma(bytes(near.x), vec4f(planes.step.x), vec4f(planes.near.x)),
            fma(bytes(near.y), vec4f(planes.step.y), vec4f(planes.near.y))),
        max(fma(bytes(near.z), vec4f(planes.step.z), vec4f(planes.near.z)), vec4f(0.0)),
    );
    let out_of = min(
        min(fma(bytes(far.x), vec4f(planes.step.x), vec4f(planes.far.x)),
            fma(bytes(far.y), vec4f(planes.step.y), vec4f(planes.far.y))),
        min(fma(bytes(far.z), vec4f(planes.step.z), vec4f(planes.far.z)), vec4f(limit)),
    );
    // Places of nodes have bits 3 and 4 set. Their bits are ordered by the ray's direction.
    let of_nodes = ((places & (places << 1u)) >> 4u) & 0x01010101u;
    let bit = (places ^ (ascends & (of_nodes * 255u))) & 0x1f1f1f1fu;
    let count = (places >> 5u) & 0x07070707u;
    let shifts = (vec4u(bit) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(31u);
    let bits = ((vec4u(count) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(7u)) << shifts;
    let met = select(vec4u(0u), bits, into <= out_of);
    return met.x | met.y | met.z | met.w;
}

// What a ray meets of a node before `limit`.
fn open(index: u32, of_top: bool, ray: TreeRay, limit: f32) -> Opened {
    let node = node_at(index, of_top);
    if of_top && node.frame.w == 0xffffffffu {
        return Opened(vec2u(0u), vec2u(0u), node.places.x);
    }
    let exponents = (vec3u(node.frame.w) >> vec3u(0u, 8u, 16u)) & vec3u(255u);
    let step = bitcast<vec3f>(exponents << vec3u(23u)) * ray.inverse;
    let zero = (bitcast<vec3f>(node.frame.xyz) - ray.origin) * ray.inverse;
    let wider = ray.slack * abs(ray.inverse);
    let planes = Planes(step, zero - wider, zero + wider);
    // Words of smallest and largest coordinates: of the first four places, then of the others.
    let least = array<vec3u, 2>(
        vec3u(node.first.x, node.first.z, node.second.x), vec3u(node.first.y, node.first.w, node.second.y),
    );
    let most = array<vec3u, 2>(
        vec3u(node.second.z, node.third.x, node.third.z), vec3u(node.second.w, node.third.y, node.third.w),
    );
    let ascending = (vec3u(ray.ascends) & vec3u(1u, 2u, 4u)) != vec3u(0u);
    let low = open_four(
        node.places.z, select(most[0], least[0], ascending), select(least[0], most[0], ascending), planes, ray.ascends,
        limit,
    );
    let high = open_four(
        node.places.w, select(most[1], least[1], ascending), select(least[1], most[1], ascending), planes, ray.ascends,
        limit,
    );
    let met = low | high;
    return Opened(
        vec2u(node.places.x, (met & WAITING) | (node.frame.w >> 24u)), vec2u(node.places.y, met & ~WAITING), NO_OBJECT,
    );
}
