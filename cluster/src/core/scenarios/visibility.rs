//! The visibility backend is chosen before samples are rendered. Views from triangles do not wait for it.

use argus_scene::{Plan, PlanRequest, SampleId, Visibility, Warp};

use super::sim::Sim;
use crate::core::*;

fn measured() -> Sim {
    Sim::new(Config { visibility: None, ..Config::default() })
}

/// Workers whose newest assignment tells them to measure.
fn measuring(sim: &Sim) -> Vec<WorkerId> {
    let is_asked = |worker: &super::sim::SimWorker| {
        worker.assignments.last().is_some_and(|newest| newest.measure_backends)
    };
    sim.workers.iter().filter(|(_, worker)| is_asked(worker)).map(|(id, _)| *id).collect()
}

#[test]
fn views_from_triangles_are_answered_before_the_backend_is_chosen() {
    let mut sim = measured();
    sim.join("a");
    sim.join("b");
    sim.report_all();
    assert_eq!(sim.roles(), (1, 1), "ready at once");
    sim.ask_for(PlanRequest::default());
    sim.ask(true);
    assert_eq!(sim.orders.len(), 2);
    sim.step(Event::Tick);
    assert!(measuring(&sim).is_empty(), "no view needs a sample");
}

#[test]
fn the_cheapest_measured_backend_is_used_for_all_samples() {
    let mut sim = measured();
    let view = sim.ask(false);
    let (first, second) = (sim.join("a"), sim.join("b"));
    sim.report_all();
    sim.step(Event::Tick);
    assert_eq!(measuring(&sim), [first]);
    assert!(sim.orders.is_empty(), "a view from samples waits");
    sim.workers.get_mut(&first).unwrap().report.backend_costs =
        vec![(Visibility::Raster, 80.0), (Visibility::Cpu, 8.0), (Visibility::Trace, f64::NAN)];
    sim.report(first);
    assert_eq!(sim.core.set().visibility, Visibility::Cpu);
    assert!(measuring(&sim).is_empty());
    assert!(sim.orders.is_empty(), "they have yet to hear of it");
    // Later measurements of another worker change nothing.
    sim.workers.get_mut(&second).unwrap().report.backend_costs = vec![(Visibility::Raster, 1.0)];
    sim.report_all();
    assert_eq!(sim.core.set().visibility, Visibility::Cpu);
    assert_eq!(sim.roles(), (1, 1));
    assert!(sim.orders.contains_key(&view));
    let third = sim.join("c");
    assert!(!sim.workers[&third].assignments[0].measure_backends);
}

#[test]
fn another_worker_measures_if_the_first_is_lost() {
    let mut sim = measured();
    let (first, second) = (sim.join("a"), sim.join("b"));
    sim.report_all();
    sim.ask(false);
    sim.step(Event::Tick);
    sim.workers.remove(&first);
    sim.step(Event::Left { worker: first });
    sim.step(Event::Tick);
    assert_eq!(measuring(&sim), [second]);
    sim.workers.get_mut(&second).unwrap().report.backend_costs = vec![(Visibility::Trace, 3.0)];
    sim.report(second);
    sim.report(second);
    assert_eq!(sim.core.set().visibility, Visibility::Trace);
    assert_eq!(sim.orders.len(), 1);
}

#[test]
fn a_configured_backend_is_not_measured() {
    let mut sim = Sim::new(Config { visibility: Some(Visibility::Trace), ..Config::default() });
    let worker = sim.join("a");
    assert!(measuring(&sim).is_empty());
    sim.report(worker);
    sim.ask(false);
    sim.step(Event::Tick);
    assert!(measuring(&sim).is_empty());
    assert_eq!((sim.core.set().visibility, sim.roles()), (Visibility::Trace, (1, 1)));
}

#[test]
fn a_new_version_of_the_same_epoch_keeps_workers_ready() {
    let mut sim = measured();
    let (first, second) = (sim.join("a"), sim.join("b"));
    // It comes from an earlier coordinator, and keeps a sample.
    let old = SampleId { version: 0, camera: 0 };
    sim.workers.get_mut(&second).unwrap().report.held = vec![old];
    sim.report_all();
    let view = sim.ask(false);
    sim.step(Event::Tick);
    assert_eq!(measuring(&sim), [first]);
    let before = sim.core.set().version;
    sim.workers.get_mut(&first).unwrap().report.backend_costs = vec![(Visibility::Cpu, 8.0)];
    sim.report(first);
    let served = sim.core.set().version;
    assert_eq!((served.state, served.number), (before.state, before.number + 1));
    // No worker must prepare: views from triangles are answered at once, and both workers have their roles.
    let direct = sim.ask(true);
    assert!(sim.orders.contains_key(&direct));
    assert_eq!(sim.roles(), (1, 1));
    sim.report_all();
    let order = &sim.orders[&view];
    assert!(order.sources.iter().all(|source| source.id.version == served.number), "{:?}", order.sources);
    assert_eq!(order.state, before.state);
    // Earlier versions cannot be rendered any more.
    let Plan::Warp(warp) = &order.plan else { panic!("a warp") };
    let plan = Plan::Warp(Warp { samples: vec![old], ..warp.clone() });
    let pinned = sim.pin(before.state.epoch, plan);
    let refused =
        sim.refused.iter().find(|(view_id, _)| *view_id == pinned).map(|(_, fault)| fault.to_string());
    assert!(refused.is_some_and(|reason| reason.contains("version 0 is not served here, version 1 is")));
}
