// The cluster paper's search (section 4.2): a view ray is followed in equal steps through the scene's bounds until it is
// behind the surface of every camera that looks there; the last step is then divided once more.

import package::shared::fetch::{Opinions, POINTS, not_baked, opinions_of, view};
import package::shared::ray_end::RayEnd;

// Parts that the last step is divided into: 64 steps place a surface to within 1/512 of the bounds, and the fetch brings it
// closer yet.
const PARTS: f32 = 8.0;

// Whether any sample looks at, or past, each of POINTS points.
fn opinions_at(d: vec3f, start: f32, step: f32) -> Opinions {
    var all = Opinions(0u, 0u);
    for (var i = 0u; i < not_baked(view.sample_count); i++) {
        let one = opinions_of(view.samples[i], d, start, step);
        all = Opinions(all.seen | one.seen, all.clear | one.clear);
    }
    return all;
}

// Follows the ray in direction d between two depths, in so many steps.
fn march(d: vec3f, span: vec2f, steps: u32) -> RayEnd {
    let step = (span.y - span.x) / f32(steps);
    var outside = span.x;
    var found = false;
    // The sky is seen unless the ray passes a place that no sample looks at.
    var clear = true;
    for (var k = 0u; k < not_baked(steps) && !found && span.x < span.y; k += POINTS) {
        let all = opinions_at(d, span.x + step * f32(k), step);
        // Steps beyond the last are not taken.
        let taken = (1u << min(POINTS, steps - k)) - 1u;
        let inside = all.seen & ~all.clear & taken;
        found = inside != 0u;
        let free = select(countOneBits(taken), firstTrailingBit(inside), found);
        outside = span.x + step * f32(k + free);
        clear = clear && (~all.seen & ((1u << free) - 1u)) == 0u;
    }
    // The paper halves; eight points at once find the same eighth as three halvings, at the price of two.
    if found {
        let all = opinions_at(d, outside, step / PARTS);
        outside += step / PARTS * f32(min(firstTrailingBit(all.seen & ~all.clear), POINTS - 1u));
    }
    // The side on which all cameras are: the most conservative surface.
    return RayEnd(outside, found, clear);
}
