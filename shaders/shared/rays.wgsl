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

// Through the middle of the texel that a sub-sample belongs to.
fn central_ray(rays: Rays, sub_sample: vec2u) -> vec3f {
    let texel = sub_sample / rays.side;
    return ray_through(rays, (vec2f(texel) + 0.5) * f32(rays.side));
}
