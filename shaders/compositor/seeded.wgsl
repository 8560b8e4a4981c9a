// Program of compositor/src/search_pipelines.rs: fixed-point iteration from the depth of the pixel's cell. Where it does not
// converge, a short linear search.

import package::shared::cells::depth_of;
import package::shared::fetch::{
    SETTLED, crossing_of_bounds, direction_of, fetch_from, runtime_bound, position_of, view,
};
import package::shared::fixed_point::{limits_of, settle, settle_in_any};
import package::shared::march::march;
import package::shared::pixel::{OTHER_SAMPLE, Pixel, UNRESOLVED, surface_pixel};
import package::shared::ray_end::{RayEnd, pixel_at_end};

@group(0) @binding(9) var<storage, read> depths: array<u32>;

// Steps of the linear search.
const FALLBACK_STEPS: u32 = 8u;

// A pixel whose first sample did not converge. It tries all samples from the same start, then searches linearly and tries
// all samples from there.
fn pixel_elsewhere(d: vec3f, span: vec2f, start: f32, source: u32) -> Pixel {
    let limits = limits_of(span);
    var other = settle_in_any(d, start, limits, view.steps);
    var end = RayEnd(span.y, false, true);
    for (var k = 0u; k < runtime_bound(1u) && !other.found; k++) {
        end = march(d, span, FALLBACK_STEPS);
        if end.found {
            other = settle_in_any(d, 1.0 / max(end.t, 1e-20), limits, view.steps);
        }
    }
    if other.found && span.x < span.y {
        var pixel = surface_pixel(other.fetch, other.source, d);
        pixel.source += select(0u, OTHER_SAMPLE, other.source != source && pixel.source != UNRESOLVED);
        return pixel;
    }
    return pixel_at_end(d, span, end);
}

fn pixel(at: vec2f) -> Pixel {
    let position = position_of(at);
    let d = direction_of(position);
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    let seed = depth_of(depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)]);
    let q = settle(view.samples[seed.source], d, abs(seed.q), limits_of(span), view.steps);
    let fetched = fetch_from(view.samples[seed.source], d, q);
    let settled = span.x < span.y && fetched.agreement >= SETTLED;
    var result = surface_pixel(fetched, seed.source, d);
    // A loop in place of a branch. Quirk: both-sides.
    for (var k = 0u; k < runtime_bound(1u) && !settled; k++) {
        result = pixel_elsewhere(d, span, abs(seed.q), seed.source);
    }
    return result;
}
