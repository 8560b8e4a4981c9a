// Trees of triangles for the compute tracer, in the layout that `sampler/src/wide.rs` writes.

// A child of a node of a wide tree. The children of a node are adjacent.
struct Child {
    min: vec3f,
    // Its children or triangles: see REFERENCE_COUNT_SHIFT.
    reference: u32,
    max: vec3f,
    // Bits OPAQUE_KIND and CUTOUT_KIND of the triangles below it.
    kinds: u32,
}

// A tree of triangles with its transform from the eye.
struct PlacedTree {
    // Rows of the transform from world axes relative to the eye to the tree's space.
    tree_from_eye_x: vec4f,
    tree_from_eye_y: vec4f,
    tree_from_eye_z: vec4f,
    // Reference to its root.
    root: u32,
    // Index of its instance; OF_TRIANGLE if each triangle has its own.
    instance: u32,
}

// Children of all trees' nodes, two texels each: (min, reference), (max, kinds).
@group(0) @binding(1) var children: texture_2d<u32>;
// Triangles, leaf by leaf, three texels each: (first corner, instance), (second corner, primitive), (third corner, flags).
@group(0) @binding(2) var triangles: texture_2d<u32>;
// The tree over `placed`, relative to the eye: its root, then the children of its nodes.
@group(0) @binding(3) var<storage, read> top: array<Child>;
@group(0) @binding(4) var<storage, read> placed: array<PlacedTree>;

// A reference to children or triangles. From the highest bits: their number - 1 (3 bits), 1 for triangles (1 bit), index of
// the first (28 bits).
const REFERENCE_COUNT_SHIFT: u32 = 29;
const REFERENCE_LEAF: u32 = 0x10000000u;
const REFERENCE_FIRST: u32 = 0x0fffffffu;

// `PlacedTree.instance` of a tree whose triangles belong to several instances.
const OF_TRIANGLE: u32 = 0xffffffffu;
// Flags of a triangle: `flags` of `sampler/src/bvh.rs`.
const ONE_SIDED: u32 = 1;
const CUTOUT: u32 = 2;
const MIRRORED: u32 = 4;
// Kinds of triangles: opaque, and with an alpha test.
const OPAQUE_KIND: u32 = 1;
const CUTOUT_KIND: u32 = 2;

// Base-2 logarithm of the width of `children` and `triangles`, texels.
const ROW_BITS: u32 = 13;

// The texel of an index.
fn record_place(index: u32) -> vec2u {
    return vec2u(index & ((1u << ROW_BITS) - 1u), index >> ROW_BITS);
}

fn reference_count(reference: u32) -> u32 {
    return (reference >> REFERENCE_COUNT_SHIFT) + 1u;
}

// 1 + instance, and primitive, of a triangle of a placed tree.
fn ids_of(triangle: u32, tree: u32) -> vec2u {
    let instance = textureLoad(triangles, record_place(3u * triangle), 0).w;
    let primitive = textureLoad(triangles, record_place(3u * triangle + 1u), 0).w;
    let of_tree = placed[tree].instance;
    return vec2u(select(of_tree, instance, of_tree == OF_TRIANGLE) + 1u, primitive);
}
