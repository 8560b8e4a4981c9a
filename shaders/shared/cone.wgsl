// Cones of directions: a unit axis and the cosine of half the opening angle, in 0..π.

// Widens a cosine by more than f32 rounds, so that what a cone is meant to hold stays inside.
fn widened(cosine: f32) -> f32 {
    return max(cosine - 2e-6, -1.0);
}

// Cosine of the sum of two angles in 0..π by their cosines; -1 where the sum is beyond π.
fn cos_of_sum(a: f32, b: f32) -> f32 {
    let sines = sqrt(max((1.0 - a * a) * (1.0 - b * b), 0.0));
    return select(a * b - sines, -1.0, a + b <= 0.0);
}

// A unit vector along v; +x where v has no direction.
fn direction_of(v: vec3f) -> vec3f {
    let size = dot(v, v);
    return select(vec3f(1.0, 0.0, 0.0), v * inverseSqrt(max(size, 1e-37)), size > 1e-36);
}
