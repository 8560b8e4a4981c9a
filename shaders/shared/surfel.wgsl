// Surfels: what maps of an octree's nodes show of them, and how leaves are laid out as an image to be shaded.

// A node as a piece of a plane with two sides.
struct Surfel {
    // Radiance that leaves it on the side that its axis points to; UNSEEN of the back of what has one side.
    front: vec3f,
    // Unit axis, octahedral (2x16snorm).
    axis: u32,
    // Radiance that leaves it on the other side.
    back: vec3f,
    // Metres along the axis from the node's mean position to the plane.
    offset: f32,
}

// No radiance.
const UNSEEN: vec3f = vec3f(-1.0);

fn is_seen(radiance: vec3f) -> bool {
    return radiance.x >= 0.0;
}

// Cosine between a ray and the axis of a node that it meets from behind, below which the node is seen all the same.
const RIM: f32 = 0.5;

// Radiance of a surfel, whose axis is given unpacked, along a unit ray that meets it; UNSEEN where it shows nothing.
fn radiance_towards(surfel: Surfel, axis: vec3f, ray: vec3f) -> vec3f {
    let behind = dot(axis, ray);
    let near_side = select(surfel.back, surfel.front, behind < 0.0);
    // What turns away but a little is the rim of something round, whose other leaves face the eye.
    let rim = !is_seen(near_side) && behind < RIM;
    return select(near_side, surfel.front, rim);
}

// Leaves that are shaded at a time, as an image in which each has two texels, one for either side.
struct LeafChunk {
    // The octree's root, its corner of least coordinates, about the eye; metres.
    root_about_eye: vec3f,
    // Length of the root's edge, metres.
    edge: f32,
    // Columns and rows of the image: multiples of LEAF_BLOCK.
    size: vec2u,
    // First leaf.
    first: u32,
    // Leaves of the octree.
    leaves: u32,
    // Edge of a leaf's cell, metres.
    cell: f32,
}

// Squares of the image hold leaves that follow one another, which are neighbours in space: indirect light is gathered
// by such squares.
const LEAF_BLOCK: u32 = 16u;

// Which texel of the chunk's list a texel of its image is: twice the leaf, counted from the chunk's first, plus 1 for
// the back.
fn leaf_side(chunk: LeafChunk, at: vec2u) -> u32 {
    let block = at / LEAF_BLOCK;
    let within = at % LEAF_BLOCK;
    let before = block.y * (chunk.size.x / LEAF_BLOCK) + block.x;
    return (before * LEAF_BLOCK + within.y) * LEAF_BLOCK + within.x;
}
