//! A moving scene: epochs ascend, no frame mixes two, and no view waits for the next one.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{Plan, SampleSetInfo};

use super::sim::Sim;
use crate::core::tests::set_info;
use crate::core::*;

/// Δt of the default configuration is 100 ms.
fn moving(workers: usize) -> Sim {
    let mut sim = Sim::with_set(Config::default(), SampleSetInfo { epoch_secs: 0.1, ..set_info() });
    for i in 0..workers {
        sim.join(&format!("w{i}"));
        sim.report_all();
    }
    sim
}

fn pass(sim: &mut Sim, ms: u64) {
    sim.now = sim.now.after(Duration::from_millis(ms));
    sim.step(Event::Tick);
}

/// The epochs of the answers to a view every 10 ms, with reports every 20 ms.
fn watch(sim: &mut Sim, ms: u64) -> Vec<u64> {
    let mut epochs = Vec::new();
    for step in 0..ms / 10 {
        let view_id = sim.ask(false);
        epochs.push(sim.orders[&view_id].state.epoch);
        sim.answer(view_id);
        pass(sim, 10);
        if step % 2 == 0 {
            sim.report_all();
        }
    }
    epochs
}

#[test]
fn epochs_ascend_with_the_clock_and_every_view_has_one() {
    for workers in [1, 2, 4] {
        let mut sim = moving(workers);
        let epochs = watch(&mut sim, 5000);
        assert!(epochs.is_sorted(), "{epochs:?}");
        let distinct: BTreeSet<u64> = epochs.iter().copied().collect();
        assert!(distinct.len() >= 40, "{workers} workers: {distinct:?}");
        let last = epochs[epochs.len() - 1];
        assert!((46..=50).contains(&last), "{workers} workers, epoch {last} after 5 s of 100 ms each");
        assert_eq!(sim.core.status().counts().views_answered, 500);
    }
}

#[test]
fn compositors_hold_the_next_epochs_samples_before_a_view_needs_them() {
    let mut sim = moving(3);
    watch(&mut sim, 2000);
    for _ in 0..50 {
        let view_id = sim.ask(false);
        let order = sim.orders[&view_id].clone();
        let held = &sim.workers[&order.worker].report.held;
        assert!(order.sources.iter().all(|source| held.contains(&source.id)), "epoch {}", order.state.epoch);
        sim.answer(view_id);
        pass(&mut sim, 20);
        sim.report_all();
    }
}

#[test]
fn a_view_in_work_keeps_its_epoch_and_its_samples() {
    let mut sim = moving(3);
    watch(&mut sim, 1000);
    let slow = sim.ask(false);
    let order = sim.orders.remove(&slow).unwrap();
    watch(&mut sim, 2000);
    let kept_from =
        |sim: &Sim| sim.workers.values().map(|w| w.assignments.last().unwrap().kept_from).max().unwrap();
    assert!(sim.core.set().version.state.epoch > order.state.epoch + 10);
    let version = order.sources[0].id.version;
    assert!(kept_from(&sim) <= version);
    let held = &sim.workers[&order.worker].report.held;
    assert!(order.sources.iter().all(|source| held.contains(&source.id)));
    // The worker dies: another one gets the same order.
    sim.leave(order.worker);
    let again = sim.orders[&slow].clone();
    assert_eq!((again.state.epoch, &again.plan, again.attempt), (order.state.epoch, &order.plan, 2));
    sim.answer(slow);
    watch(&mut sim, 500);
    assert!(kept_from(&sim) > version + 10, "then they go");
    let oldest = sim.workers.values().flat_map(|w| &w.report.held).map(|id| id.version).min().unwrap();
    assert!(oldest + 4 >= sim.core.set().version.number, "version {oldest} is still held");
}

#[test]
fn slow_samplers_make_fewer_epochs_and_delay_no_view() {
    let mut sim = moving(3);
    watch(&mut sim, 500);
    let samplers: Vec<WorkerId> = sim.workers.keys().copied().collect();
    let mut epochs = BTreeSet::new();
    for step in 0..1000 {
        let view_id = sim.ask(false);
        assert!(sim.orders.contains_key(&view_id), "no view waits for an epoch");
        epochs.insert(sim.orders[&view_id].state.epoch);
        sim.answer(view_id);
        pass(&mut sim, 10);
        // A sampler takes 800 ms until it reports the next epoch.
        for &worker in samplers.iter().filter(|_| step % 80 == 0) {
            sim.report(worker);
        }
    }
    assert!((8..=16).contains(&epochs.len()), "{epochs:?}");
    assert_eq!(sim.core.status().counts().views_failed, 0);
}

#[test]
fn s_counts_the_samples_of_every_epoch_and_falls_to_zero_without_views() {
    let mut sim = moving(3);
    watch(&mut sim, 12_000);
    // Four samples, ten times a tick of a second.
    let per_tick = sim.core.status().samples_per_tick;
    assert!((30.0..=44.0).contains(&per_tick), "{per_tick}");
    let epoch = sim.core.set().version.state.epoch;
    for _ in 0..150 {
        pass(&mut sim, 100);
        sim.report_all();
    }
    assert_eq!(sim.core.status().samples_per_tick, 0.0);
    assert!(sim.core.set().version.state.epoch <= epoch + 12, "there are no views");
    let view_id = sim.ask(false);
    assert!(
        sim.orders[&view_id].state.epoch > epoch + 100,
        "a view after a pause sees the scene as it is now"
    );
}

#[test]
fn a_moving_scene_gets_more_samplers() {
    let mut sim = moving(6);
    // A sample costs 80 ms, a view 2: four samples for each of ten epochs a second keep more than three busy.
    watch(&mut sim, 15_000);
    let (samplers, compositors) = sim.roles();
    assert!(samplers >= 3 && compositors >= 1, "{samplers} + {compositors}");
    let still = {
        let mut sim = Sim::with_workers(6);
        watch(&mut sim, 15_000);
        sim.roles().0
    };
    assert_eq!(still, 1);
}

#[test]
fn a_sampler_that_dies_in_the_middle_of_an_epoch_is_replaced() {
    let mut sim = moving(4);
    watch(&mut sim, 3000);
    let before = sim.core.set().version.state.epoch;
    let renders = |w: &RenderingWorker| w.1;
    let workers: Vec<RenderingWorker> = sim
        .workers
        .iter()
        .map(|(id, w)| {
            (*id, w.assignments.last().is_some_and(|t| t.prefetch.iter().any(|s| s.addresses.is_empty())))
        })
        .collect();
    let victim = workers.iter().find(|w| renders(w)).unwrap().0;
    sim.leave(victim);
    let epochs = watch(&mut sim, 3000);
    assert!(epochs.is_sorted() && epochs[epochs.len() - 1] >= before + 25, "{before}, then {epochs:?}");
}

/// A worker, and whether it is asked to render.
type RenderingWorker = (WorkerId, bool);

#[test]
fn pins_of_kept_epochs_are_repeated_and_others_refused() {
    let mut sim = moving(2);
    watch(&mut sim, 1000);
    let view_id = sim.ask(false);
    let order = sim.orders[&view_id].clone();
    sim.answer(view_id);
    let same = sim.pin(order.state.epoch, order.plan.clone());
    assert_eq!((sim.orders[&same].state.epoch, &sim.orders[&same].plan), (order.state.epoch, &order.plan));
    watch(&mut sim, 1000);
    let gone = sim.pin(order.state.epoch, order.plan.clone());
    let Some((_, Fault::Pin(reason))) = sim.refused.iter().find(|(t, _)| *t == gone) else {
        panic!("{:?}", sim.refused)
    };
    assert!(reason.contains(&format!("epoch {} is not served", order.state.epoch)), "{reason}");
    // From triangles any epoch can be rendered.
    for epoch in [order.state.epoch, 0, 1 << 40] {
        let direct = sim.pin(epoch, Plan::direct(1));
        assert_eq!(sim.orders[&direct].state.epoch, epoch);
    }
    // A pin whose samples are of another epoch is refused.
    let served = sim.core.set().version;
    let fault_of =
        |sim: &Sim, view_id| sim.refused.iter().find(|(t, _)| *t == view_id).map(|(_, f)| f.clone());
    let mixed = sim.pin(served.state.epoch, order.plan.clone());
    let fault = fault_of(&sim, mixed).unwrap();
    assert!(matches!(&fault, Fault::Pin(reason) if reason.starts_with("version")), "{fault:?}");
    let older = sim.core.live_versions().into_iter().rfind(|kept| kept.number < served.number).unwrap();
    let Plan::Warp(mut warp) = order.plan else { panic!("a warp") };
    warp.samples.iter_mut().for_each(|id| id.version = older.number);
    let mixed = sim.pin(served.state.epoch, Plan::Warp(warp));
    assert!(matches!(fault_of(&sim, mixed), Some(Fault::Invalid(_))));
}

#[test]
fn a_still_scene_needs_no_further_assignments() {
    let mut sim = Sim::with_workers(3);
    let assigned = |sim: &Sim| sim.workers.values().map(|w| w.assignments.len()).sum::<usize>();
    watch(&mut sim, 500);
    let before = assigned(&sim);
    let epochs = watch(&mut sim, 1500);
    assert_eq!(assigned(&sim), before);
    assert!(epochs.iter().all(|epoch| *epoch == 0));
    let direct = sim.pin(3, Plan::direct(1));
    assert!(sim.refused.iter().any(|(t, fault)| *t == direct && matches!(fault, Fault::Pin(_))));
}
