// Program of compositor/src/passes/fixed_point.rs: fixed-point iteration from the middle of the scene's bounds, in the
// sample that is nearest; where it does not settle, a linear search.

import package::shared::fetch::{SETTLED, crossing_of_bounds, fetch_from, not_baked, view};
import package::shared::fixed_point::{limits_of, settle};
import package::shared::march::march;
import package::shared::pixel::{Linear, Pixel, Shown, corner_of_target, linear_of, shown, surface_pixel};
import package::shared::ray_end::pixel_at_end;
import package::shared::targets::{place_of_twin, store_linear, store_shown};

// Steps of the linear search, where the iteration does not settle.
const TAIL: u32 = 32u;

fn pixel(at: vec2f) -> Pixel {
    let position = at - view.target_origin + view.piece_origin;
    let d = view.corner + view.right * position.x + view.down * position.y;
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    let q = settle(view.samples[0], d, 2.0 / max(span.x + span.y, 1e-20), limits_of(span), view.steps);
    let fetched = fetch_from(view.samples[0], d, q);
    let settled = span.x < span.y && fetched.agreement >= SETTLED;
    var result = surface_pixel(fetched, 0u, d);
    // A loop that runs once or not at all: a branch's two sides are both run by the software driver.
    for (var k = 0u; k < not_baked(1u) && !settled; k++) {
        result = pixel_at_end(d, span, march(d, span, TAIL));
    }
    return result;
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

@fragment
fn show(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at.xy));
}

@fragment
fn keep(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at.xy));
}

@compute @workgroup_size(8, 8)
fn show_twin(@builtin(global_invocation_id) id: vec3u) {
    let place = place_of_twin(id.xy);
    if place.inside {
        store_shown(place.texel, pixel(place.at));
    }
}

@compute @workgroup_size(8, 8)
fn keep_twin(@builtin(global_invocation_id) id: vec3u) {
    let place = place_of_twin(id.xy);
    if place.inside {
        store_linear(place.texel, pixel(place.at));
    }
}
