//! Views that leave the way open: answered at once, by any worker, in the faster way.

use std::time::Duration;

use argus_scene::frame::{Provenance, Reason};
use argus_scene::rig::{Target, VisibilityQuery};
use argus_scene::{Camera, Plan, PlanRequest, SampleId, View};
use glam::DVec3;

use super::sim::Sim;
use crate::core::quality::Cost;
use crate::core::*;

/// A scene in which every camera sees everything, ten metres from the viewer.
#[derive(Debug)]
struct Open;

impl VisibilityQuery for Open {
    fn best(&self, _: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        candidates.iter().map(|(index, _)| *index).take(count).collect()
    }

    fn sees(&self, _: DVec3, _: DVec3) -> bool {
        true
    }

    fn targets(&self, eye: DVec3, directions: &[DVec3], _: f64) -> Vec<Target> {
        directions.iter().map(|direction| Target::Surface(eye + *direction * 10.0)).collect()
    }

    fn shows(&self, _: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
        vec![true; targets.len()]
    }
}

/// Two workers with measured costs of views, in a scene of cells.
pub(super) fn measured(direct_ms: f64, warp_ms: f64) -> Sim {
    let rig = argus_scene::Rig::Cell { origin: DVec3::ZERO, spacing: 4.0, face: 512 };
    let set = argus_scene::SampleSetInfo { rig, ..crate::core::tests::set_info() };
    let mut sim = Sim::with_set(Config::default(), set);
    sim.direct_ms = 200.0;
    for name in ["a", "b"] {
        let id = sim.join(name);
        let report = &mut sim.workers.get_mut(&id).unwrap().report;
        let cost = |fixed_ms| Some(Cost { fixed_ms, ms_per_megapixel: 0.0 });
        (report.direct_cost, report.warp_cost) = (cost(direct_ms), cost(warp_ms));
    }
    sim.report_all();
    sim
}

pub(super) fn view() -> View {
    let camera = Camera::look_at(DVec3::new(0.5, 1.0, 0.7), DVec3::new(5.0, 1.0, 0.7));
    let plan = PlanRequest::default();
    View::new(camera, [200, 150], plan)
}

/// Requests a view, with its estimate.
pub(super) fn ask(sim: &mut Sim, view: &View) -> ViewId {
    ask_after(sim, view, None)
}

/// Requests the next view of a session.
pub(super) fn ask_after(sim: &mut Sim, view: &View, last: Option<LastView>) -> ViewId {
    let view_id = ViewId(sim.next);
    sim.next += 1;
    let estimate =
        sim.core.estimate_wanted(view, last.as_ref()).map(|wanted| Box::new(wanted.make(view, &Open)));
    if let Some(wanted) = sim.core.camera_set_estimate_wanted(view) {
        let pixels = u64::from(view.width) * u64::from(view.height);
        sim.step(Event::Estimated { pixels, estimate: Box::new(wanted.make(view, &Open)) });
    }
    let (client, view, last) = ("a client".into(), Box::new(view.clone()), last.map(Box::new));
    sim.step(Event::Requested { view_id, client, view, deadline: None, estimate, last });
    view_id
}

/// Lets all workers hold the corners of the viewer's cell.
fn hold(sim: &mut Sim) {
    let set = sim.core.set().clone();
    let ids: Vec<SampleId> = set
        .rig
        .nearest(&view().camera, 8)
        .into_iter()
        .map(|index| SampleId { version: 0, camera: index })
        .collect();
    for id in sim.workers.keys().copied().collect::<Vec<_>>() {
        sim.workers.get_mut(&id).unwrap().report.held = ids.clone();
        sim.report(id);
    }
}

pub(super) fn is_direct(sim: &Sim, view_id: ViewId) -> bool {
    matches!(sim.orders[&view_id].plan, Plan::Direct { .. })
}

#[test]
fn a_view_that_leaves_the_way_open_waits_for_no_sample_and_no_role() {
    let mut sim = measured(40.0, 10.0);
    let view_ids: Vec<ViewId> = (0..6).map(|_| ask(&mut sim, &view())).collect();
    assert!(view_ids.iter().all(|view_id| is_direct(&sim, *view_id)));
    let shares: Vec<usize> = sim
        .workers
        .keys()
        .map(|id| sim.orders.values().filter(|order| order.worker == *id).count())
        .collect();
    assert_eq!(shares, [3, 3], "sampler and compositor alike");
    assert!(sim.orders.values().all(|order| order.sources.is_empty()));
    assert_eq!(sim.orders[&view_ids[0]].decision.unwrap().reason, Reason::NoSamples);
}

#[test]
fn held_samples_are_used_only_if_that_is_faster() {
    for (direct_ms, warp_ms, warped) in [(40.0, 10.0, true), (10.0, 40.0, false)] {
        let mut sim = measured(direct_ms, warp_ms);
        hold(&mut sim);
        let view_id = ask(&mut sim, &view());
        assert_eq!(is_direct(&sim, view_id), !warped, "{direct_ms} {warp_ms}");
        let order = &sim.orders[&view_id];
        let decision = order.decision.unwrap();
        assert_eq!((decision.reason, decision.render_ms), (Reason::Soonest, direct_ms.min(warp_ms)));
        assert_eq!(
            order.fallback.as_ref().map(|fallback| &fallback.plan),
            warped.then_some(&Plan::direct(1))
        );
        // It fetches nothing.
        assert!(order.sources.iter().all(|source| source.dispensable && source.addresses.is_empty()));
    }
}

#[test]
fn samples_too_coarse_for_a_large_view_are_not_used() {
    let mut sim = measured(40.0, 10.0);
    hold(&mut sim);
    let large = View { width: 1920, height: 1440, ..view() };
    let view_id = ask(&mut sim, &large);
    assert!(is_direct(&sim, view_id));
    assert_eq!(sim.orders[&view_id].decision.unwrap().reason, Reason::SamplesFallShort);
}

#[test]
fn a_retried_view_is_planned_anew() {
    let mut sim = measured(40.0, 10.0);
    hold(&mut sim);
    let view_id = ask(&mut sim, &view());
    let first = sim.orders[&view_id].clone();
    // Meanwhile the other worker dropped its samples.
    let other = *sim.workers.keys().find(|id| **id != first.worker).unwrap();
    sim.workers.get_mut(&other).unwrap().report.held.clear();
    sim.report(other);
    sim.step(Event::Failed { view_id, attempt: first.attempt, failure: Failure::TryElsewhere });
    assert_eq!(sim.orders[&view_id].worker, other);
    assert!(is_direct(&sim, view_id));
}

#[test]
fn steady_views_get_samples_rendered_and_then_use_them() {
    let mut sim = measured(40.0, 10.0);
    let mut seconds_until_warped = None;
    for second in 0..60 {
        for _ in 0..4 {
            for _ in 0..5 {
                let view_id = ask(&mut sim, &view());
                if !is_direct(&sim, view_id) {
                    seconds_until_warped.get_or_insert(second);
                }
                sim.answer_taking(view_id, 40.0);
            }
            sim.now = sim.now.after(std::time::Duration::from_millis(250));
            sim.report_all();
            sim.step(Event::Tick);
        }
    }
    // 20 views a second save 0.6 s, and four samples of 0.2 s cost 0.8 s.
    assert!(
        seconds_until_warped.is_some_and(|seconds| (1..15).contains(&seconds)),
        "{seconds_until_warped:?}"
    );
    let rendered: u64 = sim.workers.values().map(|worker| worker.report.samples_rendered).sum();
    assert!((1..=8).contains(&rendered), "{rendered} samples");
}

#[test]
fn if_triangles_are_cheaper_no_sample_is_rendered() {
    let mut sim = measured(8.0, 10.0);
    for _ in 0..200 {
        for _ in 0..5 {
            let view_id = ask(&mut sim, &view());
            assert!(is_direct(&sim, view_id));
            sim.answer_taking(view_id, 8.0);
        }
        sim.now = sim.now.after(std::time::Duration::from_millis(250));
        sim.report_all();
        sim.step(Event::Tick);
    }
    assert!(sim.workers.values().all(|worker| worker.report.held.is_empty()));
}

/// The shell's memory of a view that was answered as ordered.
fn remembered(sim: &Sim, view: &View, view_id: ViewId, since_change: Option<Duration>) -> LastView {
    let order = &sim.orders[&view_id];
    let provenance = Provenance {
        scene: sim.core.set().scene,
        state: order.state,
        plan: order.plan.clone(),
        specification: None,
        device: "device".to_owned(),
        history: false,
    };
    LastView { view: view.clone(), provenance, reason: order.decision.unwrap().reason, since_change }
}

/// Sets the costs of views at every worker.
fn costs(sim: &mut Sim, direct_ms: f64, warp_ms: f64) {
    let cost = |fixed_ms| Some(Cost { fixed_ms, ms_per_megapixel: 0.0 });
    for worker in sim.workers.values_mut() {
        (worker.report.direct_cost, worker.report.warp_cost) = (cost(direct_ms), cost(warp_ms));
    }
    sim.report_all();
}

#[test]
fn a_still_session_repeats_its_plan_while_its_samples_are_held() {
    let mut sim = measured(40.0, 10.0);
    hold(&mut sim);
    let first = ask(&mut sim, &view());
    let plan = sim.orders[&first].plan.clone();
    assert!(!is_direct(&sim, first));
    let last = remembered(&sim, &view(), first, Some(Duration::ZERO));
    sim.answer_taking(first, 10.0);
    // Triangles would now be faster, but the way has just changed.
    costs(&mut sim, 5.0, 10.0);
    let again = ask_after(&mut sim, &view(), Some(last.clone()));
    assert_eq!(
        (&sim.orders[&again].plan, sim.orders[&again].decision.unwrap().reason),
        (&plan, Reason::Kept)
    );
    sim.answer_taking(again, 10.0);
    // Much later, that is an upgrade.
    let calm = LastView { since_change: Some(Duration::from_secs(3)), ..last.clone() };
    let later = ask_after(&mut sim, &view(), Some(calm));
    assert_eq!(sim.orders[&later].decision.unwrap().reason, Reason::Upgrade);
    assert!(is_direct(&sim, later));
    sim.answer_taking(later, 5.0);
    // A lost sample changes the plan at once.
    for id in sim.workers.keys().copied().collect::<Vec<_>>() {
        sim.workers.get_mut(&id).unwrap().report.held.clear();
        sim.report(id);
    }
    let lost = ask_after(&mut sim, &view(), Some(last));
    assert_eq!(sim.orders[&lost].decision.unwrap().reason, Reason::NoSamples);
}

#[test]
fn a_moving_session_changes_its_way_at_most_once_in_two_seconds() {
    let mut sim = measured(40.0, 10.0);
    hold(&mut sim);
    let mut view = view();
    let mut last: Option<(LastView, bool)> = None;
    let (mut changed, mut changes) = (None, Vec::new());
    for frame in 0..200 {
        let now = Duration::from_millis(50 * frame);
        view.camera.eye.x += 1e-3;
        match frame % 2 {
            0 => costs(&mut sim, 12.0, 10.0),
            _ => costs(&mut sim, 10.0, 12.0),
        }
        let since_change = changed.map(|changed| now - changed);
        let before = last.take();
        let memory = before.clone().map(|(last, _)| LastView { since_change, ..last });
        let view_id = ask_after(&mut sim, &view, memory);
        let way = is_direct(&sim, view_id);
        if before.is_some_and(|(_, before)| before != way) {
            changed = Some(now);
            changes.push(now);
        }
        last = Some((remembered(&sim, &view, view_id, None), way));
        sim.answer_taking(view_id, 10.0);
    }
    assert!(changes.len() > 2, "{changes:?}");
    assert!(changes.windows(2).all(|pair| pair[1] - pair[0] >= Duration::from_secs(2)), "{changes:?}");
}

#[test]
fn a_camera_set_has_the_faces_that_views_look_at_and_is_extended_where_they_look_elsewhere() {
    let mut sim = measured(40.0, 10.0);
    let second = |sim: &mut Sim, view: &View| {
        let mut warped = None;
        for _ in 0..4 {
            for _ in 0..5 {
                let ticket = ask(sim, view);
                if let Plan::Warp(warp) = &sim.orders[&ticket].plan {
                    warped = Some(warp.clone());
                }
                sim.answer_taking(ticket, 40.0);
            }
            sim.now = sim.now.after(Duration::from_millis(250));
            sim.report_all();
            sim.step(Event::Tick);
        }
        warped
    };
    let until_warped = |sim: &mut Sim, view: &View| (0..30).find_map(|_| second(sim, view)).unwrap();
    let shares = |warp: &argus_scene::Warp| -> Vec<f64> {
        warp.samples.iter().map(|id| warp.faces.of(id.camera).share()).collect()
    };
    // Along +x, as in a corridor.
    let along = until_warped(&mut sim, &view());
    assert!(shares(&along).iter().all(|share| *share < 1.0), "{:?}", shares(&along));
    assert!(along.samples.iter().all(|id| along.faces.of(id.camera).has(0)), "{along:?}");
    let held = |sim: &Sim| -> Vec<Vec<(SampleId, argus_scene::FaceMask)>> {
        sim.workers.values().map(|worker| worker.report.partial.clone()).collect()
    };
    let before = held(&sim);
    assert!(before.iter().any(|partial| !partial.is_empty()));
    // The viewer turns round: at first his views come from triangles.
    let back = Camera { target: DVec3::new(-5.0, 1.0, 0.7), ..view().camera };
    let turned = View { camera: back, ..view() };
    let ticket = ask(&mut sim, &turned);
    assert!(is_direct(&sim, ticket), "no worker holds the faces behind the viewer");
    sim.answer_taking(ticket, 40.0);
    let behind = until_warped(&mut sim, &turned);
    assert!(behind.samples.iter().any(|id| behind.faces.of(id.camera).has(1)), "{behind:?}");
    // What was there stays there.
    for (before, after) in before.iter().zip(sim.workers.values()) {
        for (id, faces) in before.iter().filter(|(id, _)| behind.samples.contains(id)) {
            assert!(after.report.faces(*id).contains(*faces), "{id}");
        }
    }
}
