// The list of a piece's pixels that the warp left over, as collect and mend agree on it: each of their invocations has a
// number of its own, and a stretch of the list that takes all pixels which that number collects. No two share a counter: on
// the software driver an atomic costs as much as a fetch.
//
// First come two counts an invocation, then the stretches. Pixels to be mended are at a stretch's front, those that are
// settled but for a highlight at its back.

import package::shared::fetch::view;

struct Segment {
    // Place of the invocation's two counts.
    counts: u32,
    // First place of the stretch, and its length.
    first: u32,
    length: u32,
}

// The stretch of one of so many invocations.
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
