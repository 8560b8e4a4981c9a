// Program of compositor/src/passes/warp.rs: each pixel takes the depth that was splatted for its cell, and the
// colour that the samples have there.

import package::shared::fetch::{view};
import package::shared::pixel::{
    Linear, Pixel, Shown, corner_of_target, crossing_of_bounds, direction_at, image_position, linear_of, opinion_at, pixel_at, shown, with_specular,
};

@group(0) @binding(9) var<storage, read> depths: array<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return corner_of_target(index);
}

// Inverse depth of the pixel's cell: negative where it is its neighbours', 0 where nothing is known.
fn splatted_depth(position: vec2f) -> f32 {
    let cell = vec2i(floor(position / view.cell)) - view.cell_origin;
    return depths[view.first_cell + u32(cell.y * view.cell_columns + cell.x)];
}

// Points at which an empty cell's ray is checked to be clear of surfaces.
const CHECKS: u32 = 8u;

// Whether the samples see through to the sky: the ray misses the scene's bounds, or at every point that is
// checked some sample looks past it.
fn is_clear(d: vec3f, unknown: bool, omni: bool) -> bool {
    let span = crossing_of_bounds(d);
    var clear = unknown;
    // A loop, which ends where no pixel of a group needs it; branches cost both of their sides on a software
    // driver.
    for (var k = 1u; k <= CHECKS && clear && span.x < span.y; k++) {
        clear = opinion_at(d, mix(span.x, span.y, f32(k) / f32(CHECKS)), omni).clear;
    }
    return clear;
}

fn pixel(fragment: vec4f, omni: bool) -> Pixel {
    let position = image_position(fragment);
    let d = direction_at(position);
    let splatted = splatted_depth(position);
    let clear = is_clear(d, splatted <= 0.0, omni);
    return pixel_at(d, abs(splatted), clear, omni);
}

@fragment
fn show_pinhole(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at, false));
}

@fragment
fn show_pinhole_glossy(@builtin(position) at: vec4f) -> Shown {
    return shown(with_specular(pixel(at, false)));
}

@fragment
fn show_omni(@builtin(position) at: vec4f) -> Shown {
    return shown(pixel(at, true));
}

@fragment
fn show_omni_glossy(@builtin(position) at: vec4f) -> Shown {
    return shown(with_specular(pixel(at, true)));
}

@fragment
fn keep_pinhole(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at, false));
}

@fragment
fn keep_pinhole_glossy(@builtin(position) at: vec4f) -> Linear {
    return linear_of(with_specular(pixel(at, false)));
}

@fragment
fn keep_omni(@builtin(position) at: vec4f) -> Linear {
    return linear_of(pixel(at, true));
}

@fragment
fn keep_omni_glossy(@builtin(position) at: vec4f) -> Linear {
    return linear_of(with_specular(pixel(at, true)));
}
