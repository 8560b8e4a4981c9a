// Trees of triangles as the compute tracer reads them: what `sampler/src/wide.rs` writes.

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

// Children of all trees' nodes: (min, reference), (max, kinds).
@group(0) @binding(1) var children: texture_2d<u32>;
// Triangles, leaf by leaf: (first corner, instance), (second, primitive), (third, flags).
@group(0) @binding(2) var triangles: texture_2d<u32>;
// The tree over `placed`, about the eye: its root, then children of its nodes.
@group(0) @binding(3) var<storage, read> top: array<Child>;
@group(0) @binding(4) var<storage, read> placed: array<PlacedTree>;

// A reference to what comes below a child: how many there are less one, whether they are triangles, where they begin.
const REFERENCE_COUNT_SHIFT: u32 = 29;
const REFERENCE_LEAF: u32 = 0x10000000u;
const REFERENCE_FIRST: u32 = 0x0fffffffu;

// `PlacedTree.instance` of a tree whose triangles belong to many.
const OF_TRIANGLE: u32 = 0xffffffffu;
const ONE_SIDED: u32 = 1;
const CUTOUT: u32 = 2;
const MIRRORED: u32 = 4;
const OPAQUE_KIND: u32 = 1;
const CUTOUT_KIND: u32 = 2;

// Texels of a row of `children` and `triangles`, a power of two.
const ROW_BITS: u32 = 13;

fn record_place(index: u32) -> vec2u {
    return vec2u(index & ((1u << ROW_BITS) - 1u), index >> ROW_BITS);
}

fn reference_count(reference: u32) -> u32 {
    return (reference >> REFERENCE_COUNT_SHIFT) + 1u;
}

fn ids_of(triangle: u32, tree: u32) -> vec2u {
    let instance = textureLoad(triangles, record_place(3u * triangle), 0).w;
    let primitive = textureLoad(triangles, record_place(3u * triangle + 1u), 0).w;
    let of_tree = placed[tree].instance;
    return vec2u(select(of_tree, instance, of_tree == OF_TRIANGLE) + 1u, primitive);
}
