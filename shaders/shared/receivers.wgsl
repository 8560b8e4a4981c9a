// Receivers: surfaces of a tile that receive light for those around them. Each block of sub-samples has up to two.

// What passes are told of a tile.
struct Blocks {
    // Sub-samples of the tile.
    size: vec2u,
    // Sub-samples of a block: columns, rows.
    block: vec2u,
    // Blocks of the tile: columns, rows.
    count: vec2u,
    // How many blocks away a sub-sample looks for receivers, in each direction.
    reach: u32,
}

// Most sub-samples of a block.
const MOST_OF_BLOCK: u32 = 256u;

// Receivers of a block, at most.
const OF_BLOCK: u32 = 2u;

struct Chosen {
    // About the eye.
    position: vec3f,
    // Column and row of its sub-sample in the tile, 16 bits each.
    place: u32,
    normal: vec3f,
    // 0 where there is none.
    exists: u32,
}
