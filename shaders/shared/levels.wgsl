// Layout of a pyramid's levels in one image, in place of mip levels. Quirk: level-of-quad.

// Levels with cells of 1, 2, 4, … 64 texels on a side. Coarser levels would save less than a step a ray.
const LEVELS: u32 = 7u;

// First cell of a level in an image of this size. Level 0 is at the top; the others are below it from left to right. The
// image is as wide as level 0 and 1.5 times as high.
fn place_of_level(size: vec2u, level: u32) -> vec2u {
    let halved = max(level, 1u) - 1u;
    return select(vec2u(size.x - (size.x >> halved), size.y / 3u * 2u), vec2u(0u), level == 0u);
}
