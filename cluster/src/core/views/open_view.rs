//! What is known of a view whose request leaves open how it is answered.

use argus_scene::View;
use argus_scene::frame::Decision;
use argus_scene::rig::Survey;

use super::plan::samples_per_pixel;
use super::planner::Aim;
use super::session_memory::Memory;
use crate::core::event::LastView;

/// What the planner goes by for one view.
#[derive(Debug, Clone)]
pub(super) struct OpenView {
    /// Of a direct view.
    pub(super) samples_per_pixel: u32,
    pub(super) aim: Aim,
    /// What it will show, where that is known.
    pub(super) survey: Option<Box<Survey>>,
    /// What its session remembers.
    pub(super) memory: Option<Memory>,
    /// How it was last decided to be answered.
    pub(super) decision: Option<Decision>,
}

impl OpenView {
    /// Of a view that is not pinned and whose request leaves the way open.
    pub(super) fn of(
        view: &View,
        survey: Option<Box<Survey>>,
        last: Option<Box<LastView>>,
    ) -> Option<Box<Self>> {
        let open = view.pin.is_none() && view.plan.leaves_way_open();
        let samples_per_pixel = samples_per_pixel(&view.plan);
        let aim = Aim::of(&view.plan);
        let memory = last.and_then(|last| Memory::of(view, *last));
        open.then(|| Box::new(Self { samples_per_pixel, aim, survey, memory, decision: None }))
    }
}
