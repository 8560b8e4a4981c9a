//! How triangles are seen is settled before anybody renders.

use argus_scene::Visibility;

use super::sim::Sim;
use crate::core::*;

fn measured() -> Sim {
    Sim::new(Config { visibility: None, ..Config::default() })
}

/// Whom the newest assignment tells to measure.
fn measuring(sim: &Sim) -> Vec<WorkerId> {
    let told = |worker: &super::sim::SimWorker| worker.told.last().is_some_and(|told| told.measure_ways);
    sim.workers.iter().filter(|(_, worker)| told(worker)).map(|(id, _)| *id).collect()
}

#[test]
fn the_cheapest_way_of_the_first_who_measured_is_everybodys() {
    let mut sim = measured();
    let view = sim.ask(false);
    let (first, second) = (sim.join("a"), sim.join("b"));
    assert_eq!(measuring(&sim), [first]);
    sim.report_all();
    assert_eq!(sim.roles(), (0, 0), "nobody is ready under a set that may change");
    sim.workers.get_mut(&first).unwrap().report.ways =
        vec![(Visibility::Raster, 80.0), (Visibility::Cpu, 8.0), (Visibility::Trace, f64::NAN)];
    sim.report(first);
    assert_eq!(sim.core.set().visibility, Visibility::Cpu);
    assert!(measuring(&sim).is_empty());
    assert!(sim.orders.is_empty(), "they have yet to hear of it");
    // What another measures is too late, and changes nothing.
    sim.workers.get_mut(&second).unwrap().report.ways = vec![(Visibility::Raster, 1.0)];
    sim.report_all();
    assert_eq!(sim.core.set().visibility, Visibility::Cpu);
    assert_eq!(sim.roles(), (1, 1));
    assert!(sim.orders.contains_key(&view));
    let third = sim.join("c");
    assert!(!sim.workers[&third].told[0].measure_ways);
}

#[test]
fn another_measures_where_the_first_is_lost() {
    let mut sim = measured();
    let (first, second) = (sim.join("a"), sim.join("b"));
    sim.report_all();
    sim.workers.remove(&first);
    sim.step(Event::Left { worker: first });
    assert_eq!(measuring(&sim), [second]);
    sim.workers.get_mut(&second).unwrap().report.ways = vec![(Visibility::Trace, 3.0)];
    sim.report(second);
    sim.report(second);
    assert_eq!(sim.core.set().visibility, Visibility::Trace);
    assert_eq!(sim.roles(), (1, 1));
}

#[test]
fn a_way_that_was_asked_for_is_not_measured() {
    let mut sim = Sim::new(Config { visibility: Some(Visibility::Trace), ..Config::default() });
    let worker = sim.join("a");
    assert!(measuring(&sim).is_empty());
    sim.report(worker);
    assert_eq!((sim.core.set().visibility, sim.roles()), (Visibility::Trace, (1, 1)));
}
