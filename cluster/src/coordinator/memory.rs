//! A session's memory of its last answered view, for the planner.
//!
//! The provenance comes from the frame's header. For a redirected frame, the worker's sealed receipt carries the
//! header. Without a receipt nothing is remembered.

use argus_proto::v1;
use argus_scene::View;
use argus_scene::frame::{Decision, Provenance, Reason};
use tokio::time::Instant;

use crate::core::LastView;

/// The last answered view of a session, if it is known.
#[derive(Debug, Default)]
pub(super) struct SessionMemory(Option<Remembered>);

#[derive(Debug)]
struct Remembered {
    view: View,
    provenance: Provenance,
    reason: Reason,
    /// When frames last changed between triangles and samples.
    changed: Option<Instant>,
}

impl SessionMemory {
    /// Remembers the header of an answered view. A frame without a planner's decision is not remembered.
    pub(super) fn learn(&mut self, view: &View, header: &v1::FrameHeader, now: Instant) {
        let (Some(decision), Some(provenance)) = (header.decision, header.provenance.clone()) else { return };
        let (Ok(decision), Ok(provenance)) = (Decision::try_from(decision), Provenance::try_from(provenance))
        else {
            return;
        };
        // Light is open in the next order: it rises while the camera stands.
        let provenance = Provenance { plan: provenance.plan.clone().with_light(None), ..provenance };
        // A view that is warped from direct frames looks like them.
        let needs_samples = |provenance: &Provenance| provenance.plan.needs_samples();
        let changed = self.0.as_ref().and_then(|last| {
            let same = needs_samples(&last.provenance) == needs_samples(&provenance);
            if same { last.changed } else { Some(now) }
        });
        self.0 = Some(Remembered { view: view.clone(), provenance, reason: decision.reason, changed });
    }

    /// The last view, as the planner needs it.
    pub(super) fn recall(&self, now: Instant) -> Option<Box<LastView>> {
        let Remembered { view, provenance, reason, changed } = self.0.as_ref()?;
        let since_change = changed.map(|changed| now.saturating_duration_since(changed));
        let (view, provenance) = (view.clone(), provenance.clone());
        Some(Box::new(LastView { view, provenance, reason: *reason, since_change }))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

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
    fn the_time_since_a_change_of_way_counts_from_the_last_change() {
        let (mut memory, began) = (SessionMemory::default(), Instant::now());
        let at = |secs| began + Duration::from_secs(secs);
        let since = |memory: &SessionMemory, secs| memory.recall(at(secs)).and_then(|last| last.since_change);
        assert_eq!(memory.recall(began), None);
        memory.learn(&view(), &direct(), at(0));
        assert_eq!(since(&memory, 1), None, "the first frame changes nothing");
        memory.learn(&view(), &warp(), at(1));
        memory.learn(&view(), &warp(), at(2));
        assert_eq!(since(&memory, 3), Some(Duration::from_secs(2)));
        memory.learn(&view(), &direct(), at(4));
        assert_eq!(since(&memory, 3), Some(Duration::ZERO), "a clock that seems to go back counts as now");
    }

    #[test]
    fn frames_without_a_valid_decision_are_not_remembered() {
        let (mut memory, now) = (SessionMemory::default(), Instant::now());
        memory.learn(&view(), &direct(), now);
        let before = memory.recall(now);
        let requested = v1::FrameHeader { decision: None, ..warp() };
        let unknown = v1::Decision { reason: 99, ..v1::Decision::default() };
        let wrong = v1::FrameHeader { decision: Some(unknown), ..warp() };
        let of_nothing = v1::FrameHeader { provenance: None, ..warp() };
        for header in [requested, wrong, of_nothing] {
            memory.learn(&view(), &header, now);
            assert_eq!(memory.recall(now), before);
        }
    }
}
