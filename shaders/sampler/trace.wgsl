// Program of `sampler/src/passes/trace.rs`: which triangle of which instance each sub-sample sees, by rays through
// a hierarchy instead of a rasteriser.
//
// A packet is a block of sub-samples that a subgroup follows together. Its lanes take turns at being different
// things: the children of a node (each lane tests one box against the packet's pyramid), the triangles of a leaf
// (each lane prepares one), and columns of sub-samples (each lane tests its own against the triangles that are
// left). All rays of a tile start at the eye, so a triangle's edge functions are linear across the image (Olano,
// Greer: "Triangle Scan Conversion using 2D Homogeneous Coordinates", 1997): prepared once, a ray costs additions.

import package::shared::geometry::{attributes, color_of, indices, instances, materials, meshes, uv_of};
import package::shared::rays::{Rays, ray_through};
import package::shared::texture::{sample_alpha, slots};

// What is found first in a wide tree: a node's children lie side by side.
struct Child {
    min: vec3f,
    // What it is, see `Reference`.
    reference: u32,
    max: vec3f,
    // Whether opaque triangles are in it (1), and such with an alpha test (2).
    kinds: u32,
}

// A tree of triangles that is placed in the world, as one eye sees it.
struct PlacedTree {
    // Rows of the transform from world axes about the eye to the tree's space.
    tree_from_eye_x: vec4f,
    tree_from_eye_y: vec4f,
    tree_from_eye_z: vec4f,
    // Reference to its root.
    root: u32,
    // OF_TRIANGLE where each triangle says it.
    instance: u32,
}

@group(0) @binding(0) var<uniform> rays: Rays;
// Children of all trees' nodes: (min, reference), (max, kinds).
@group(0) @binding(1) var children: texture_2d<u32>;
// Triangles, leaf by leaf: (first corner, instance), (second, primitive), (third, flags).
@group(0) @binding(2) var triangles: texture_2d<u32>;
// The tree over `placed`, about the eye: its root, then children of its nodes.
@group(0) @binding(3) var<storage, read> top: array<Child>;
@group(0) @binding(4) var<storage, read> placed: array<PlacedTree>;
@group(0) @binding(5) var visibility: texture_storage_2d<rg32uint, write>;

// Distances of what is not opaque have yet to be compared with these: one to a sub-sample, inverse, 0 for the sky.
@group(0) @binding(6) var<storage, read_write> inverse_distances: array<f32>;

// Set where a packet was not followed to its end: see `Found.is_cut`.
@group(0) @binding(7) var<storage, read_write> unfinished: atomic<u32>;

// Rows of sub-samples that a lane follows: 1, 2, 4 or 8. A large packet shares more of the way down, a small one meets
// fewer triangles that are none of its own.
override rows: u32 = 8;
// Inverse distance of the near plane, in units of the rays' directions: the rasteriser shows nothing before it.
override nearest_inverse: f32 = 1e30;
// Whether cut-outs are traced after what is opaque, and need its distances.
override has_cutouts: bool = true;

// A reference to what comes below a child: how many there are less one, whether they are triangles, where they begin.
const REFERENCE_COUNT_SHIFT: u32 = 29;
const REFERENCE_LEAF: u32 = 0x10000000u;
const REFERENCE_FIRST: u32 = 0x0fffffffu;
// No reference to a leaf: what a search for one answers where there is none, and where it did not come to its end.
const NO_LEAF: u32 = 0;
const CUT: u32 = 1;

// `PlacedTree.instance` of a tree whose triangles belong to many.
const OF_TRIANGLE: u32 = 0xffffffffu;
const ONE_SIDED: u32 = 1;
const CUTOUT: u32 = 2;
const MIRRORED: u32 = 4;
const OPAQUE_KIND: u32 = 1;
const CUTOUT_KIND: u32 = 2;

// Texels of a row of `children` and `triangles`, a power of two.
const ROW_BITS: u32 = 13;
// Deepest level of a tree; the host builds no deeper one.
const MOST_LEVELS: u32 = 24;
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

// Children that wait at some node, one to a lane: how near, and what.
struct Waiting {
    near: f32,
    reference: u32,
}

// One level of the way down, each: children that were left waiting there.
struct Stack {
    near: array<f32, MOST_LEVELS>,
    reference: array<u32, MOST_LEVELS>,
    height: u32,
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

// A lane of a packet.
struct Lane {
    index: u32,
    // Its first sub-sample in the block, and rows from one of its sub-samples to the next.
    at: vec2f,
    step: f32,
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

fn record_place(index: u32) -> vec2u {
    return vec2u(index & ((1u << ROW_BITS) - 1u), index >> ROW_BITS);
}

fn reference_count(reference: u32) -> u32 {
    return (reference >> REFERENCE_COUNT_SHIFT) + 1u;
}

// The children of a node, those that a packet may see.
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

// Down to the next leaf, nearest first; NO_LEAF if there is none before `limit`, CUT if a loop was ended. A level is left on the stack only while
// children wait there, so the stack is never higher than the tree has levels.
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
    pyramid: Pyramid, block: Block, lane: Lane, reference: u32, kind: u32, longest: f32, horizon: f32,
) -> Leaf {
    let count = reference_count(reference);
    let triangle = min(lane.index, count - 1u) + (reference & REFERENCE_FIRST);
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
    let seen = lane.index < count && is_cutout == (kind == CUTOUT_KIND)
        && !(from_behind && (t2.w & ONE_SIDED) != 0u)
        && most(prepared.inverse, block.extent) > horizon
        && most(prepared.u, block.extent) >= 0.0
        && most(prepared.v, block.extent) >= 0.0
        && most(prepared.w, block.extent) >= 0.0;
    return Leaf(prepared, triangle, t0.w, t1.w, t2.w, seen);
}

// Whether a sub-sample sees a triangle before what it sees so far.
fn nearer(u: f32, v: f32, w: f32, inverse: f32, best: f32) -> bool {
    return min(u, min(v, w)) >= 0.0 && inverse > best && inverse <= nearest_inverse;
}

fn take_row(row: u32, f: Prepared, lane: Lane, triangle: u32, tree: u32, found: ptr<function, Found>) {
    let place = vec2f(lane.at.x, lane.at.y + f32(row) * lane.step);
    let inverse = at_place(f.inverse, place);
    let takes = nearer(at_place(f.u, place), at_place(f.v, place), at_place(f.w, place), inverse, (*found).inverse[row]);
    (*found).inverse[row] = select((*found).inverse[row], inverse, takes);
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

// Tests the triangles of a leaf that are opaque. Rows are written out, since passes of loops are limited.
fn meet_opaque(lane: Lane, tree: u32, leaf: Leaf, found: ptr<function, Found>) {
    var left = subgroupBallot(leaf.seen).x;
    while left != 0u {
        let which = firstTrailingBit(left);
        left &= left - 1u;
        let f = prepared_by_lane(leaf.prepared, which);
        let triangle = subgroupShuffle(leaf.triangle, which);
        take_row(0u, f, lane, triangle, tree, found);
        if rows > 1u {
            take_row(1u, f, lane, triangle, tree, found);
        }
        if rows > 2u {
            take_row(2u, f, lane, triangle, tree, found);
            take_row(3u, f, lane, triangle, tree, found);
        }
        if rows > 4u {
            take_row(4u, f, lane, triangle, tree, found);
            take_row(5u, f, lane, triangle, tree, found);
            take_row(6u, f, lane, triangle, tree, found);
            take_row(7u, f, lane, triangle, tree, found);
        }
    }
    (*found).is_cut = (*found).is_cut || left != 0u;
}

// What an alpha test reads at a triangle's corners.
struct Corners {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    material: u32,
}

// Texture coordinates and the vertex colour's alpha.
fn corner_at(record: u32, has: vec4u) -> vec3f {
    let held = attributes[record];
    return vec3f(select(vec2f(0.0), uv_of(held), has.x != 0u), select(1.0, color_of(held).a, has.y != 0u));
}

fn corners_of(leaf: Leaf, instance: u32) -> Corners {
    let mesh = meshes[instances[instance].mesh];
    let first = mesh.first.x + 3u * leaf.primitive;
    let exchanged = (leaf.flags & MIRRORED) != 0u;
    let a = corner_at(mesh.first.z + indices[first] * mesh.first.w, mesh.has);
    let b = corner_at(mesh.first.z + indices[first + select(1u, 2u, exchanged)] * mesh.first.w, mesh.has);
    let c = corner_at(mesh.first.z + indices[first + select(2u, 1u, exchanged)] * mesh.first.w, mesh.has);
    return Corners(a, b, c, mesh.has.w);
}

// The rasteriser's rule: `identify_cutout` of `visibility.wgsl`.
fn passes_alpha_test(corners: Corners, u: f32, v: f32, inverse: f32) -> bool {
    let weights = saturate(vec2f(u, v) / inverse);
    let at = corners.a * (1.0 - weights.x - weights.y) + corners.b * weights.x + corners.c * weights.y;
    let material = materials[corners.material];
    var alpha = material.base_color.a * at.z;
    if material.traits.y != 0u {
        alpha *= sample_alpha(slots[material.traits.y - 1u], at.xy);
    }
    return alpha >= material.factors.w;
}

// Tests the triangles of a leaf that are cut-outs; packets of cut-outs have one row. Each sub-sample tests the alpha
// of the nearest, and of the next as long as it sees through: the lanes at once, since the test is what costs.
fn meet_cutouts(lane: Lane, tree: u32, leaf: Leaf, found: ptr<function, Found>) {
    let of_tree = placed[tree].instance;
    let mine = corners_of(leaf, select(of_tree, leaf.instance, of_tree == OF_TRIANGLE));
    let seen = subgroupBallot(leaf.seen).x;
    let behind = (*found).inverse[0];
    var seen_through = NOWHERE;
    var ended = false;
    loop {
        var u = 0.0;
        var v = 0.0;
        var inverse = behind;
        var chosen = 0u;
        var left = seen;
        while left != 0u {
            let which = firstTrailingBit(left);
            left &= left - 1u;
            let f = prepared_by_lane(leaf.prepared, which);
            let at = vec4f(
                at_place(f.u, lane.at), at_place(f.v, lane.at), at_place(f.w, lane.at), at_place(f.inverse, lane.at),
            );
            let takes = nearer(at.x, at.y, at.z, at.w, inverse) && at.w < seen_through;
            u = select(u, at.x, takes);
            v = select(v, at.y, takes);
            inverse = select(inverse, at.w, takes);
            chosen = select(chosen, which, takes);
        }
        (*found).is_cut = (*found).is_cut || left != 0u;
        let corners = Corners(
            from_lane(mine.a, chosen), from_lane(mine.b, chosen), from_lane(mine.c, chosen),
            subgroupShuffle(mine.material, chosen),
        );
        let triangle = subgroupShuffle(leaf.triangle, chosen);
        let met = inverse > behind;
        let stays = met && passes_alpha_test(corners, u, v, inverse);
        (*found).inverse[0] = select((*found).inverse[0], inverse, stays);
        (*found).triangle[0] = select((*found).triangle[0], triangle, stays);
        (*found).tree[0] = select((*found).tree[0], tree, stays);
        // Those that met a surface are done.
        seen_through = select(inverse, 0.0, stays || !met);
        if !subgroupAny(met && !stays) {
            ended = true;
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || !ended;
}

// A packet at the root of a tree.
struct Walk {
    pyramid: Pyramid,
    waiting: Waiting,
    // Bounds the parts of the rays' directions.
    longest: f32,
}

fn walk_from(pyramid: Pyramid, block: Block, lane: Lane, root: u32, wanted: bool) -> Walk {
    let corner = abs(pyramid.first) + abs(pyramid.right) * block.extent.x + abs(pyramid.down) * block.extent.y;
    let waits = wanted && lane.index == 0u;
    return Walk(pyramid, Waiting(select(NOWHERE, 0.0, waits), root), max(corner.x, max(corner.y, corner.z)));
}

fn walk_of_tree(block: Block, lane: Lane, tree: u32) -> Walk {
    return walk_from(pyramid_in_tree(placed[tree], block), block, lane, placed[tree].root, true);
}

// The tree over all that is placed, about the eye.
fn walk_of_top(block: Block, lane: Lane, kind: u32) -> Walk {
    let pyramid = pyramid_of(vec3f(0.0), ray_through(rays, block.begin), rays.right, rays.down, block.extent);
    return walk_from(pyramid, block, lane, top[0].reference, (top[0].kinds & kind) != 0u);
}

// The software driver executes a loop's body once whether or not it is wanted, and once more where the loop ends at
// its head: what a packet does for a leaf therefore comes first, and asks whether there is one.
fn follow_opaque_tree(block: Block, lane: Lane, tree: u32, found: ptr<function, Found>) {
    let walk = walk_of_tree(block, lane, tree);
    var stack: Stack;
    var waiting = walk.waiting;
    var horizon = farthest(found);
    var reference = next_leaf(walk.pyramid, OPAQUE_KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            let leaf = leaf_of(walk.pyramid, block, lane, reference, OPAQUE_KIND, walk.longest, horizon);
            meet_opaque(lane, tree, leaf, found);
        }
        horizon = farthest(found);
        reference = next_leaf(walk.pyramid, OPAQUE_KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}

fn follow_cutout_tree(block: Block, lane: Lane, tree: u32, found: ptr<function, Found>) {
    let walk = walk_of_tree(block, lane, tree);
    var stack: Stack;
    var waiting = walk.waiting;
    var horizon = farthest(found);
    var reference = next_leaf(walk.pyramid, CUTOUT_KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            let leaf = leaf_of(walk.pyramid, block, lane, reference, CUTOUT_KIND, walk.longest, horizon);
            meet_cutouts(lane, tree, leaf, found);
        }
        horizon = farthest(found);
        reference = next_leaf(walk.pyramid, CUTOUT_KIND, lane.index, limit_of(horizon), false, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}

// Through all trees that a packet may see, nearest first.
fn follow_opaque(block: Block, lane: Lane, found: ptr<function, Found>) {
    let walk = walk_of_top(block, lane, OPAQUE_KIND);
    var stack: Stack;
    var waiting = walk.waiting;
    var limit = limit_of(farthest(found));
    var reference = next_leaf(walk.pyramid, OPAQUE_KIND, lane.index, limit, true, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            follow_opaque_tree(block, lane, reference & REFERENCE_FIRST, found);
        }
        limit = limit_of(farthest(found));
        reference = next_leaf(walk.pyramid, OPAQUE_KIND, lane.index, limit, true, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}

fn follow_cutouts(block: Block, lane: Lane, found: ptr<function, Found>) {
    let walk = walk_of_top(block, lane, CUTOUT_KIND);
    var stack: Stack;
    var waiting = walk.waiting;
    var limit = limit_of(farthest(found));
    var reference = next_leaf(walk.pyramid, CUTOUT_KIND, lane.index, limit, true, &stack, &waiting);
    loop {
        if (reference & REFERENCE_LEAF) != 0u {
            follow_cutout_tree(block, lane, reference & REFERENCE_FIRST, found);
        }
        limit = limit_of(farthest(found));
        reference = next_leaf(walk.pyramid, CUTOUT_KIND, lane.index, limit, true, &stack, &waiting);
        if (reference & REFERENCE_LEAF) == 0u {
            break;
        }
    }
    (*found).is_cut = (*found).is_cut || reference != NO_LEAF;
}

// A packet's place. Packets of a workgroup lie below one another, in 8 columns and 8 times `rows_of_lane` rows
// whatever the subgroup's size.
struct Packet {
    block: Block,
    lane: Lane,
    // The lane's first sub-sample in the tile, and rows to its next.
    at: vec2u,
    step: u32,
}

fn packet_at(group: vec3u, subgroup: u32, size: u32, index: u32, rows_of_lane: u32) -> Packet {
    let tall = min(size, 64u) / 8u;
    let begin = vec2u(group.x * 8u, (group.y * 8u + subgroup * tall) * rows_of_lane);
    let place = vec2u(index % 8u, index / 8u);
    return Packet(
        Block(vec2f(begin) + 0.5, vec2f(7.0, f32(tall * rows_of_lane) - 1.0)),
        Lane(index, vec2f(place), f32(tall)), begin + place, tall,
    );
}

fn is_inside(at: vec2u) -> bool {
    return at.x < rays.width && at.y < rays.height;
}

fn ids_of(triangle: u32, tree: u32) -> vec2u {
    let instance = textureLoad(triangles, record_place(3u * triangle), 0).w;
    let primitive = textureLoad(triangles, record_place(3u * triangle + 1u), 0).w;
    let of_tree = placed[tree].instance;
    return vec2u(select(of_tree, instance, of_tree == OF_TRIANGLE) + 1u, primitive);
}

fn begin_row(row: u32, packet: Packet, found: ptr<function, Found>) {
    (*found).inverse[row] = select(NOWHERE, 0.0, is_inside(packet.at + vec2u(0u, row * packet.step)));
}

fn write_row(row: u32, packet: Packet, found: ptr<function, Found>) {
    let at = packet.at + vec2u(0u, row * packet.step);
    if is_inside(at) {
        let inverse = (*found).inverse[row];
        let ids = select(vec2u(0u), ids_of((*found).triangle[row], (*found).tree[row]), inverse > 0.0);
        textureStore(visibility, at, vec4u(ids, 0u, 0u));
        if has_cutouts {
            inverse_distances[at.y * rays.width + at.x] = inverse;
        }
    }
}

// Everything that is opaque.
@compute @workgroup_size(64)
fn trace_opaque(
    @builtin(workgroup_id) group: vec3u, @builtin(subgroup_id) subgroup: u32, @builtin(subgroup_size) size: u32,
    @builtin(subgroup_invocation_id) index: u32,
) {
    let packet = packet_at(group, subgroup, size, index, rows);
    var found: Found;
    begin_row(0u, packet, &found);
    begin_row(1u, packet, &found);
    begin_row(2u, packet, &found);
    begin_row(3u, packet, &found);
    begin_row(4u, packet, &found);
    begin_row(5u, packet, &found);
    begin_row(6u, packet, &found);
    begin_row(7u, packet, &found);
    follow_opaque(packet.block, packet.lane, &found);
    if found.is_cut {
        atomicMax(&unfinished, 1u);
    }
    write_row(0u, packet, &found);
    if rows > 1u {
        write_row(1u, packet, &found);
    }
    if rows > 2u {
        write_row(2u, packet, &found);
        write_row(3u, packet, &found);
    }
    if rows > 4u {
        write_row(4u, packet, &found);
        write_row(5u, packet, &found);
        write_row(6u, packet, &found);
        write_row(7u, packet, &found);
    }
}

// Cut-outs before what is opaque, which was traced; `rows` is 1.
@compute @workgroup_size(64)
fn trace_cutouts(
    @builtin(workgroup_id) group: vec3u, @builtin(subgroup_id) subgroup: u32, @builtin(subgroup_size) size: u32,
    @builtin(subgroup_invocation_id) index: u32,
) {
    let packet = packet_at(group, subgroup, size, index, 1u);
    let inside = is_inside(packet.at);
    let cell = min(packet.at.y * rays.width + packet.at.x, arrayLength(&inverse_distances) - 1u);
    let behind = inverse_distances[cell];
    var found: Found;
    found.inverse[0] = select(NOWHERE, behind, inside);
    follow_cutouts(packet.block, packet.lane, &found);
    if found.is_cut {
        atomicMax(&unfinished, 1u);
    }
    if inside && found.inverse[0] > behind {
        textureStore(visibility, packet.at, vec4u(ids_of(found.triangle[0], found.tree[0]), 0u, 0u));
    }
}
