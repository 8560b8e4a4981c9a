//! The ways in which the demo's views were answered.

use argus_scene::{Detail, Frame, Plan};

/// Names of the kinds of frames, from the most costly: rendered from triangles in full, with few rays of light, at half or at a
/// quarter of the size; warped from frames of viewers; warped from samples, those bought at viewers' eyes included.
pub(crate) const KINDS: [&str; 6] = ["full", "few rays", "half", "quarter", "from frames", "from samples"];

/// The columns of a table: each kind's name there, and the kinds that it counts together.
pub(crate) const COLUMNS: [(&str, std::ops::Range<usize>); 4] =
    [("full", 0..1), ("reduced", 1..4), ("frames", 4..5), ("samples", 5..6)];

/// The position of a frame's kind in [`KINDS`].
pub(crate) fn kind_of(frame: &Frame) -> usize {
    match &frame.provenance.plan {
        Plan::Direct { detail: Detail::Full, .. } => 0,
        Plan::Direct { detail: Detail::FewRays, .. } => 1,
        Plan::Direct { detail: Detail::Half | Detail::HalfFewRays, .. } => 2,
        Plan::Direct { detail: Detail::Quarter, .. } => 3,
        Plan::Warp(warp) if !warp.frames.is_empty() && !is_bought(frame) => 4,
        Plan::Warp(_) => 5,
    }
}

/// Whether a kind is warped from sources.
pub(crate) fn is_from_sources(kind: usize) -> bool {
    kind >= 4
}

/// Whether a frame is warped from a source that was rendered for many viewers: one that no view of this size is answered with, since
/// it has a border or several samples a pixel.
pub(crate) fn is_bought(frame: &Frame) -> bool {
    let Plan::Warp(warp) = &frame.provenance.plan else { return false };
    warp.frames.iter().any(|source| {
        source.samples_per_pixel > 1 || [source.width, source.height] != [frame.width, frame.height]
    })
}

/// The group of a kind between which a viewer sees a change: full size, half, quarter, sources.
pub(crate) fn look_of(kind: usize) -> u8 {
    match kind {
        0 | 1 => 0,
        2 => 1,
        3 => 2,
        _ => 3,
    }
}
