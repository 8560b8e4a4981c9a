// Program of compositor/src/passes/linear.rs: the cluster paper's search, and the fetch at what it found.

import package::shared::fetch::{crossing_of_bounds, view};
import package::shared::march::march;
import package::shared::pixel::{Linear, Pixel, Shown, corner_of_target, linear_of, shown};
import package::shared::ray_end::pixel_at_end;
import package::shared::targets::{place_of_twin, store_linear, store_shown};

fn pixel(at: vec2f) -> Pixel {
    let position = at - view.target_origin + view.piece_origin;
    let d = view.corner + view.right * position.x + view.down * position.y;
    let span = crossing_of_bounds(view.bounds_min, view.bounds_max, d);
    return pixel_at_end(d, span, march(d, span, view.steps));
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
