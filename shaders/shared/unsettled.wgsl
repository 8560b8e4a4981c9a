// Layout of the list of a piece's unsettled pixels, shared by collect, second pass and highlight. Each invocation has its own
// segment of the list and its own counters. Quirk: slow-atomics.
//
// Two counters an invocation come first, then the segments. Pixels for the second pass are at the front of a segment, glossy pixels
// at its back.

import package::shared::fetch::view;

struct Segment {
    // Index of the invocation's two counters.
    counts: u32,
    // First index of the segment, and its length.
    first: u32,
    length: u32,
}

// The segment of one of `invocations` invocations.
fn segment_of(invocation: u32, invocations: u32) -> Segment {
    let pixels = view.piece_size.x * view.piece_size.y;
    let length = (pixels + invocations - 1u) / invocations;
    let counts = view.first_unsettled + 2u * invocation;
    return Segment(counts, view.first_unsettled + 2u * invocations + invocation * length, length);
}

fn place_of(packed: u32) -> vec2u {
    return vec2u(packed & 0xffffu, packed >> 16u);
}

fn packed_place(place: vec2u) -> u32 {
    return place.x | (place.y << 16u);
}
