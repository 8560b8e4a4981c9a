// The rays of a tile of a pinhole image: one per sub-sample, `side` × `side` per texel.

struct Rays {
    // Vector from the eye to the tile's top left corner, on the plane at unit depth; world axes.
    top_left: vec3f,
    // Sub-samples along each side of a texel.
    side: u32,
    // Step from one sub-sample to the next in its row, on that plane.
    right: vec3f,
    // Columns of the tile, sub-samples.
    width: u32,
    // Step to the next row.
    down: vec3f,
    // Rows of the tile, sub-samples.
    height: u32,
}

// The ray through an image position, in sub-samples from the tile's corner. Not a unit vector.
fn ray_through(rays: Rays, at: vec2f) -> vec3f {
    return rays.top_left + rays.right * at.x + rays.down * at.y;
}

// The sub-sample of the tile that a sub-sample of a list of texels belongs to. The list is laid out row by row in an image of
// its own. `place`: column of the listed texel in the tile, and its row in the upper half.
fn listed_sub_sample(rays: Rays, place: u32, sub_sample: vec2u) -> vec2u {
    return vec2u(place & 0xffffu, place >> 16u) * rays.side + sub_sample % rays.side;
}

// Index in the list of a sub-sample's texel.
fn list_index(rays: Rays, sub_sample: vec2u) -> u32 {
    let texel = sub_sample / rays.side;
    return texel.y * (rays.width / rays.side) + texel.x;
}

// The ray through the centre of a sub-sample's texel.
fn central_ray(rays: Rays, sub_sample: vec2u) -> vec3f {
    let texel = sub_sample / rays.side;
    return ray_through(rays, (vec2f(texel) + 0.5) * f32(rays.side));
}
