// Trees of triangles for scattered rays, in the layout that `sampler/src/light_rays/device` writes.

// A node is five vectors, 80 bytes (after Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs", 2017):
// 0: f32 bits of the smallest coordinates of the node's box; then four bytes: for each axis the biased exponent of the
//    step of its coordinates, and a bit for each place whose child is a node. All ones: the record is a placed object.
// 1: index of the first child that is a node; index of the first triangle; eight bytes, one a place.
// 2 to 4: for each axis eight bytes with the smallest coordinates of the places' boxes, then likewise the largest, in
//    steps from the node's box.
// A place's byte is 0 if it is empty, 0x38 + its number if its child is a node, and else the first of its triangles among
// the node's (bits 0 to 4) and one to three bits for their number (bits 5 to 7).
const NODE_VECTORS: u32 = 5;
@group(1) @binding(0) var<storage, read> nodes: array<vec4u>;

// The tree over placed objects, relative to the eye. Its leaves are records of placed objects, whose index is the first
// word of the second vector.
@group(1) @binding(1) var<storage, read> top: array<vec4u>;
const OF_PLACED: u32 = 0xffffffffu;

// Triangles, leaf by leaf, three vectors each: (first corner, instance), (second corner, primitive), (third corner, flags
// and 32 · the first of its records in `mask_triangles`).
@group(1) @binding(2) var<storage, read> triangles: array<vec4u>;

// A placed object, with the transform from the eye to its tree's space.
struct TracedObject {
    // Rows of the transform of directions; the eye in the tree's space, rounded.
    tree_from_eye_x: vec4f,
    tree_from_eye_y: vec4f,
    tree_from_eye_z: vec4f,
    // What rounding took from the eye.
    eye_rest: vec3f,
    // Index of its tree's root.
    root: u32,
    // Box around its triangles.
    min: vec3f,
    // Index of its instance; OF_TRIANGLE if each triangle has its own.
    instance: u32,
    max: vec3f,
    // 1 if it is not turned or scaled.
    is_shifted: u32,
}

@group(1) @binding(3) var<storage, read> placed: array<TracedObject>;

// `TracedObject.instance` of a tree whose triangles belong to several instances.
const OF_TRIANGLE: u32 = 0xffffffffu;

// Flags of a triangle: `flags` of `sampler/src/bvh.rs`.
const ONE_SIDED: u32 = 1;
const CUTOUT: u32 = 2;
const MIRRORED: u32 = 4;
const GLASS: u32 = 8;
const GLASS_IN_PARTS: u32 = 16;
const RECORD_SHIFT: u32 = 5;
