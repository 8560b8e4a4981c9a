// Dual paraboloid maps: directions and texels; `scene/src/paraboloid.rs` is the definition and its tests' oracle.
//
// Each hemisphere, about +x and -x of the world's axes, is projected stereographically onto a square of `side`
// texels: circles stay circles, and the rim of one hemisphere has the same (y, z) as that of the other. Texel
// centres lie at half integers. What is beyond the inscribed circle belongs to the other hemisphere, and no
// direction falls there.

// Position in a hemisphere's square, texels, of a direction of any length but 0.
struct ParaboloidTexel {
    // 0 about +x, 1 about -x.
    hemisphere: u32,
    at: vec2f,
}

fn paraboloid_of(d: vec3f, side: f32) -> ParaboloidTexel {
    let p = d.yz / max(length(d) + abs(d.x), 1e-37);
    return ParaboloidTexel(select(0u, 1u, d.x < 0.0), (p * 0.5 + 0.5) * side);
}

// The texel that a direction falls into: its index within a map of two hemispheres of side² texels, row by row.
fn paraboloid_index(d: vec3f, side: u32) -> u32 {
    let position = paraboloid_of(d, f32(side));
    // A direction on the rim may round to the square's own border.
    let cell = vec2u(clamp(position.at, vec2f(0.0), vec2f(f32(side) - 0.5)));
    return (position.hemisphere * side + cell.y) * side + cell.x;
}

// The unit direction of a position in a hemisphere's square.
fn paraboloid_direction(hemisphere: u32, at: vec2f, side: f32) -> vec3f {
    let p = at / side * 2.0 - 1.0;
    let s = dot(p, p);
    let x = (1.0 - s) / (1.0 + s);
    return vec3f(select(x, -x, hemisphere == 1u), p * (2.0 / (1.0 + s)));
}

// The unit direction of the centre of a texel by its index within a map.
fn paraboloid_center(index: u32, side: u32) -> vec3f {
    let row = index / side;
    let at = vec2f(f32(index % side), f32(row % side)) + 0.5;
    return paraboloid_direction(row / side, at, f32(side));
}

// The point of a hemisphere's plane, -1..1, that stands for a texel: its centre, drawn inside the rim where that lies
// beyond it, so that a texel that the rim cuts stands for directions of its own hemisphere.
fn paraboloid_sample(cell: vec2u, side: f32) -> vec2f {
    let p = (vec2f(cell) + 0.5) / side * 2.0 - 1.0;
    return p * min((1.0 - 0.5 / side) * inverseSqrt(max(dot(p, p), 1e-12)), 1.0);
}

// The unit direction of a texel's sample point, by the texel's index within a map.
fn paraboloid_ray(index: u32, side: u32) -> vec3f {
    let row = index / side;
    let p = paraboloid_sample(vec2u(index % side, row % side), f32(side));
    let s = dot(p, p);
    let x = (1.0 - s) / (1.0 + s);
    return vec3f(select(x, -x, row >= side), p * (2.0 / (1.0 + s)));
}
