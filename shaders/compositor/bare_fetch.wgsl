// Program of compositor/src/bare_fetch.rs: one nearest colour fetch a pixel, at the pixel's own position in the first
// sample. No reconstruction can be cheaper.

import package::shared::fetch::{nearest, radiance, view};
import package::shared::pixel::{LinearOutput, SrgbOutput, corner_of_target, encoded};

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

fn texel(at: vec2f) -> vec3f {
    let uv = (at - view.target_origin) / vec2f(view.piece_size);
    return textureSampleLevel(radiance, nearest, uv, view.samples[0].layer, 0.0).rgb;
}

@fragment
fn write_srgb(@builtin(position) at: vec4f) -> SrgbOutput {
    let color = floor(encoded(texel(at.xy) * view.lighting.exposure) * 255.0 + 0.5);
    return SrgbOutput(vec4u(vec3u(color), 1u), 0.0, 0u);
}

@fragment
fn write_linear(@builtin(position) at: vec4f) -> LinearOutput {
    return LinearOutput(vec4f(texel(at.xy), 1.0), 0.0, 0u);
}
