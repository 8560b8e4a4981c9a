//! Second copies: the loss of a worker loses no sample in use.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_scene::{Plan, SampleId};

use super::sim::Sim;
use crate::core::*;

/// Samples of the plans of one second of answered views.
fn used(sim: &mut Sim) -> BTreeSet<SampleId> {
    let mut used = BTreeSet::new();
    for _ in 0..8 {
        let view_id = sim.ask(false);
        let Plan::Warp(warp) = &sim.orders[&view_id].plan else { unreachable!("no view is from triangles") };
        used.extend(warp.samples.iter().copied());
        sim.answer(view_id);
        sim.now = sim.now.after(Duration::from_millis(125));
        sim.report_all();
        sim.step(Event::Tick);
    }
    used
}

fn holders(sim: &Sim, id: SampleId) -> usize {
    sim.workers.values().filter(|worker| worker.report.held.contains(&id)).count()
}

#[test]
fn a_lost_worker_loses_no_sample_in_use() {
    for who in 0..3 {
        let mut sim = Sim::with_workers(3);
        let used = used(&mut sim);
        assert!(!used.is_empty() && used.iter().all(|id| holders(&sim, *id) >= 2), "{used:?}");
        let lost = *sim.workers.keys().nth(who).unwrap();
        sim.leave(lost);
        assert!(used.iter().all(|id| holders(&sim, *id) >= 1), "without worker {who}: {used:?}");
        // The remaining workers hold two copies again.
        sim.second(0, 0);
        sim.second(0, 0);
        assert!(used.iter().all(|id| holders(&sim, *id) == 2), "{used:?}");
    }
}

#[test]
fn a_sample_without_holders_is_rendered_again_before_a_view_needs_it() {
    let mut sim = Sim::with_workers(3);
    let used = used(&mut sim);
    sim.workers.values_mut().for_each(|worker| worker.report.held.clear());
    let rendered = |sim: &Sim| sim.workers.values().map(|w| w.report.samples_rendered).sum::<u64>();
    let before = rendered(&sim);
    sim.workers.values_mut().for_each(|worker| worker.prefetch.clear());
    (0..3).for_each(|_| sim.second(0, 0));
    assert!(used.iter().all(|id| holders(&sim, *id) >= 2), "{used:?}");
    assert_eq!(rendered(&sim) - before, used.len() as u64, "each once");
}

#[test]
fn samples_out_of_use_are_not_copied() {
    let mut sim = Sim::with_workers(3);
    let used = used(&mut sim);
    let listed = |sim: &Sim| {
        let newest = sim.workers.values().filter_map(|worker| worker.assignments.last());
        newest.flat_map(|newest| &newest.prefetch).filter(|source| used.contains(&source.id)).count()
    };
    assert!(listed(&sim) >= used.len());
    (0..61).for_each(|_| sim.second(0, 0));
    assert_eq!(listed(&sim), 0);
    assert!(used.iter().all(|id| holders(&sim, *id) >= 2), "and stays where it is while there is room");
}
