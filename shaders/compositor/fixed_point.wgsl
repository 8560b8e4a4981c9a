// Program of compositor/src/passes/fixed_point.rs: fixed-point iteration in the nearest sample, from the middle of the
// scene's bounds. Where it does not converge, a linear search.

import package::shared::fetch::{
    SETTLED, crossing_of_bounds, direction_of, fetch_from, runtime_bound, position_of, view,
};
import package::shared::fixed_point::{limits_of, settle};
import package::shared::march::march;
import package::shared::pixel::{Pixel, surface_pixel};
import package::shared::ray_end::pixel_at_end;

// Steps of the linear search.
const FALLBACK_STEPS: u32 = 32u;

fn pixel(at: vec2f) -> Pixel {
    let d = direction_of(position_of(at));
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let q = settle(view.samples[0], d, 2.0 / max(span.x + span.y, 1e-20), limits_of(span), view.steps);
    let fetched = fetch_from(view.samples[0], d, q);
    let settled = span.x < span.y && fetched.agreement >= SETTLED;
    var result = surface_pixel(fetched, 0u, d);
    // A loop in place of a branch: the software driver runs both sides of a branch.
    for (var k = 0u; k < runtime_bound(1u) && !settled; k++) {
        result = pixel_at_end(d, span, march(d, span, FALLBACK_STEPS));
    }
    return result;
}
