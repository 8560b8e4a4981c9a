// Cones of directions: a unit axis and the cosine of half the opening angle, in 0..π.

// Widens a cone by more than the rounding of f32, so that directions on its surface stay inside.
fn widened(cosine: f32) -> f32 {
    return max(cosine - 2e-6, -1.0);
}

// Cosine of the sum of two angles in 0..π, by their cosines; -1 if the sum exceeds π.
fn cos_of_sum(a: f32, b: f32) -> f32 {
    let sines = sqrt(max((1.0 - a * a) * (1.0 - b * b), 0.0));
    return select(a * b - sines, -1.0, a + b <= 0.0);
}

// The unit vector along v; +x if v is zero.
fn direction_of(v: vec3f) -> vec3f {
    let size = dot(v, v);
    return select(vec3f(1.0, 0.0, 0.0), v * inverseSqrt(max(size, 1e-37)), size > 1e-36);
}
