// Receivers: surfaces of a tile whose indirect light is computed, and interpolated for their neighbours. Each block of
// sub-samples has up to two.

// The blocks of a tile.
struct Blocks {
    // Columns and rows of the tile, sub-samples.
    size: vec2u,
    // Columns and rows of a block, sub-samples.
    block: vec2u,
    // Columns and rows of the tile's blocks.
    count: vec2u,
    // Distance in blocks within which a sub-sample uses receivers, in each direction.
    reach: u32,
}

// Most sub-samples of a block.
const MOST_OF_BLOCK: u32 = 256u;

// Most receivers of a block.
const OF_BLOCK: u32 = 2u;

// A receiver.
struct Chosen {
    // Relative to the eye, metres.
    position: vec3f,
    // Column and row of its sub-sample in the tile, 16 bits each.
    place: u32,
    normal: vec3f,
    // 0 for a missing receiver.
    exists: u32,
}
