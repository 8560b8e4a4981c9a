// Surfels: the appearance of octree nodes in maps. Also the layout of leaves in the image that they are shaded in.

// A node's appearance: a two-sided piece of a plane.
struct Surfel {
    // Radiance of the side that the axis points to; UNSEEN if that is the back of a single-sided surface.
    front: vec3f,
    // Unit axis, octahedral (2x16snorm).
    axis: u32,
    // Radiance of the other side.
    back: vec3f,
    // Metres along the axis from the node's mean position to the plane.
    offset: f32,
}

// Radiance of a side that cannot be seen.
const UNSEEN: vec3f = vec3f(-1.0);

fn is_seen(radiance: vec3f) -> bool {
    return radiance.x >= 0.0;
}

// Cosine between ray and axis below which a node that is hit from behind shows its front all the same.
const RIM: f32 = 0.5;

// Radiance of a surfel along a unit ray that hits it; UNSEEN if it shows nothing. `axis` is its decoded axis.
fn radiance_towards(surfel: Surfel, axis: vec3f, ray: vec3f) -> vec3f {
    let behind = dot(axis, ray);
    let near_side = select(surfel.back, surfel.front, behind < 0.0);
    // A node that turns away only slightly is on the rim of a round object, whose other leaves face the eye.
    let rim = !is_seen(near_side) && behind < RIM;
    return select(near_side, surfel.front, rim);
}

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
