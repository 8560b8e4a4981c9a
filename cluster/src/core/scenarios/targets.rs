//! Requests that state a target.

use argus_scene::{Holes, Plan, PlanRequest, Preset};

use super::sim::Sim;
use crate::core::quality::Setting;
use crate::core::quality::tests::{model, observed};
use crate::core::*;

fn calibrated(workers: usize) -> Sim {
    let mut sim = Sim::with_models(vec![model()]);
    for i in 0..workers {
        sim.join(&format!("w{i}"));
        sim.report_all();
    }
    sim
}

fn bounded(bound: f64) -> PlanRequest {
    PlanRequest { max_error: Some(bound), ..PlanRequest::default() }
}

fn setting(sim: &Sim, view_id: ViewId) -> Setting {
    Setting::of(&sim.orders[&view_id].plan)
}

fn judge(sim: &mut Sim, view_id: ViewId, difficulty: f64, ms: f64) {
    let attempt = sim.orders[&view_id].attempt;
    sim.step(Event::Judged { view_id, attempt, observed: Some(observed(difficulty)), ms });
}

#[test]
fn a_loose_bound_is_met_by_a_warp_and_a_tight_one_by_triangles() {
    let mut sim = calibrated(2);
    let loose = sim.ask_for(bounded(0.3));
    let tight = sim.ask_for(bounded(0.012));
    assert!(matches!(setting(&sim, loose), Setting::Warp { supersampling: 1, .. }));
    judge(&mut sim, loose, 1.0, 1.0);
    let expected = sim.delivered[&loose];
    assert!(expected.error <= 0.3 && expected.error > 0.03, "{expected:?}");
    // The first try may be a frame that only informs the choice; finally triangles are chosen.
    while sim.orders[&tight].judged && !sim.delivered.contains_key(&tight) {
        judge(&mut sim, tight, 1.0, 1.0);
    }
    assert_eq!(setting(&sim, tight), Setting::Direct { samples_per_pixel: 16 });
    sim.answer_all();
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_frame_beyond_its_bound_is_rejected_and_counted() {
    let mut sim = calibrated(2);
    let view_id = sim.ask_for(bounded(0.06));
    assert!(matches!(setting(&sim, view_id), Setting::Warp { supersampling: 1, .. }));
    let first = sim.orders[&view_id].clone();
    judge(&mut sim, view_id, 2.0, 1.0);
    let second = sim.orders[&view_id].clone();
    assert!(second.attempt > first.attempt && second.plan != first.plan);
    assert!(second.expected.unwrap().error <= 0.06);
    assert_eq!(sim.core.status().counts().frames_refused, 1);
    // Late chunks of the first frame are ignored.
    sim.step(Event::Judged { view_id, attempt: first.attempt, observed: None, ms: 1.0 });
    sim.step(Event::Answered {
        view_id,
        attempt: first.attempt,
        uncovered: Some(0),
        ms: None,
        fell_short: false,
    });
    assert_eq!(sim.core.views_in_flight(), 1);
    while sim.orders[&view_id].judged && !sim.delivered.contains_key(&view_id) {
        judge(&mut sim, view_id, 2.0, 9.0);
    }
    sim.answer_all();
    assert_eq!(sim.core.status().counts().views_answered, 1);
}

#[test]
fn a_view_is_answered_without_statistics_and_after_a_workers_death() {
    let mut sim = calibrated(3);
    let view_id = sim.ask_for(bounded(0.3));
    let attempt = sim.orders[&view_id].attempt;
    sim.step(Event::Judged { view_id, attempt, observed: None, ms: f64::NAN });
    assert_eq!(sim.delivered[&view_id].error, 1.0, "nothing is known");
    // It dies while its frame is being relayed: another worker makes the same frame, which is not judged again.
    let (plan, worker) = (sim.orders[&view_id].plan.clone(), sim.orders[&view_id].worker);
    sim.leave(worker);
    let again = &sim.orders[&view_id];
    assert!(!again.judged && again.plan == plan && again.worker != worker);
    sim.answer_all();
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn presets_and_deadlines_of_explicit_searches_are_predicted() {
    let mut sim = calibrated(2);
    let ask = |sim: &mut Sim, request| {
        let view_id = sim.ask_for(request);
        let order = sim.orders[&view_id].clone();
        assert!(!order.judged);
        order
    };
    let searched = PlanRequest::from_samples();
    let interactive = PlanRequest { preset: Some(Preset::Interactive), ..searched };
    let traces = PlanRequest { holes: Some(Holes::Trace), ..searched };
    let exact = PlanRequest { preset: Some(Preset::Exact), deadline_ms: Some(15.0), ..traces };
    let cheap = ask(&mut sim, interactive);
    assert!(cheap.expected.unwrap().ms < 2.0, "{cheap:?}");
    let traced = ask(&mut sim, exact);
    assert!(matches!(&traced.plan, Plan::Warp(warp) if warp.holes == Holes::Trace), "{traced:?}");
    let plain = ask(&mut sim, searched);
    assert_eq!(plain.plan, cheap.plan, "a plain search is in the model too");
    assert_eq!(plain.expected, cheap.expected);
    let unknown = ask(&mut sim, PlanRequest { samples: Some(1), ..PlanRequest::default() });
    assert_eq!(unknown.expected, None);
}

#[test]
fn costs_follow_measured_times() {
    let mut sim = calibrated(1);
    let expected_ms = |sim: &mut Sim| {
        let view_id = sim.ask(false);
        let order = sim.orders.remove(&view_id).unwrap();
        sim.step(Event::Answered {
            view_id,
            attempt: order.attempt,
            uncovered: Some(0),
            ms: Some(3.0),
            fell_short: false,
        });
        order.expected.unwrap().ms
    };
    let before = expected_ms(&mut sim);
    (0..30).for_each(|_| _ = expected_ms(&mut sim));
    let after = expected_ms(&mut sim);
    assert!((before - 1.0).abs() < 1e-6 && (after - 3.0).abs() < 0.05, "{before} {after}");
}
