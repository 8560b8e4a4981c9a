// Leaf sides of an octree with the light that they reflect, and which of them a ray meets: `sampler/src/light/paths/leaves.rs`.

import package::shared::encode::unit_from_octahedral;
import package::shared::scattered::hit::{FRONT, ScatteredHit};

// The grid of leaves: `sampler/src/light/paths/grid.rs`. Positions are metres about its centre.
struct LeafGrid {
    // The lowest corner of the inner cube, and the edge of its cells.
    low: vec3f,
    cell: f32,
    // The eye.
    eye: vec3f,
    // Ratio of the edges of two cells that follow one another outside of the inner cube.
    growth: f32,
    // Cells on a side of the inner cube, and before and behind it along each axis.
    inner: i32,
    outer: i32,
}

@group(2) @binding(0) var<uniform> leaf_grid: LeafGrid;
// Leaves by the Morton number of their cell, with open addressing: the number (NO_LEAF if the slot is free), the first side,
// and the number of sides.
@group(2) @binding(1) var<storage, read> leaf_table: array<vec4u>;
// Two vectors a side: its normal, and 1 if triangles show their counter-clockwise side, else 0; the radiance that it reflects.
@group(2) @binding(2) var<storage, read> leaf_sides: array<vec4f>;
// Normals of the counter-clockwise sides of all triangles, octahedral (2x16snorm); first triangle of each instance.
@group(2) @binding(3) var<storage, read> leaf_fronts: array<u32>;
@group(2) @binding(4) var<storage, read> leaf_first: array<u32>;

const NO_LEAF: u32 = 0xffffffffu;
const NO_SIDE: u32 = 0xffffffffu;
// Cosine from which a side is taken without a look at neighbouring cells.
const LIKELY: f32 = 0.5;

struct BestSide {
    side: u32,
    cosine: f32,
}

// The number of a cell along one axis, which may lie outside.
fn cell_along(at: f32, low: f32) -> i32 {
    let place = clamp((at - low) / leaf_grid.cell, -1e8, 1e8);
    let beyond = max(place - f32(leaf_grid.inner), -place);
    if beyond <= 0.0 || leaf_grid.outer == 0 {
        return i32(floor(place)) + leaf_grid.outer;
    }
    let growth = leaf_grid.growth;
    let steps = i32(floor(log(1.0 + beyond * (growth - 1.0) / growth) / log(growth)));
    return select(leaf_grid.outer + leaf_grid.inner + steps, leaf_grid.outer - 1 - steps, place < 0.0);
}

fn cell_at(position: vec3f) -> vec3i {
    return vec3i(
        cell_along(position.x, leaf_grid.low.x), cell_along(position.y, leaf_grid.low.y),
        cell_along(position.z, leaf_grid.low.z),
    );
}

// The lower edge of a cell along an axis, from the inner cube, in edges of its cells.
fn edge_of(number: i32) -> f32 {
    let growth = leaf_grid.growth;
    let beyond = max(-number, number - leaf_grid.inner);
    let sum = growth * (pow(growth, f32(max(beyond, 0))) - 1.0) / (growth - 1.0);
    return select(select(f32(number), f32(leaf_grid.inner) + sum, number > leaf_grid.inner), -sum, number < 0);
}

// Edge of a cube as large as a cell.
fn size_of(cell: vec3i) -> f32 {
    let inside = cell - leaf_grid.outer;
    if all(inside >= vec3i(0)) && all(inside < vec3i(leaf_grid.inner)) {
        return leaf_grid.cell;
    }
    let x = edge_of(inside.x + 1) - edge_of(inside.x);
    let y = edge_of(inside.y + 1) - edge_of(inside.y);
    let z = edge_of(inside.z + 1) - edge_of(inside.z);
    return pow(max(x * y * z, 0.0), 1.0 / 3.0) * leaf_grid.cell;
}

// Bit i goes to bit 3 i, for ten bits.
fn spread_bits(number: vec3u) -> vec3u {
    let a = (number | (number << vec3u(16u))) & vec3u(0x030000ffu);
    let b = (a | (a << vec3u(8u))) & vec3u(0x0300f00fu);
    let c = (b | (b << vec3u(4u))) & vec3u(0x030c30c3u);
    return (c | (c << vec3u(2u))) & vec3u(0x09249249u);
}

// The first slot at which a Morton number is looked for: `slot_of` of `sampler/src/light/paths/leaves/packed.rs`.
fn leaf_slot(key: u32) -> u32 {
    let mixed = (key ^ (key >> 15u)) * 0x9e3779b1u;
    return mixed ^ (mixed >> 16u);
}

// The first side of a cell's leaf, and the number of its sides.
fn sides_in(cell: vec3i) -> vec2u {
    let side = leaf_grid.inner + 2 * leaf_grid.outer;
    if any(cell < vec3i(0)) || any(cell >= vec3i(side)) {
        return vec2u(0u);
    }
    let bits = spread_bits(vec3u(cell));
    let key = bits.x | (bits.y << 1u) | (bits.z << 2u);
    let mask = arrayLength(&leaf_table) - 1u;
    var slot = leaf_slot(key) & mask;
    var found = leaf_table[slot];
    while found.x != key && found.x != NO_LEAF {
        // One turn too many changes nothing. Quirk: loop-body-once.
        slot = select(slot, (slot + 1u) & mask, found.x != key && found.x != NO_LEAF);
        found = leaf_table[slot];
    }
    return select(vec2u(0u), found.yz, found.x == key);
}

// The side of a cell that faces a normal best.
fn best_in(cell: vec3i, normal: vec3f, is_front: bool) -> BestSide {
    let sides = sides_in(cell);
    var best = BestSide(NO_SIDE, -2.0);
    for (var side = sides.x; side < sides.x + sides.y; side++) {
        let there = leaf_sides[2u * side];
        let cosine = dot(there.xyz, normal);
        // Quirk: loop-body-once.
        if side < sides.x + sides.y && (there.w > 0.5) == is_front && cosine >= best.cosine {
            best = BestSide(side, cosine);
        }
    }
    return best;
}

// Radiance that arrives along a ray from `start`, relative to the eye, by the leaf side that it hits.
fn radiance_along(start: vec3f, direction: vec3f, hit: ScatteredHit) -> vec3f {
    if hit.instance == 0u || hit.instance > arrayLength(&leaf_first) {
        return vec3f(0.0);
    }
    let first = leaf_first[hit.instance - 1u];
    let triangle = first + (hit.primitive & ~FRONT);
    if first == NO_LEAF || triangle >= arrayLength(&leaf_fronts) {
        return vec3f(0.0);
    }
    let front = unit_from_octahedral(unpack2x16snorm(leaf_fronts[triangle]));
    let is_front = dot(front, direction) < 0.0;
    let normal = select(-front, front, is_front);
    let position = start + leaf_grid.eye + direction * hit.t;
    let cell = cell_at(position);
    var best = best_in(cell, normal, is_front);
    let nudge = 0.4 * size_of(cell);
    // Rounding took the position to a neighbouring cell, or its surface has little area in this one.
    let corners = select(0u, 8u, best.cosine <= LIKELY);
    for (var corner = 0u; corner < min(corners, arrayLength(&leaf_table) * 4u); corner++) {
        let signs = vec3f((vec3u(corner) >> vec3u(0u, 1u, 2u)) & vec3u(1u)) * 2.0 - 1.0;
        let there = best_in(cell_at(position + signs * nudge), normal, is_front);
        if corner < corners && there.cosine > best.cosine {
            best = there;
        }
    }
    if best.side == NO_SIDE || best.cosine <= 0.0 {
        return vec3f(0.0);
    }
    return leaf_sides[2u * best.side + 1u].xyz;
}
