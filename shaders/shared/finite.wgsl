// Removes NaN and infinity, by exponent bits. Quirk: folded-nan.

// Each component of x if it is finite, else 0.
fn finite_or_zero(x: vec3f) -> vec3f {
    let special = (bitcast<vec3u>(x) & vec3u(0x7f800000u)) == vec3u(0x7f800000u);
    return select(x, vec3f(0.0), special);
}
