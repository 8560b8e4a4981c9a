// Fixed-point iteration for the depth of a pixel: from a point of the view ray to the surface that a sample has where it sees
// that point, and from there back to the ray. It converges where the warp's slope is below one; where there are several
// solutions, its start decides which it finds.

import package::shared::fetch::{
    Fetch, SETTLED, ViewSample, fetch_from, inverse_range, nearest, runtime_bound, nothing_at, seen_by_sample, view,
};

// A depth that changes by no more than this share of itself has settled: a fetch brings it closer yet.
const AT_REST: f32 = 1e-3;

// At most so many steps from inverse depth q in direction d; `limits` are the least and the greatest inverse depth of the
// scene's bounds on the ray. Where the sample does not look, the point stays where it is.
fn settle(s: ViewSample, d: vec3f, q: f32, limits: vec2f, steps: u32) -> f32 {
    var at = clamp(q, limits.x, limits.y);
    var moves = true;
    for (var k = 0u; k < runtime_bound(steps) && moves; k++) {
        let ray = d + s.eye_from_center * at;
        let seen = seen_by_sample(s, ray);
        let stored = textureSampleLevel(inverse_range, nearest, seen.uv, s.layer, 0.0).x;
        // Inverse range of a surface; 0 for the sky and for whatever is not a positive number.
        let surface = select(0.0, stored, (bitcast<u32>(stored) - 1u) < 0x7f7fffffu);
        let unit = inverseSqrt(max(dot(ray, ray), 1e-30));
        // Depth of the surface times its inverse range: not positive behind the eye, which is as near as it gets.
        let depth = dot(view.forward, ray * unit - s.eye_from_center * surface);
        let next = clamp(select(limits.y, surface / max(depth, 1e-30), depth > 0.0), limits.x, limits.y);
        moves = seen.inside && abs(next - at) > AT_REST * at;
        at = select(at, next, seen.inside);
    }
    return at;
}

// Least and greatest inverse depth between two depths.
fn limits_of(span: vec2f) -> vec2f {
    return vec2f(1.0 / max(span.y, 1e-20), 1.0 / max(max(span.x, 1e-6 * span.y), 1e-20));
}

// Where iterating in one sample after the other led.
struct Settled {
    fetch: Fetch,
    source: u32,
    // A sample has that surface at its nearest texel, and none sees past it.
    found: bool,
}

// The first sample, in the plan's order, in which the iteration from inverse depth q settles at a surface that no other
// sample refutes by seeing past it.
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
