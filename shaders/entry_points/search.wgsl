// Entry points of every search: build.rs links them with each program that defines `fn pixel(at: vec2f) -> Pixel` and no
// entry points of its own, which is `package::program` here.

import package::program::pixel;
import package::shared::pixel::{Linear, Shown, corner_of_target, linear_of, shown};
import package::shared::targets::{place_of_twin, store_linear, store_shown};

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
