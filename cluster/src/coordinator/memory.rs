//! A session's memory of its last answered view, for the planner.
//!
//! The provenance comes from the frame's header. For a redirected frame, the worker's sealed receipt carries the
//! header. Without a receipt nothing is remembered.

use argus_proto::v1;
use argus_scene::View;
use argus_scene::frame::{Decision, Provenance, Reason};

use crate::core::LastView;

/// The last answered view of a session, if it is known.
#[derive(Debug, Default)]
pub(super) struct SessionMemory(Option<Remembered>);

#[derive(Debug)]
struct Remembered {
    view: View,
    provenance: Provenance,
    reason: Reason,
}

impl SessionMemory {
    /// Remembers the header of an answered view. A frame without a planner's decision is not remembered.
    pub(super) fn learn(&mut self, view: &View, header: &v1::FrameHeader) {
        let (Some(decision), Some(provenance)) = (header.decision, header.provenance.clone()) else { return };
        let (Ok(decision), Ok(provenance)) = (Decision::try_from(decision), Provenance::try_from(provenance))
        else {
            return;
        };
        // Light is open in the next order: it rises while the camera stands.
        let provenance = Provenance { plan: provenance.plan.clone().with_light(None), ..provenance };
        self.0 = Some(Remembered { view: view.clone(), provenance, reason: decision.reason });
    }

    /// The last view, as the planner needs it.
    pub(super) fn recall(&self) -> Option<Box<LastView>> {
        let Remembered { view, provenance, reason } = self.0.as_ref()?;
        Some(Box::new(LastView { view: view.clone(), provenance: provenance.clone(), reason: *reason }))
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Plan, PlanRequest, SceneHash, SceneState, Warp};
    use glam::DVec3;

    use super::*;

    fn view() -> View {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let plan = PlanRequest::default();
        View::new(camera, [40, 30], plan)
    }

    fn header(plan: Plan) -> v1::FrameHeader {
        let scene = SceneHash([1; 32]);
        let device = "device".to_owned();
        let provenance = Provenance {
            scene,
            state: SceneState::default(),
            plan,
            specification: None,
            device,
            history: false,
        };
        let decision = Decision { reason: Reason::Soonest, wait_ms: 0.0, render_ms: 1.0, excess: 0.0 };
        v1::FrameHeader {
            provenance: Some((&provenance).into()),
            decision: Some(decision.into()),
            ..v1::FrameHeader::default()
        }
    }

    fn direct() -> v1::FrameHeader {
        header(Plan::direct(1))
    }

    fn warp() -> v1::FrameHeader {
        let samples = vec![argus_scene::SampleId { version: 0, camera: 7 }];
        header(Plan::Warp(Warp { samples, ..Warp::default() }))
    }

    #[test]
    fn frames_without_a_valid_decision_are_not_remembered() {
        let mut memory = SessionMemory::default();
        memory.learn(&view(), &direct());
        let before = memory.recall();
        assert!(before.is_some());
        let requested = v1::FrameHeader { decision: None, ..warp() };
        let unknown = v1::Decision { reason: 99, ..v1::Decision::default() };
        let wrong = v1::FrameHeader { decision: Some(unknown), ..warp() };
        let of_nothing = v1::FrameHeader { provenance: None, ..warp() };
        for header in [requested, wrong, of_nothing] {
            memory.learn(&view(), &header);
            assert_eq!(memory.recall(), before);
        }
    }
}
