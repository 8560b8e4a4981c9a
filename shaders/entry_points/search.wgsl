// Entry points of every search. build.rs links them with each program that defines `fn pixel(at: vec2f) -> Pixel`; that
// program is `package::program` here.

import package::program::pixel;
import package::shared::pixel::{LinearOutput, SrgbOutput, corner_of_target, linear_output, srgb_output};
import package::shared::targets::{place_of_invocation, store_pixel};

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

@fragment
fn write_srgb(@builtin(position) at: vec4f) -> SrgbOutput {
    return srgb_output(pixel(at.xy));
}

@fragment
fn write_linear(@builtin(position) at: vec4f) -> LinearOutput {
    return linear_output(pixel(at.xy));
}

@compute @workgroup_size(8, 8)
fn write_compute(@builtin(global_invocation_id) id: vec3u) {
    let place = place_of_invocation(id.xy);
    if place.inside {
        store_pixel(place.texel, pixel(place.at));
    }
}
