//! State of a view that leaves the way open.

use argus_scene::frame::Decision;
use argus_scene::rig::CoverageEstimate;
use argus_scene::{FrameSource, View};

use super::explicit_plan::samples_per_pixel;
use super::planner::Aim;
use super::session_memory::Memory;
use crate::core::event::{Fallback, LastView};

/// The direct frame that would answer a view that leaves the way open.
pub(super) fn direct_frame(view: &View) -> FrameSource {
    let View { camera, width, height, ref plan, .. } = *view;
    FrameSource {
        camera,
        width,
        height,
        samples_per_pixel: samples_per_pixel(plan),
        band_rows: 0,
        light: None,
    }
}

/// What the planner needs to know about one view.
#[derive(Debug, Clone)]
pub(super) struct OpenView {
    /// The direct frame that would answer it.
    pub(super) direct: FrameSource,
    pub(super) aim: Aim,
    /// An estimate of the view, if one was made.
    pub(super) estimate: Option<Box<CoverageEstimate>>,
    /// The session's memory of its last view.
    pub(super) memory: Option<Memory>,
    /// The planner's latest decision.
    pub(super) decision: Option<Decision>,
    /// What replaces a frame from samples that is not good enough, by that decision.
    pub(super) fallback: Option<Fallback>,
}

impl OpenView {
    /// Makes the state; `None` for a view that is pinned or whose request names the way.
    pub(super) fn of(
        view: &View,
        estimate: Option<Box<CoverageEstimate>>,
        last: Option<Box<LastView>>,
    ) -> Option<Box<Self>> {
        let open = view.leaves_way_open();
        let direct = direct_frame(view);
        let aim = Aim::of(&view.plan);
        let memory = last.and_then(|last| Memory::of(view, *last));
        open.then(|| Box::new(Self { direct, aim, estimate, memory, decision: None, fallback: None }))
    }
}
