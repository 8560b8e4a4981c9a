// Program of compositor/src/passes/resolve.rs: averages sub-pixels in linear radiance, then exposes and encodes. Range,
// source and confidence are those of the middle sub-pixel.

import package::shared::pixel::{SrgbOutput, corner_of_target, encoded};

struct Resolve {
    // First texel of the piece in the target of sub-pixels and in that of pixels.
    source_origin: vec2u,
    target_origin: vec2u,
    // Sub-pixels along the edge of a pixel.
    side: u32,
    exposure: f32,
}

var<immediate> resolve: Resolve;

@group(0) @binding(0) var radiance_target: texture_2d<f32>;
@group(0) @binding(1) var range_target: texture_2d<f32>;
@group(0) @binding(2) var confidence_target: texture_2d<u32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

@fragment
fn average(@builtin(position) at: vec4f) -> SrgbOutput {
    let first = (vec2u(at.xy) - resolve.target_origin) * resolve.side + resolve.source_origin;
    // Not the bare immediate, see `with_specular` in shared/pixel.wgsl; there is no pixel left of the first.
    let side = resolve.side + u32(at.x < 0.0);
    var sum = vec3f(0.0);
    for (var y = 0u; y < side; y++) {
        for (var x = 0u; x < side; x++) {
            sum += textureLoad(radiance_target, first + vec2u(x, y), 0).rgb;
        }
    }
    let mean = sum / f32(resolve.side * resolve.side);
    let middle = first + resolve.side / 2u;
    let source = textureLoad(radiance_target, middle, 0).a;
    let color = floor(encoded(mean * resolve.exposure) * 255.0 + 0.5);
    let confidence = textureLoad(confidence_target, middle, 0).x;
    return SrgbOutput(vec4u(vec3u(color), u32(source)), textureLoad(range_target, middle, 0).x, confidence);
}
