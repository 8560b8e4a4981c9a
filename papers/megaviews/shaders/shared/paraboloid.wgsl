// Dual paraboloid maps: conversions between directions and texels. Defined in `scene/src/paraboloid.rs`, which is also the
// oracle of tests.
//
// Each hemisphere, about +x and -x of the world's axes, is projected stereographically onto a square of `side`
// texels. Circles stay circles, and the rims of both hemispheres have the same (y, z). Texel centres are at half integers.
// No direction maps to a point beyond the inscribed circle, which belongs to the other hemisphere.

// Hemisphere of a direction, and position in its square, texels.
struct ParaboloidTexel {
    // 0 about +x, 1 about -x.
    hemisphere: u32,
    at: vec2f,
}

// The position of a direction of any length but 0.
fn paraboloid_of(d: vec3f, side: f32) -> ParaboloidTexel {
    let p = d.yz / max(length(d) + abs(d.x), 1e-37);
    return ParaboloidTexel(select(0u, 1u, d.x < 0.0), (p * 0.5 + 0.5) * side);
}

// Index of a direction's texel within a map of two hemispheres of side² texels, row by row.
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

// The sample point of a texel in the hemisphere's plane, -1..1. It is the texel's centre, moved inside the rim if it is
// beyond. So a texel on the rim samples a direction of its own hemisphere.
fn paraboloid_sample(cell: vec2u, side: f32) -> vec2f {
    let p = (vec2f(cell) + 0.5) / side * 2.0 - 1.0;
    let beyond = dot(p, p) / ((1.0 - 0.5 / side) * (1.0 - 0.5 / side));
    // One Newton step from 1 towards the inverse square root, since texels on the rim are not far beyond it.
    return p * select(1.0, max(1.5 - 0.5 * beyond, 0.3), beyond > 1.0);
}

// The direction of a texel's sample point. Its length is between 1 and 2.
fn paraboloid_ray(hemisphere: u32, cell: vec2u, side: f32) -> vec3f {
    let p = paraboloid_sample(cell, side);
    let x = 1.0 - dot(p, p);
    return vec3f(select(x, -x, hemisphere == 1u), 2.0 * p);
}

// Hemisphere, column and row of a texel, by its index within a map. Avoids integer divisions, which are slow on some
// devices. Exact below 2^22 texels.
fn paraboloid_cell(index: u32, side: f32) -> vec3u {
    let row = u32((f32(index) + 0.5) / side);
    let hemisphere = select(0u, 1u, row >= u32(side));
    return vec3u(hemisphere, index - row * u32(side), row - hemisphere * u32(side));
}

// Rectangle of texels whose sample points a sphere may cover in a hemisphere: first column, first row, columns, rows. It has
// all texels if the sphere contains the eye, and none if the sphere is in the other hemisphere.
fn paraboloid_area(to_center: vec3f, radius: f32, hemisphere: u32, side: f32) -> vec4u {
    let x = select(to_center.x, -to_center.x, hemisphere == 1u);
    let squared = dot(to_center, to_center);
    let over = x + sqrt(max(squared - radius * radius, 0.0));
    let is_disc = squared > radius * radius && over > 0.05 * sqrt(squared);
    let center = to_center.yz / max(over, 1e-37);
    let disc = radius / max(over, 1e-37);
    // Sample points are the centres of texels, except on the rim.
    let rim = select(0.0, 1.0, length(center) + disc > 1.0 - 2.0 / side);
    let least = ceil(((center - disc) * 0.5 + 0.5) * side - 0.5 - rim);
    let most = floor(((center + disc) * 0.5 + 0.5) * side + 0.5 + rim);
    let first = vec2u(clamp(select(vec2f(0.0), least, is_disc), vec2f(0.0), vec2f(side)));
    let end = vec2u(clamp(select(vec2f(side), most, is_disc), vec2f(0.0), vec2f(side)));
    // Rays of a hemisphere do not hit a sphere that is entirely in the other hemisphere.
    return vec4u(first, select(max(end, first) - first, vec2u(0u), x < -radius));
}
