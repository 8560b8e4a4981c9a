// The linear search of the cluster paper (section 4.2): a view ray is followed in equal steps through the scene's extent
// until it is behind the surface of every camera that looks there. The last step is then subdivided. What lies before the
// extent and behind it, within the scene's bounds, is followed in as many steps each.

import package::shared::fetch::{PointTests, POINTS, crossing_of_extent, runtime_bound, test_points, view};
import package::shared::ray_end::RayEnd;

// Parts of the last step. 64 steps then place a surface to within 1/512 of the bounds, and the fetch refines it.
const PARTS: f32 = 8.0;

// Tests POINTS points against all samples.
fn test_points_in_all(d: vec3f, start: f32, step: f32) -> PointTests {
    var all = PointTests(0u, 0u);
    for (var i = 0u; i < runtime_bound(view.sample_count); i++) {
        let one = test_points(view.samples[i], d, start, step);
        all = PointTests(all.seen | one.seen, all.clear | one.clear);
    }
    return all;
}

// Follows the ray in direction d between the depths at which it crosses the scene's bounds.
fn march(d: vec3f, span: vec2f, steps: u32) -> RayEnd {
    let crossing = crossing_of_extent(span, d);
    let crosses = crossing.x < crossing.y;
    let near = select(span, crossing, crosses);
    var end = RayEnd(span.x, false, true);
    for (var part = 0u; part < runtime_bound(3u) && !end.found; part++) {
        // Before the extent, within it, and behind it.
        let before = select(near, vec2f(span.x, near.x), part == 0u);
        let next = march_part(d, select(before, vec2f(near.y, span.y), part == 2u), steps);
        end = RayEnd(next.t, next.found, end.clear && next.clear);
    }
    return end;
}

// Follows the ray in direction d between two depths, in `steps` steps.
fn march_part(d: vec3f, span: vec2f, steps: u32) -> RayEnd {
    let step = (span.y - span.x) / f32(steps);
    var outside = span.x;
    var found = false;
    // False once the ray passes a point that no sample looks at.
    var clear = true;
    for (var k = 0u; k < runtime_bound(steps) && !found && span.x < span.y; k += POINTS) {
        let all = test_points_in_all(d, span.x + step * f32(k), step);
        // Masks points beyond the last step.
        let taken = (1u << min(POINTS, steps - k)) - 1u;
        let inside = all.seen & ~all.clear & taken;
        found = inside != 0u;
        let free = select(countOneBits(taken), firstTrailingBit(inside), found);
        outside = span.x + step * f32(k + free);
        clear = clear && (~all.seen & ((1u << free) - 1u)) == 0u;
    }
    // The paper bisects. Eight points at once find the same eighth as three bisections, at the cost of two.
    if found {
        let all = test_points_in_all(d, outside, step / PARTS);
        outside += step / PARTS * f32(min(firstTrailingBit(all.seen & ~all.clear), POINTS - 1u));
    }
    // The near side of the surface: the most conservative one.
    return RayEnd(outside, found, clear);
}
