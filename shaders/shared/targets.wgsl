// Writes pixels to the images of a chunk from compute programs.

import package::shared::fetch::view;
import package::shared::pixel::{Pixel, linear, linear_output, srgb_output};

@group(0) @binding(12) var srgb_target: texture_storage_2d<rgba8uint, write>;
@group(0) @binding(13) var linear_target: texture_storage_2d<rgba16float, write>;
// Range and confidence have one texel if no view asks for them; writes outside it are dropped.
@group(0) @binding(14) var range_target: texture_storage_2d<r32float, write>;
@group(0) @binding(15) var confidence_target: texture_storage_2d<r32uint, write>;

// The pixel of an invocation, and whether it lies in the piece.
struct Place {
    texel: vec2u,
    // The pixel's centre, as in a fragment's position.
    at: vec2f,
    inside: bool,
}

fn place_of_invocation(id: vec2u) -> Place {
    let texel = vec2u(view.target_origin) + id;
    return Place(texel, vec2f(texel) + 0.5, all(id < view.piece_size));
}

fn store_srgb(texel: vec2u, pixel: Pixel) {
    let result = srgb_output(pixel);
    textureStore(srgb_target, texel, result.color);
    textureStore(range_target, texel, vec4f(result.range, 0.0, 0.0, 0.0));
    textureStore(confidence_target, texel, vec4u(result.confidence, 0u, 0u, 0u));
}

fn store_linear(texel: vec2u, pixel: Pixel) {
    let result = linear_output(pixel);
    textureStore(linear_target, texel, result.radiance);
    textureStore(range_target, texel, vec4f(result.range, 0.0, 0.0, 0.0));
    textureStore(confidence_target, texel, vec4u(result.confidence, 0u, 0u, 0u));
}

// Writes a pixel to the target of this pipeline: linear radiance where `linear` is set, else sRGB.
fn store_pixel(texel: vec2u, pixel: Pixel) {
    if linear {
        store_linear(texel, pixel);
    } else {
        store_srgb(texel, pixel);
    }
}
