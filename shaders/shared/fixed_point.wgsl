// Fixed-point iteration for the depth of a pixel: from a point of the view ray to the surface that a sample has in that
// direction, and back to the ray. It converges where the slope of the warp is below one. Of several solutions the start
// decides which one it finds.

import package::shared::fetch::{
    Fetch, SETTLED, ViewSample, fetch_from, inverse_range, nearest, runtime_bound, nothing_at, seen_by_sample, view,
};

// Relative change of depth below which the iteration has converged. The fetch refines it further.
const AT_REST: f32 = 1e-3;

// Iterates at most `steps` times from inverse depth q in direction d. `limits` are the least and greatest inverse depth
// of the scene's bounds on the ray. Where the sample does not look, the point stays.
fn settle(s: ViewSample, d: vec3f, q: f32, limits: vec2f, steps: u32) -> f32 {
    var at = clamp(q, limits.x, limits.y);
    var moves = true;
    for (var k = 0u; k < runtime_bound(steps) && moves; k++) {
        let ray = d + s.eye_from_center * at;
        let seen = seen_by_sample(s, ray);
        let stored = textureSampleLevel(inverse_range, nearest, seen.uv, s.layer, 0.0).x;
        // Inverse range of a surface; 0 for sky and for anything that is not a positive number.
        let surface = select(0.0, stored, (bitcast<u32>(stored) - 1u) < 0x7f7fffffu);
        let unit = inverseSqrt(max(dot(ray, ray), 1e-30));
        // Depth of the surface times its inverse range. Not positive behind the eye; then the nearest limit is used.
        let depth = dot(view.forward, ray * unit - s.eye_from_center * surface);
        let next = clamp(select(limits.y, surface / max(depth, 1e-30), depth > 0.0), limits.x, limits.y);
        moves = seen.inside && abs(next - at) > AT_REST * at;
        at = select(at, next, seen.inside);
    }
    return at;
}

// Least and greatest inverse depth of two depths.
fn limits_of(span: vec2f) -> vec2f {
    return vec2f(1.0 / max(span.y, 1e-20), 1.0 / max(max(span.x, 1e-6 * span.y), 1e-20));
}

// Result of the iteration in several samples.
struct Settled {
    fetch: Fetch,
    source: u32,
    // Some sample has the surface at its nearest texel, and no sample sees past it.
    found: bool,
}

// The first sample in the plan's order in which the iteration from inverse depth q converges to a surface that no other
// sample sees past.
fn settle_in_any(d: vec3f, q: f32, limits: vec2f, steps: u32) -> Settled {
    var result = Settled(nothing_at(q), 0u, false);
    for (var i = 0u; i < runtime_bound(view.sample_count) && !result.found; i++) {
        let at = settle(view.samples[i], d, q, limits, steps);
        let fetched = fetch_from(view.samples[i], d, at);
        var found = fetched.agreement >= SETTLED;
        for (var k = 0u; k < runtime_bound(view.sample_count) && found; k++) {
            found = k == i || fetch_from(view.samples[k], d, fetched.q).past < SETTLED;
        }
        if found {
            result = Settled(fetched, i, true);
        }
    }
    return result;
}
