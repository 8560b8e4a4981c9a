// Position along a Hilbert curve of ten levels (Skilling, "Programming the Hilbert curve", 2004). Neighbours along the curve
// are neighbours in space, so each of its runs is connected; a run of a Morton curve may not be.

import package::megaviews::shared::morton::morton_spread;

// The first axis and another one. If the other has `bit`, the first is inverted below it; else both exchange lower bits.
fn hilbert_turned(first: u32, own: u32, bit: u32) -> vec2u {
    let below = bit - 1u;
    let differ = (first ^ own) & below;
    return select(vec2u(first ^ differ, own ^ differ), vec2u(first ^ below, own), (own & bit) != 0u);
}

// Position of a cell along the curve.
fn hilbert_code(cell: vec3u) -> u32 {
    var x = cell;
    for (var bit = 512u; bit > 1u; bit = bit >> 1u) {
        x.x = select(x.x, x.x ^ (bit - 1u), (x.x & bit) != 0u);
        let y = hilbert_turned(x.x, x.y, bit);
        let z = hilbert_turned(y.x, x.z, bit);
        x = vec3u(z.x, y.y, z.y);
    }
    x.y = x.y ^ x.x;
    x.z = x.z ^ x.y;
    var all = 0u;
    for (var bit = 512u; bit > 1u; bit = bit >> 1u) {
        all = select(all, all ^ (bit - 1u), (x.z & bit) != 0u);
    }
    x = x ^ vec3u(all);
    // The first axis has the highest bit of each level.
    return (morton_spread(x.x) << 2u) | (morton_spread(x.y) << 1u) | morton_spread(x.z);
}
