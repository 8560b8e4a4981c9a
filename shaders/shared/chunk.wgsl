// The layout of points, or of an octree's leaves, in the image that they are shaded in.

// Leaves that are shaded in one submission, as an image with two texels per leaf, one for each side.
struct LeafChunk {
    // Least corner of the octree's root relative to the eye, metres.
    root_about_eye: vec3f,
    // Length of the root's edge, metres.
    edge: f32,
    // Columns and rows of the image: multiples of LEAF_BLOCK.
    size: vec2u,
    // First leaf.
    first: u32,
    // Number of leaves of the octree.
    leaves: u32,
    // Edge of a leaf's cell, metres.
    cell: f32,
}

// Texels on a side of a square of consecutive leaves in the image. These are neighbours in space, so that indirect light can
// be gathered by squares.
const LEAF_BLOCK: u32 = 16u;

// The leaf and side of a texel of the image: 2 × the leaf's index within the chunk, + 1 for the back.
fn leaf_side(chunk: LeafChunk, at: vec2u) -> u32 {
    let block = at / LEAF_BLOCK;
    let within = at % LEAF_BLOCK;
    let before = block.y * (chunk.size.x / LEAF_BLOCK) + block.x;
    return (before * LEAF_BLOCK + within.y) * LEAF_BLOCK + within.x;
}
