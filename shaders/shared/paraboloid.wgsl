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
    let beyond = dot(p, p) / ((1.0 - 0.5 / side) * (1.0 - 0.5 / side));
    // One step of Newton's from 1 towards the inverse square root: texels that the rim cuts are not far beyond it.
    return p * select(1.0, max(1.5 - 0.5 * beyond, 0.3), beyond > 1.0);
}

// The direction of a texel's sample point, of a length between 1 and 2.
fn paraboloid_ray(hemisphere: u32, cell: vec2u, side: f32) -> vec3f {
    let p = paraboloid_sample(cell, side);
    let x = 1.0 - dot(p, p);
    return vec3f(select(x, -x, hemisphere == 1u), 2.0 * p);
}

// Hemisphere, column and row of a texel by its index within a map, without the integer divisions that are slow on
// some devices; exact below 2^22 texels.
fn paraboloid_cell(index: u32, side: f32) -> vec3u {
    let row = u32((f32(index) + 0.5) / side);
    let hemisphere = select(0u, 1u, row >= u32(side));
    return vec3u(hemisphere, index - row * u32(side), row - hemisphere * u32(side));
}

// First texel and number of texels, in each direction, whose sample points a ball may cover in a hemisphere; all of
// them where it holds the eye, none where it lies in the other hemisphere.
fn paraboloid_area(to_center: vec3f, radius: f32, hemisphere: u32, side: f32) -> vec4u {
    let x = select(to_center.x, -to_center.x, hemisphere == 1u);
    let squared = dot(to_center, to_center);
    let over = x + sqrt(max(squared - radius * radius, 0.0));
    let is_disc = squared > radius * radius && over > 0.05 * sqrt(squared);
    let center = to_center.yz / max(over, 1e-37);
    let disc = radius / max(over, 1e-37);
    // Sample points are texels' centres, but for those that the rim cuts.
    let rim = select(0.0, 1.0, length(center) + disc > 1.0 - 2.0 / side);
    let least = ceil(((center - disc) * 0.5 + 0.5) * side - 0.5 - rim);
    let most = floor(((center + disc) * 0.5 + 0.5) * side + 0.5 + rim);
    let first = vec2u(clamp(select(vec2f(0.0), least, is_disc), vec2f(0.0), vec2f(side)));
    let end = vec2u(clamp(select(vec2f(side), most, is_disc), vec2f(0.0), vec2f(side)));
    // Rays of a hemisphere stay on its side of the rim, where nothing is of a ball that lies beyond it.
    return vec4u(first, select(max(end, first) - first, vec2u(0u), x < -radius));
}
