//! Views that are warped from recent direct frames of their worker.

use argus_scene::frame::Reason;
use argus_scene::{Camera, FrameSource, Plan, SceneState, View};
use glam::DVec3;

use super::open::{ask, ask_after, is_direct, measured, view};
use super::sim::Sim;
use crate::core::quality::Cost;
use crate::core::*;

/// Two workers that can warp frames in 4 ms, and render a view in 40 ms.
fn warping() -> Sim {
    let mut sim = measured(40.0, 100.0);
    for id in sim.workers.keys().copied().collect::<Vec<_>>() {
        let report = &mut sim.workers.get_mut(&id).unwrap().report;
        report.frame_cost = Some(Cost { fixed_ms: 4.0, ms_per_megapixel: 0.0 });
        sim.report(id);
    }
    sim
}

/// The usual view, moved by metres to its right.
fn aside(metres: f64) -> View {
    let View { camera, .. } = view();
    let step = DVec3::Z * metres;
    View { camera: Camera { eye: camera.eye + step, target: camera.target + step, ..camera }, ..view() }
}

/// Asks for a view, and answers it. Returns its order.
fn answered(sim: &mut Sim, view: &View) -> Order {
    let view_id = ask(sim, view);
    let order = sim.orders[&view_id].clone();
    sim.answer(view_id);
    order
}

/// The frames that an order warps: the eyes' distances to the right.
fn sources(order: &Order) -> Vec<f64> {
    let metres = |frame: &FrameSource| frame.camera.eye.z - view().camera.eye.z;
    order.plan.frames().iter().map(|frame| (metres(frame) * 1e3).round() * 1e-3).collect()
}

#[test]
fn a_view_near_a_direct_frame_is_warped_from_it_by_the_worker_that_keeps_it() {
    let mut sim = warping();
    let first = answered(&mut sim, &aside(0.0));
    assert!(matches!(first.plan, Plan::Direct { .. }) && first.keeps_frame);
    for metres in [0.05, 0.1, 0.2] {
        let order = answered(&mut sim, &aside(metres));
        assert_eq!(order.worker, first.worker, "{metres} m");
        assert!(order.fallback.is_some(), "{metres} m");
        // The frames between were warped themselves, and are no sources.
        assert_eq!(sources(&order), [0.0], "{metres} m");
        assert!(
            order.sources.is_empty() && order.tracers.is_empty(),
            "it needs no sample and no other worker"
        );
        assert_eq!(order.decision.unwrap().reason, Reason::Soonest);
    }
}

#[test]
fn without_a_measured_cost_no_frame_is_kept_or_warped() {
    let mut sim = measured(40.0, 100.0);
    assert!(!answered(&mut sim, &aside(0.0)).keeps_frame);
    assert!(matches!(answered(&mut sim, &aside(0.05)).plan, Plan::Direct { .. }));
}

#[test]
fn a_view_that_is_rendered_as_fast_as_it_is_warped_is_rendered() {
    let mut sim = warping();
    for id in sim.workers.keys().copied().collect::<Vec<_>>() {
        let report = &mut sim.workers.get_mut(&id).unwrap().report;
        report.direct_cost = Some(Cost { fixed_ms: 5.0, ms_per_megapixel: 0.0 });
        sim.report(id);
    }
    assert!(!answered(&mut sim, &aside(0.0)).keeps_frame);
    assert!(!is_warped(&answered(&mut sim, &aside(0.05))));
}

#[test]
fn a_walk_gets_a_new_direct_frame_whenever_the_last_one_is_too_far_away() {
    let mut sim = warping();
    let orders: Vec<Order> =
        (0..100).map(|step| answered(&mut sim, &aside(0.05 * f64::from(step)))).collect();
    let direct: Vec<usize> =
        (0..100).filter(|step| matches!(orders[*step].plan, Plan::Direct { .. })).collect();
    assert!((4..15).contains(&direct.len()), "{direct:?}");
    let gaps: Vec<usize> = direct.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(gaps.iter().all(|gap| (7..30).contains(gap)), "{gaps:?}");
    for order in orders.iter().filter(|order| order.fallback.is_some()) {
        let excess = order.decision.unwrap().excess;
        assert!((0.013..=0.03).contains(&excess), "{excess}");
    }
}

#[test]
fn a_view_that_shares_nothing_with_a_frame_is_rendered_from_triangles() {
    let mut sim = warping();
    answered(&mut sim, &aside(0.0));
    let View { camera, .. } = view();
    let behind = Camera { target: camera.eye - DVec3::X, ..camera };
    let beside = Camera { target: camera.eye + DVec3::Z, ..camera };
    for camera in [behind, beside] {
        assert!(matches!(answered(&mut sim, &View { camera, ..view() }).plan, Plan::Direct { .. }));
    }
    let larger = View { width: 400, height: 300, ..view() };
    assert!(
        matches!(answered(&mut sim, &larger).plan, Plan::Direct { .. }),
        "its texels would be too coarse"
    );
}

#[test]
fn frames_of_another_light_serve_no_view() {
    let mut sim = warping();
    let first = answered(&mut sim, &aside(0.0));
    let worker = sim.core.workers().get(first.worker).unwrap();
    let state = sim.core.set().version.state;
    assert_eq!(worker.frames().showing(state).count(), 1);
    let later = SceneState { epoch: state.epoch + 1, ..state };
    assert_eq!(worker.frames().showing(later).count(), 0);
}

#[test]
fn the_direct_frame_that_replaces_a_poor_one_becomes_a_source() {
    let mut sim = warping();
    answered(&mut sim, &aside(0.0));
    let view_id = ask(&mut sim, &aside(0.1));
    let order = sim.orders[&view_id].clone();
    assert_eq!(sources(&order), [0.0]);
    let (attempt, uncovered, ms) = (order.attempt, Some(0), Some(44.0));
    sim.orders.remove(&view_id);
    sim.step(Event::Answered { view_id, attempt, uncovered, ms, fell_short: true });
    assert_eq!(sources(&answered(&mut sim, &aside(0.1))), [0.1], "the poor frame is forgotten");
}

#[test]
fn a_camera_that_stands_still_gets_its_own_direct_frame() {
    let mut sim = warping();
    answered(&mut sim, &aside(0.0));
    let last = |view: &View, order: &Order| {
        let (scene, device) = (sim_scene(), "device".to_owned());
        let provenance = argus_scene::Provenance {
            scene,
            state: order.state,
            plan: order.plan.clone(),
            specification: None,
            device,
            history: false,
        };
        let reason = order.decision.unwrap().reason;
        LastView { view: view.clone(), provenance, reason, since_change: None }
    };
    let here = aside(0.2);
    let mut order = answered(&mut sim, &here);
    let mut reasons = vec![(is_warped(&order), order.decision.unwrap().reason)];
    for _ in 0..3 {
        let view_id = ask_after(&mut sim, &here, Some(last(&here, &order)));
        order = sim.orders[&view_id].clone();
        assert_eq!(is_direct(&sim, view_id), !is_warped(&order));
        sim.answer(view_id);
        reasons.push((is_warped(&order), order.decision.unwrap().reason));
    }
    let expected =
        [(true, Reason::Soonest), (false, Reason::Upgrade), (false, Reason::Kept), (false, Reason::Kept)];
    assert_eq!(reasons, expected);
}

#[test]
fn a_lost_worker_leaves_no_frames() {
    let mut sim = warping();
    let first = answered(&mut sim, &aside(0.0));
    sim.leave(first.worker);
    let order = answered(&mut sim, &aside(0.05));
    assert!(order.worker != first.worker && !is_warped(&order));
}

fn is_warped(order: &Order) -> bool {
    !order.plan.frames().is_empty()
}

fn sim_scene() -> argus_scene::SceneHash {
    crate::core::tests::set_info().scene
}
