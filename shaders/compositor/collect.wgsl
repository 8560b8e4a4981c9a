// Program of compositor/src/passes/second_pass.rs: lists the pixels of a piece that the warp marked, for `second_pass.wgsl` and
// `highlight.wgsl`.

import package::shared::fetch::view;
import package::shared::unsettled::{packed_place, segment_of};
import package::shared::pixel::{HIGHLIGHT, UNSETTLED, linear};

@group(0) @binding(10) var<storage, read_write> unsettled: array<u32>;
// What the warp wrote: sRGB pixels, or linear sub-pixels where `linear` is set. The other image has one texel.
@group(0) @binding(17) var srgb_image: texture_2d<u32>;
@group(0) @binding(18) var linear_image: texture_2d<f32>;

// The mark of a pixel, in place of a source.
fn mark_at(place: vec2u) -> u32 {
    if linear {
        return u32(textureLoad(linear_image, place, 0).a);
    }
    return textureLoad(srgb_image, place, 0).a;
}

// Position in the target of pixel number k of the piece.
fn place_in_target(k: u32) -> vec2u {
    // In floats, which are exact for the pixels of a piece. Quirk: slow-division.
    let row = floor((f32(k) + 0.5) / f32(view.piece_size.x));
    return vec2u(view.target_origin) + vec2u(k - u32(row) * view.piece_size.x, u32(row));
}

// Adds a pixel to the invocation's segment. `have` is the number of pixels at its front and at its back.
fn add(place: vec2u, mark: u32, first: u32, length: u32, have: vec2u) -> vec2u {
    let is_front = mark == UNSETTLED;
    let slot = select(first + length - 1u - have.y, first + have.x, is_front);
    unsettled[slot] = packed_place(place);
    return have + select(vec2u(0u, 1u), vec2u(1u, 0u), is_front);
}

@compute @workgroup_size(64)
fn collect_pixels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let segment = segment_of(id.x, groups.x * 64u);
    // Quirk: uniform-bound.
    let pixels = min(view.piece_size.x * view.piece_size.y, arrayLength(&unsettled));
    var have = vec2u(0u);
    for (var k = id.x; k < pixels; k += groups.x * 64u) {
        let place = place_in_target(k);
        let mark = mark_at(place);
        for (var i = 0u; i < min(1u, pixels) && mark >= HIGHLIGHT && mark <= UNSETTLED; i++) {
            have = add(place, mark, segment.first, segment.length, have);
        }
    }
    unsettled[segment.counts] = have.x;
    unsettled[segment.counts + 1u] = have.y;
}
