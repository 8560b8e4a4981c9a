//! Views that leave the way open: answered at once, by any worker, by the offer that costs least.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::frame::{Provenance, Reason};
use argus_scene::{
    Camera, Detail, FrameSource, Holes, Output, Outputs, Plan, PlanRequest, Preset, SampleId, SceneState,
    View, Visibility,
};
use glam::DVec3;

use super::sim::Sim;
use crate::core::market::source_grid::POINTS;
use crate::core::quality::Cost;
use crate::core::*;

/// Two workers that warp, with the measured cost of views from triangles.
pub(super) fn measured(direct_ms: f64) -> Sim {
    let mut sim = Sim::new(Config::default());
    for name in ["a", "b"] {
        let id = sim.join(name);
        let report = &mut sim.workers.get_mut(&id).unwrap().report;
        let cost = |fixed_ms| Some(Cost { fixed_ms, ms_per_megapixel: 0.0 });
        (report.direct_cost, report.frame_cost) = (cost(direct_ms), cost(0.1 * direct_ms));
        report.warp_cost = report.frame_cost;
    }
    sim.report_all();
    sim
}

pub(super) fn view() -> View {
    let camera = Camera::look_at(DVec3::new(0.5, 1.0, 0.7), DVec3::new(5.0, 1.0, 0.7));
    View::new(camera, [200, 150], PlanRequest::default())
}

pub(super) fn ask(sim: &mut Sim, view: &View) -> ViewId {
    ask_after(sim, view, None)
}

/// Requests the next view of a session.
pub(super) fn ask_after(sim: &mut Sim, view: &View, last: Option<LastView>) -> ViewId {
    let view_id = ViewId(sim.next);
    sim.next += 1;
    let (client, view, last) = ("a client".into(), Box::new(view.clone()), last.map(Box::new));
    sim.step(Event::Requested { view_id, client, view, deadline: None, last });
    view_id
}

/// A worker reports that it holds a source at the eye of a view, five metres before a wall.
fn hold(sim: &mut Sim, worker: WorkerId, view: &View, samples_per_pixel: u32) -> FrameSource {
    let View { camera, width, height, .. } = *view;
    let source = FrameSource { camera, width, height, samples_per_pixel, band_rows: 0, light: None };
    let held = HeldSource {
        id: SampleId { version: SampleId::FRAMES, camera: source.number() },
        source,
        state: SceneState::default(),
        visibility: Visibility::default(),
        ranges: Arc::from([0.2; POINTS]),
        bought: false,
        render_ms: 0.0,
    };
    let report = &mut sim.workers.get_mut(&worker).unwrap().report;
    report.sources = Some(SourceNews { whole: false, added: vec![held], dropped: Vec::new() });
    sim.report(worker);
    sim.workers.get_mut(&worker).unwrap().report.sources = None;
    source
}

/// Asks for views far from all others, until time is scarce.
fn press(sim: &mut Sim) {
    for _ in 0..100 {
        let view_id = ask(sim, &far_away());
        sim.answer_taking(view_id, 40.0);
    }
}

/// A view that no source shows.
fn far_away() -> View {
    let camera = Camera::look_at(DVec3::new(-9.0, 1.0, -9.0), DVec3::new(-9.0, 1.0, -20.0));
    View { camera, ..view() }
}

fn ids(sim: &Sim) -> [WorkerId; 2] {
    let mut ids = sim.workers.keys().copied();
    [ids.next().unwrap(), ids.next().unwrap()]
}

fn reason(sim: &Sim, view_id: ViewId) -> Reason {
    sim.orders[&view_id].decision.unwrap().reason
}

fn frames(sim: &Sim, view_id: ViewId) -> Vec<FrameSource> {
    sim.orders[&view_id].plan.frames().to_vec()
}

/// The shell's memory of a view that was answered as ordered.
fn remembered(sim: &Sim, view: &View, view_id: ViewId) -> LastView {
    let order = &sim.orders[&view_id];
    let scene = sim.core.set().scene;
    let provenance = Provenance::of_plan(scene, order.state, order.plan.clone());
    LastView { view: view.clone(), provenance, reason: order.decision.unwrap().reason }
}

#[test]
fn a_view_without_a_source_near_it_is_rendered_from_triangles_by_any_worker_at_once() {
    let mut sim = measured(40.0);
    let workers: Vec<WorkerId> = (0..2)
        .map(|_| {
            let view_id = ask(&mut sim, &view());
            assert_eq!(
                (&sim.orders[&view_id].plan, reason(&sim, view_id)),
                (&Plan::direct(1), Reason::NoSamples)
            );
            sim.orders[&view_id].worker
        })
        .collect();
    assert_ne!(workers[0], workers[1], "the idle worker takes the second");
}

#[test]
fn a_source_at_the_viewers_eye_is_warped_and_its_holder_asked() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    let source = hold(&mut sim, b, &view(), 1);
    let view_id = ask(&mut sim, &view());
    assert_eq!((frames(&sim, view_id), sim.orders[&view_id].worker), (vec![source], b));
    assert_eq!(reason(&sim, view_id), Reason::Soonest);
    assert_eq!(sim.orders[&view_id].fallback.as_ref().unwrap().plan, Plan::direct(1));
}

#[test]
fn a_busy_holder_lends_its_source_to_an_idle_worker() {
    let mut sim = measured(400.0);
    let [a, b] = ids(&sim);
    let source = hold(&mut sim, b, &view(), 1);
    // Views from triangles that only the holder may have.
    sim.workers.get_mut(&a).unwrap().report.leaving = true;
    sim.report(a);
    (0..4).for_each(|_| _ = ask(&mut sim, &far_away()));
    sim.workers.get_mut(&a).unwrap().report.leaving = false;
    sim.report(a);
    let view_id = ask(&mut sim, &view());
    let order = &sim.orders[&view_id];
    assert_eq!((order.worker, frames(&sim, view_id)), (a, vec![source]));
    let sources = &order.sources;
    assert_eq!(sources.len(), 1);
    assert_eq!((sources[0].addresses.clone(), sources[0].dispensable), (vec![sim.address(b)], true));
}

#[test]
fn a_source_of_another_state_or_of_a_lost_worker_serves_no_view() {
    let mut sim = measured(40.0);
    let [a, b] = ids(&sim);
    hold(&mut sim, b, &view(), 1);
    sim.leave(b);
    let view_id = ask(&mut sim, &view());
    assert_eq!(frames(&sim, view_id), []);
    hold(&mut sim, a, &view(), 1);
    sim.core.move_nodes(1, &[1]);
    let view_id = ask(&mut sim, &view());
    assert_eq!(frames(&sim, view_id), []);
}

#[test]
fn planes_other_than_colour_supersampling_and_round_lenses_are_from_triangles() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    hold(&mut sim, b, &view(), 4);
    let supersampled = PlanRequest { supersampling: Some(2), ..PlanRequest::default() };
    for other in [
        View { outputs: Outputs::COLOR.with(Output::Depth), ..view() },
        View { plan: supersampled, ..view() },
    ] {
        let view_id = ask(&mut sim, &other);
        assert!(matches!(sim.orders[&view_id].plan, Plan::Direct { .. }), "{other:?}");
    }
}

#[test]
fn an_exact_view_guesses_no_pixel_and_has_four_samples_a_pixel() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    let plan = PlanRequest { preset: Some(Preset::Exact), ..PlanRequest::default() };
    let exact = View { plan, ..view() };
    hold(&mut sim, b, &exact, 4);
    let view_id = ask(&mut sim, &exact);
    // Its time is worth nothing, so that triangles win.
    assert_eq!(sim.orders[&view_id].plan, Plan::direct(4));
    press(&mut sim);
    for _ in 0..30 {
        let view_id = ask(&mut sim, &exact);
        match &sim.orders[&view_id].plan {
            Plan::Direct { samples_per_pixel, detail, .. } => {
                assert_eq!((*samples_per_pixel, *detail), (4, Detail::Full));
            }
            Plan::Warp(warp) => assert_eq!((warp.holes, warp.supersampling), (Holes::Trace, 2)),
        }
    }
}

#[test]
fn a_viewer_at_rest_gets_the_exact_view_and_keeps_it() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    hold(&mut sim, b, &view(), 1);
    let moving = ask(&mut sim, &view());
    assert_eq!(frames(&sim, moving).len(), 1);
    let last = remembered(&sim, &view(), moving);
    sim.answer_taking(moving, 4.0);
    let at_rest = ask_after(&mut sim, &view(), Some(last));
    assert_eq!((&sim.orders[&at_rest].plan, reason(&sim, at_rest)), (&Plan::direct(1), Reason::Upgrade));
    let last = remembered(&sim, &view(), at_rest);
    sim.answer_taking(at_rest, 40.0);
    let again = ask_after(&mut sim, &view(), Some(last));
    assert_eq!((&sim.orders[&again].plan, reason(&sim, again)), (&Plan::direct(1), Reason::Kept));
}

#[test]
fn a_deadline_removes_offers_that_end_after_it_and_is_labelled_if_none_is_left() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    let within = |deadline_ms| View {
        plan: PlanRequest {
            deadline_ms: Some(deadline_ms),
            preset: Some(Preset::Exact),
            ..PlanRequest::default()
        },
        ..view()
    };
    hold(&mut sim, b, &view(), 4);
    let in_time = ask(&mut sim, &within(1000.0));
    assert_eq!(sim.orders[&in_time].plan, Plan::direct(4));
    sim.answer_taking(in_time, 40.0);
    let late = ask(&mut sim, &within(0.001));
    assert_eq!(reason(&sim, late), Reason::TimeFirst);
}

#[test]
fn while_time_is_scarce_less_detail_is_an_offer_and_never_before() {
    let mut sim = measured(40.0);
    let calm = ask(&mut sim, &view());
    assert_eq!(sim.orders[&calm].plan, Plan::direct(1));
    press(&mut sim);
    let details: Vec<Detail> = (0..40)
        .filter_map(|_| {
            let view_id = ask(&mut sim, &view());
            match sim.orders.get(&view_id)?.plan {
                Plan::Direct { detail, .. } => Some(detail),
                Plan::Warp(_) => None,
            }
        })
        .collect();
    assert!(details.iter().any(|detail| *detail != Detail::Full), "{details:?}");
}

#[test]
fn a_retried_view_is_planned_anew_for_another_worker() {
    let mut sim = measured(40.0);
    let [a, b] = ids(&sim);
    hold(&mut sim, b, &view(), 1);
    let view_id = ask(&mut sim, &view());
    let first = sim.orders[&view_id].clone();
    assert_eq!(first.worker, b);
    let report = &mut sim.workers.get_mut(&b).unwrap().report;
    let dropped = vec![SampleId { version: SampleId::FRAMES, camera: first.plan.frames()[0].number() }];
    report.sources = Some(SourceNews { whole: false, added: Vec::new(), dropped });
    sim.report(b);
    sim.step(Event::Failed { view_id, attempt: first.attempt, failure: Failure::TryElsewhere });
    assert_eq!((sim.orders[&view_id].worker, &sim.orders[&view_id].plan), (a, &Plan::direct(1)));
}

#[test]
fn what_a_new_leader_is_told_of_sources_replaces_what_was_known() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    hold(&mut sim, b, &view(), 1);
    assert_eq!(sim.core.status().priced().sources, 1);
    let report = &mut sim.workers.get_mut(&b).unwrap().report;
    report.sources = Some(SourceNews { whole: true, added: Vec::new(), dropped: Vec::new() });
    sim.report(b);
    assert_eq!(sim.core.status().priced().sources, 0);
}

#[test]
fn probes_teach_what_warps_err_in_this_scene() {
    let mut sim = measured(40.0);
    let [_, b] = ids(&sim);
    hold(&mut sim, b, &view(), 1);
    let mut probed = 0;
    for _ in 0..400 {
        sim.now = sim.now.after(Duration::from_millis(40));
        let view_id = ask(&mut sim, &view());
        let order = sim.orders[&view_id].clone();
        sim.answer_taking(view_id, 4.0);
        if let Some(others) = &order.probe {
            probed += 1;
            let excess = |plan: &Plan| match plan {
                Plan::Direct { detail: Detail::Full, .. } => 0.0,
                Plan::Direct { .. } => 0.05,
                Plan::Warp(_) => 0.2,
            };
            let excess = std::iter::once(&order.plan).chain(others).map(excess).collect();
            let result = ProbeResult { view_id, attempt: order.attempt, excess };
            sim.workers.get_mut(&b).unwrap().report.probes = vec![result];
            sim.report(b);
            sim.workers.get_mut(&b).unwrap().report.probes = Vec::new();
        }
    }
    assert!((2..40).contains(&probed), "{probed} of 400");
    assert!(sim.core.status().priced().probes >= probed);
    let view_id = ask(&mut sim, &view());
    assert_eq!(reason(&sim, view_id), Reason::SamplesFallShort, "warps err by more than their time is worth");
}
