//! The ways in which the demo's views were answered.

use argus_scene::{Detail, Frame, Plan};

/// Names of the kinds of frames, from the most costly: rendered from triangles in full, with few rays of light, at half or at a
/// quarter of the size; warped from recent frames; warped from samples.
pub(crate) const KINDS: [&str; 6] = ["full", "few rays", "half", "quarter", "from frames", "from samples"];

/// The position of a frame's kind in [`KINDS`].
pub(crate) fn kind_of(frame: &Frame) -> usize {
    match &frame.provenance.plan {
        Plan::Direct { detail: Detail::Full, .. } => 0,
        Plan::Direct { detail: Detail::FewRays, .. } => 1,
        Plan::Direct { detail: Detail::Half | Detail::HalfFewRays, .. } => 2,
        Plan::Direct { detail: Detail::Quarter, .. } => 3,
        Plan::Warp(warp) if !warp.frames.is_empty() => 4,
        Plan::Warp(_) => 5,
    }
}
