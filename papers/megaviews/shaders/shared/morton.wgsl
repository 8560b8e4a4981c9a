// Morton codes of cells of an octree: three bits a level, x lowest; ten levels in 30 bits.

// Extracts every third bit.
fn morton_part(spread: u32) -> u32 {
    var x = spread & 0x09249249u;
    x = (x | (x >> 2u)) & 0x030c30c3u;
    x = (x | (x >> 4u)) & 0x0300f00fu;
    x = (x | (x >> 8u)) & 0x030000ffu;
    return (x | (x >> 16u)) & 0x3ffu;
}

// Spreads ten bits to every third bit.
fn morton_spread(part: u32) -> u32 {
    var x = part & 0x3ffu;
    x = (x | (x << 16u)) & 0x030000ffu;
    x = (x | (x << 8u)) & 0x0300f00fu;
    x = (x | (x << 4u)) & 0x030c30c3u;
    return (x | (x << 2u)) & 0x09249249u;
}

// The coordinates of a cell on its level.
fn morton_cell(code: u32) -> vec3u {
    return vec3u(morton_part(code), morton_part(code >> 1u), morton_part(code >> 2u));
}

// The code of a cell.
fn morton_code(cell: vec3u) -> u32 {
    return morton_spread(cell.x) | (morton_spread(cell.y) << 1u) | (morton_spread(cell.z) << 2u);
}

// Offset of an octant, 0..7, within its parent: 0 or 1 on each axis.
fn octant_corner(octant: u32) -> vec3u {
    return vec3u(octant & 1u, (octant >> 1u) & 1u, octant >> 2u);
}
