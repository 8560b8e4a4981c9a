//! Tests of the sequence of a session's frames, as offers change.

use argus_scene::rig::Coverage;
use argus_scene::{Camera, PlanRequest, Preset, SceneHash, SceneState, Warp};
use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::core::WorkerId;
use crate::core::planner::predicted_excess;

const FULL: Coverage = Coverage { covered: 1.0, fine: 1.0 };
const COARSE: Coverage = Coverage { covered: 1.0, fine: 0.5 };

/// An offer from triangles.
fn direct(render_ms: f64) -> Offer {
    Offer {
        worker: WorkerId(1),
        tie_break: (0, 0),
        plan: Plan::direct(1),
        wait_ms: 0.0,
        render_ms: Some(render_ms),
        excess: 0.0,
        meets_coverage: true,
        repeats: false,
    }
}

/// An offer from one camera's sample.
fn warp(index: u64, render_ms: f64, coverage: Coverage) -> Offer {
    let samples = vec![SampleId { version: 0, camera: index }];
    let (excess, meets_coverage) = predicted_excess(Some(coverage), 1.0);
    let plan = Plan::Warp(Warp { samples, ..Warp::default() });
    Offer { worker: WorkerId(2), plan, excess, meets_coverage, ..direct(render_ms) }
}

fn waiting(wait_ms: f64, offer: Offer) -> Offer {
    Offer { wait_ms, ..offer }
}

/// A viewer's session, and the shell's memory of it.
struct Session {
    now: Duration,
    view: View,
    last: Option<LastView>,
    changed: Option<Duration>,
}

impl Session {
    fn new(plan: PlanRequest) -> Self {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let view = View::new(camera, [40, 30], plan);
        Self { now: Duration::ZERO, view, last: None, changed: None }
    }

    fn moves(&mut self) {
        self.view.camera.eye += DVec3::splat(0.01);
    }

    /// The plan and the reason of the next frame, `ms` after the previous one.
    fn frame(&mut self, ms: u64, offers: &[Offer]) -> (Plan, Reason) {
        self.now += Duration::from_millis(ms);
        let since_change = self.changed.map(|changed| self.now - changed);
        let last = self.last.clone().map(|last| LastView { since_change, ..last });
        let memory = last.and_then(|last| Memory::of(&self.view, last));
        let is_repeated = |offer: &Offer| {
            memory
                .as_ref()
                .is_some_and(|memory| memory.is_repeated_by(&offer.plan, SceneState::of_epoch(0), "device"))
        };
        let offers = offers.iter().map(|offer| Offer { repeats: is_repeated(offer), ..offer.clone() });
        let aim = Aim::of(&self.view.plan);
        let (offer, decision) = choose_after(offers.collect(), &aim, memory.as_ref()).unwrap();
        let is_direct = |plan: &Plan| matches!(plan, Plan::Direct { .. });
        if self.last.as_ref().is_some_and(|last| is_direct(&last.provenance.plan) != is_direct(&offer.plan)) {
            self.changed = Some(self.now);
        }
        let (scene, device) = (SceneHash([1; 32]), "device".to_owned());
        let plan = offer.plan.clone();
        let provenance = Provenance {
            scene,
            state: SceneState::default(),
            plan,
            specification: None,
            device,
            history: false,
        };
        let (view, reason) = (self.view.clone(), decision.reason);
        self.last = Some(LastView { view, provenance, reason, since_change: None });
        (offer.plan, decision.reason)
    }
}

/// Offers from triangles and from samples that swap their times with each frame.
fn alternating(frame: usize) -> [Offer; 2] {
    let (a, b) = if frame.is_multiple_of(2) { (10.0, 9.0) } else { (9.0, 10.0) };
    [direct(a), warp(7, b, FULL)]
}

#[test]
fn a_standing_camera_gets_one_plan_while_cheap_offers_alternate() {
    for preset in [None, Some(Preset::Balanced), Some(Preset::Interactive)] {
        let mut session = Session::new(PlanRequest { preset, ..PlanRequest::default() });
        let (plan, _) = session.frame(0, &alternating(1));
        assert_eq!(plan, direct(0.0).plan);
        for frame in 2..100_usize {
            let reason = if frame.is_multiple_of(2) { Reason::Kept } else { Reason::Soonest };
            assert_eq!(session.frame(50, &alternating(frame)), (plan.clone(), reason), "frame {frame}");
        }
    }
}

#[test]
fn a_standing_camera_that_began_from_samples_is_upgraded_once_and_then_stays() {
    let mut session = Session::new(PlanRequest::default());
    assert_eq!(session.frame(0, &alternating(0)).0, warp(7, 0.0, FULL).plan);
    assert_eq!(session.frame(50, &alternating(1)), (direct(0.0).plan, Reason::Upgrade));
    for frame in 2..100 {
        assert_eq!(session.frame(50, &alternating(frame)).0, direct(0.0).plan, "frame {frame}");
    }
}

#[test]
fn a_moving_camera_changes_its_way_at_most_once_in_two_seconds() {
    let mut session = Session::new(PlanRequest::default());
    let (mut before, _) = session.frame(0, &alternating(0));
    let mut changes = Vec::new();
    for frame in 1..200 {
        session.moves();
        let (plan, _) = session.frame(50, &alternating(frame));
        if plan != before {
            changes.push(session.now);
        }
        before = plan;
    }
    assert!(changes.len() > 2, "ten seconds have room for some: {changes:?}");
    assert!(changes.windows(2).all(|pair| pair[1] - pair[0] >= CALM), "{changes:?}");
}

#[test]
fn a_lost_sample_lets_the_way_change_at_once() {
    for moves in [false, true] {
        let mut session = Session::new(PlanRequest::default());
        session.frame(0, &[direct(10.0)]);
        session.moves();
        let (plan, _) = session.frame(50, &[direct(10.0), warp(7, 5.0, FULL)]);
        assert!(matches!(plan, Plan::Warp(_)));
        if moves {
            session.moves();
        }
        assert_eq!(session.frame(50, &[direct(10.0)]), (direct(0.0).plan, Reason::NoSamples));
        // It was the second change: the third one waits.
        session.moves();
        let both = [direct(10.0), warp(7, 5.0, FULL)];
        assert_eq!(session.frame(50, &both), (direct(0.0).plan, Reason::Kept));
        session.moves();
        assert_eq!(session.frame(2000, &both), (warp(7, 0.0, FULL).plan, Reason::Soonest));
    }
}

#[test]
fn a_way_is_left_at_once_if_its_offers_exceed_the_bound() {
    let mut session = Session::new(PlanRequest::default());
    session.frame(0, &[direct(10.0)]);
    for coverage in [FULL, COARSE] {
        session.moves();
        let (plan, reason) = session.frame(50, &[direct(10.0), warp(7, 5.0, coverage)]);
        let expected = if coverage == FULL { Reason::Soonest } else { Reason::SamplesFallShort };
        assert_eq!((matches!(plan, Plan::Warp(_)), reason), (coverage == FULL, expected));
    }
}

#[test]
fn a_standing_cameras_frame_is_upgraded_for_less_error() {
    let mut session = Session::new(PlanRequest::default());
    let fair = Coverage { covered: 1.0, fine: 0.96 };
    let nearly = Coverage { covered: 1.0, fine: 0.97 };
    session.frame(0, &[direct(50.0), warp(7, 9.0, fair)]);
    // Earlier, but hardly better: only the change would be visible.
    let (plan, reason) = session.frame(50, &[direct(50.0), warp(7, 9.0, fair), warp(8, 5.0, nearly)]);
    assert_eq!((plan, reason), (warp(7, 0.0, fair).plan, Reason::Kept));
    let better = [direct(50.0), warp(7, 9.0, fair), warp(9, 5.0, FULL)];
    assert_eq!(session.frame(50, &better), (warp(9, 0.0, FULL).plan, Reason::Upgrade));
    assert_eq!(session.frame(50, &better).0, warp(9, 0.0, FULL).plan);
}

#[test]
fn an_upgrade_by_another_way_waits_until_the_way_has_been_calm() {
    let mut session = Session::new(PlanRequest::default());
    session.frame(0, &[direct(10.0)]);
    session.moves();
    session.frame(50, &[direct(10.0), warp(7, 5.0, FULL)]);
    let now_direct_is_soonest = [direct(4.0), warp(7, 5.0, FULL)];
    assert_eq!(session.frame(1900, &now_direct_is_soonest).1, Reason::Kept);
    assert_eq!(session.frame(100, &now_direct_is_soonest), (direct(0.0).plan, Reason::Upgrade));
}

#[test]
fn if_repeating_takes_too_long_an_earlier_frame_exceeds_the_bound_for_a_while() {
    let mut session = Session::new(PlanRequest::default());
    let at = |wait| [waiting(wait, direct(40.0)), waiting(wait, warp(7, 4.0, COARSE))];
    assert_eq!(session.frame(0, &at(0.0)), (direct(0.0).plan, Reason::SamplesFallShort));
    let coarse = warp(7, 0.0, COARSE).plan;
    assert_eq!(session.frame(50, &at(1000.0)), (coarse.clone(), Reason::TimeFirst));
    assert_eq!(session.frame(50, &at(0.0)), (coarse.clone(), Reason::TimeFirst), "for two seconds");
    session.moves();
    assert_eq!(session.frame(50, &at(1000.0)), (coarse, Reason::TimeFirst));
    assert_eq!(session.frame(2000, &at(0.0)), (direct(0.0).plan, Reason::Upgrade));
}

#[test]
fn a_different_request_is_answered_as_the_first_one() {
    let mut session = Session::new(PlanRequest::default());
    session.frame(0, &alternating(0));
    session.view.plan.preset = Some(Preset::Exact);
    let (plan, reason) = session.frame(50, &alternating(0));
    assert_eq!((plan, reason), (direct(0.0).plan, Reason::SamplesFallShort));
}

#[test]
fn another_size_epoch_or_device_repeats_nothing() {
    let mut session = Session::new(PlanRequest::default());
    let (plan, _) = session.frame(0, &[warp(7, 5.0, FULL)]);
    let last = session.last.clone().unwrap();
    let memory = Memory::of(&session.view, last.clone()).unwrap();
    assert!(memory.is_repeated_by(&plan, SceneState::of_epoch(0), "device"));
    assert!(!memory.is_repeated_by(&plan, SceneState::of_epoch(1), "device"));
    assert!(!memory.is_repeated_by(&plan, SceneState::of_epoch(0), "another device"));
    assert!(!memory.is_repeated_by(&direct(1.0).plan, SceneState::of_epoch(0), "device"));
    let larger = View { width: 41, ..session.view.clone() };
    let memory = Memory::of(&larger, last).unwrap();
    assert!(!memory.is_repeated_by(&plan, SceneState::of_epoch(0), "device"));
    assert_eq!(memory.samples().count(), 0);
}

#[test]
fn without_offers_nothing_is_chosen() {
    let mut session = Session::new(PlanRequest::default());
    session.frame(0, &alternating(0));
    let memory = Memory::of(&session.view, session.last.clone().unwrap());
    assert_eq!(choose_after(Vec::new(), &Aim::of(&session.view.plan), memory.as_ref()), None);
}

fn any_offers() -> impl Strategy<Value = (bool, u64, Vec<Offer>)> {
    let costs = (1.0..50.0_f64, 1.0..50.0_f64, 0.0..100.0_f64);
    (any::<bool>(), 20_u64..400, costs, 0_u64..3).prop_map(
        |(moves, ms, (triangles, samples, wait), index)| {
            (moves, ms, vec![waiting(wait, direct(triangles)), warp(index, samples, FULL)])
        },
    )
}

proptest! {
    #[test]
    fn ways_change_at_most_once_in_two_seconds_and_standing_frames_only_for_less_error(
        frames in proptest::collection::vec(any_offers(), 1..60),
    ) {
        let mut session = Session::new(PlanRequest::default());
        let mut before: Option<Plan> = None;
        let mut changed: Option<Duration> = None;
        for (moves, ms, offers) in frames {
            if moves {
                session.moves();
            }
            let (plan, reason) = session.frame(ms, &offers);
            if let Some(before) = &before {
                let is_held = offers.iter().any(|offer| offer.plan == *before);
                prop_assert!(moves || !is_held || plan == *before || reason == Reason::Upgrade);
                if matches!(before, Plan::Direct { .. }) != matches!(plan, Plan::Direct { .. }) {
                    prop_assert!(changed.is_none_or(|at| session.now - at >= CALM));
                    changed = Some(session.now);
                }
            }
            before = Some(plan);
        }
    }
}
