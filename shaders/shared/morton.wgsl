// Morton codes of cells of an octree: three bits a level, x lowest; ten levels in 30 bits.

fn morton_part(spread: u32) -> u32 {
    var x = spread & 0x09249249u;
    x = (x | (x >> 2u)) & 0x030c30c3u;
    x = (x | (x >> 4u)) & 0x0300f00fu;
    x = (x | (x >> 8u)) & 0x030000ffu;
    return (x | (x >> 16u)) & 0x3ffu;
}

fn morton_spread(part: u32) -> u32 {
    var x = part & 0x3ffu;
    x = (x | (x << 16u)) & 0x030000ffu;
    x = (x | (x << 8u)) & 0x0300f00fu;
    x = (x | (x << 4u)) & 0x030c30c3u;
    return (x | (x << 2u)) & 0x09249249u;
}

// The cell's coordinates among those of its level.
fn morton_cell(code: u32) -> vec3u {
    return vec3u(morton_part(code), morton_part(code >> 1u), morton_part(code >> 2u));
}

fn morton_code(cell: vec3u) -> u32 {
    return morton_spread(cell.x) | (morton_spread(cell.y) << 1u) | (morton_spread(cell.z) << 2u);
}

// Position in its octant, 0..7, of a child by its coordinates' lowest bits.
fn octant_corner(octant: u32) -> vec3u {
    return vec3u(octant & 1u, (octant >> 1u) & 1u, octant >> 2u);
}
