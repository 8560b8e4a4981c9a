// The rays of a tile of a pinhole image: one per sub-sample, `side` × `side` to a texel.

struct Rays {
    // From the eye to the tile's top left corner, on the plane at unit depth; world axes.
    top_left: vec3f,
    // Sub-samples along each side of a texel.
    side: u32,
    // From one sub-sample to the next on that plane.
    right: vec3f,
    // Sub-samples of the tile: columns.
    width: u32,
    down: vec3f,
    // Rows.
    height: u32,
}

// Through an image position, in sub-samples from the tile's corner; not a unit vector.
fn ray_through(rays: Rays, at: vec2f) -> vec3f {
    return rays.top_left + rays.right * at.x + rays.down * at.y;
}

// Of a list of texels, laid out row by row in an image of their own: which sub-sample of the tile one of the
// list's sub-samples is. A place is a texel's column and, in the upper half, its row.
fn listed_sub_sample(rays: Rays, place: u32, sub_sample: vec2u) -> vec2u {
    return vec2u(place & 0xffffu, place >> 16u) * rays.side + sub_sample % rays.side;
}

// Where in a list the texel of a sub-sample stands.
fn list_index(rays: Rays, sub_sample: vec2u) -> u32 {
    let texel = sub_sample / rays.side;
    return texel.y * (rays.width / rays.side) + texel.x;
}

// Through the middle of the texel that a sub-sample belongs to.
fn central_ray(rays: Rays, sub_sample: vec2u) -> vec3f {
    let texel = sub_sample / rays.side;
    return ray_through(rays, (vec2f(texel) + 0.5) * f32(rays.side));
}
