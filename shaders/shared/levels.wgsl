// How the levels of a pyramid lie in one image. Levels of a texture would do, but that the software driver reads all four
// pixels of a quad at the level of the first.

// Cells of 1, 2, 4, ... 64 texels on a side. Those few steps more to the whole image would save a ray less than a step each.
const LEVELS: u32 = 7u;

// Where a level begins in an image of this size: the first above, the others below it, from left to right. The image is as
// wide as the first level, and half as high again.
fn place_of_level(size: vec2u, level: u32) -> vec2u {
    let halved = max(level, 1u) - 1u;
    return select(vec2u(size.x - (size.x >> halved), size.y / 3u * 2u), vec2u(0u), level == 0u);
}
