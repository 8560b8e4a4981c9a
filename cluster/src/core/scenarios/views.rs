//! Outcomes of views, and the samples that they need.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_proto::{Fault, v1};
use argus_scene::{Camera, Holes, Outputs, PlanRequest, View};
use glam::DVec3;

use super::sim::Sim;
use crate::core::tests::set_info;
use crate::core::*;

#[test]
fn the_views_of_a_lost_worker_are_sent_to_another() {
    let mut sim = Sim::with_workers(3);
    let view_ids: Vec<ViewId> = (0..40).map(|_| sim.ask(false)).collect();
    let victim = sim.orders[&view_ids[0]].worker;
    let before: Vec<ViewId> = view_ids.iter().filter(|t| sim.orders[t].worker == victim).copied().collect();
    assert!(before.len() > 1);
    sim.leave(victim);
    for view_id in &before {
        let order = &sim.orders[view_id];
        assert_ne!(order.worker, victim);
        assert_eq!(order.attempt, 2);
    }
    sim.answer_all();
    let counters = sim.core.status().counts();
    assert_eq!(counters.views_answered, 40);
    assert_eq!((counters.views_retried, counters.workers_lost), (before.len() as u64, 1));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn repeated_and_late_events_are_ignored() {
    let mut sim = Sim::with_workers(3);
    let view_id = sim.ask(false);
    let first = sim.orders[&view_id].clone();
    sim.step(Event::Failed { view_id, attempt: first.attempt, failure: Failure::TryElsewhere });
    let second = sim.orders[&view_id].clone();
    assert_ne!(second.worker, first.worker);
    sim.step(Event::Failed { view_id, attempt: first.attempt, failure: Failure::Final });
    sim.step(Event::Answered {
        view_id,
        attempt: first.attempt,
        uncovered: Some(0),
        ms: Some(1.0),
        fell_short: false,
    });
    assert_eq!(sim.core.views_in_flight(), 1);
    sim.answer(view_id);
    sim.step(Event::Answered {
        view_id,
        attempt: second.attempt,
        uncovered: Some(0),
        ms: Some(1.0),
        fell_short: false,
    });
    sim.step(Event::Cancelled { view_id });
    let counters = sim.core.status().counts();
    assert_eq!((counters.views_answered, counters.views_failed, counters.views_retried), (1, 0, 1));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_view_at_which_every_worker_fails_is_refused() {
    let mut sim = Sim::with_workers(3);
    let view_id = sim.ask(false);
    for attempt in 1..=sim.core.config().max_attempts {
        assert!(sim.refused.is_empty(), "after {attempt}");
        sim.step(Event::Failed { view_id, attempt, failure: Failure::TryElsewhere });
    }
    assert!(matches!(&sim.refused[..], [(t, Fault::Unavailable(_))] if *t == view_id));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_view_beyond_the_limit_is_refused_at_once() {
    let mut sim = Sim::new(Config { max_views: 10, max_views_per_worker: 3, ..Config::default() });
    let worker = sim.join("a");
    sim.report(worker);
    let view_ids: Vec<ViewId> = (0..12).map(|_| sim.ask(false)).collect();
    assert_eq!(sim.orders.len(), 3);
    assert_eq!(sim.refused.len(), 2);
    assert!(sim.refused.iter().all(|(_, f)| matches!(f, Fault::Overloaded { .. })));
    assert_eq!(sim.core.status().counts().views_rejected, 2);
    sim.answer_all();
    assert_eq!(sim.answered.len(), 10, "those admitted are answered, first come first served");
    assert!(view_ids[..10].iter().all(|t| sim.answered.contains(t)));
}

#[test]
fn a_view_that_would_wait_too_long_is_refused_at_once() {
    let mut sim = Sim::with_workers(3);
    // 20 ms on each of two compositors: a hundred of them are a second's work.
    sim.view_ms = 20.0;
    (0..10).for_each(|_| sim.second(40, 0));
    (0..100).for_each(|_| _ = sim.ask(false));
    assert!(sim.refused.is_empty());
    let hurried = sim.ask_with(false, Some(Duration::from_millis(900)));
    assert!(matches!(&sim.refused[..], [(t, Fault::Overloaded { .. })] if *t == hurried));
    let patient = sim.ask_with(false, Some(Duration::from_millis(1500)));
    let direct = sim.ask_with(true, Some(Duration::from_millis(900)));
    sim.answer_all();
    assert!(sim.answered.contains(&patient) && sim.answered.contains(&direct));
    assert_eq!(sim.refused.len(), 1);
}

#[test]
fn deadlines_patience_and_cancellation_end_a_wait() {
    let mut sim = Sim::new(Config::default());
    let hurried = sim.ask_with(false, Some(Duration::from_millis(100)));
    let patient = sim.ask(false);
    let cancelled = sim.ask(true);
    sim.step(Event::Cancelled { view_id: cancelled });
    sim.now = sim.now.after(Duration::from_millis(100));
    sim.step(Event::Tick);
    assert!(matches!(&sim.refused[..], [(t, Fault::Deadline(_))] if *t == hurried));
    sim.now = sim.now.after(Duration::from_secs(30));
    sim.step(Event::Tick);
    assert!(matches!(&sim.refused[1..], [(t, Fault::Unavailable(_))] if *t == patient));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn samples_are_counted_once_and_again_only_after_all_holders_left() {
    let mut sim = Sim::with_workers(3);
    (0..30).for_each(|_| sim.second(40, 0));
    assert_eq!(sim.core.status().samples_per_tick, 0.0, "a static scene is sampled once");
    let view_id = sim.ask(false);
    let order = &sim.orders[&view_id];
    assert!(order.sources.iter().all(|s| !s.addresses.is_empty()), "the other holder or the sampler");
    // All holders leave; new workers render them again.
    let old: Vec<WorkerId> = sim.workers.keys().copied().collect();
    for worker in old {
        sim.leave(worker);
    }
    for name in ["x", "y"] {
        let id = sim.join(name);
        sim.report(id);
    }
    sim.second(4, 0);
    assert!(sim.core.status().samples_per_tick > 1.0);
    assert!(sim.answered.contains(&view_id));
}

#[test]
fn views_spread_over_compositors_and_a_sample_has_one_owner() {
    let mut sim = Sim::with_workers(4);
    let sampler = sim
        .core
        .status()
        .workers
        .iter()
        .find(|w| w.role() == v1::Role::Sampler)
        .map(|w| w.address.clone())
        .unwrap();
    let view_ids: Vec<ViewId> = (0..30).map(|_| sim.ask(false)).collect();
    let mut count = BTreeMap::<WorkerId, usize>::new();
    for view_id in &view_ids {
        let order = &sim.orders[view_id];
        *count.entry(order.worker).or_default() += 1;
        assert!(order.sources.iter().all(|s| s.addresses == [sampler.clone()]));
    }
    assert_eq!(count.len(), 3);
    assert!(count.values().all(|n| (8..=12).contains(n)), "{count:?}");
}

#[test]
fn an_order_that_traces_holes_names_the_samplers() {
    let mut sim = Sim::with_workers(4);
    assert!(sim.orders.is_empty());
    let marked = sim.ask(false);
    assert!(sim.orders[&marked].tracers.is_empty(), "nothing to trace");
    let request = PlanRequest { holes: Some(Holes::Trace), ..PlanRequest::default() };
    let first = sim.ask_for(request);
    let sampler = sim.sampler();
    assert_eq!(sim.orders[&first].tracers, [sim.address(sampler)]);
    // Its death leaves the view with its compositor; the next view has another tracer.
    sim.leave(sampler);
    let second = sim.ask_for(request);
    let successor = sim.sampler();
    assert_eq!(sim.orders[&second].tracers, [sim.address(successor)]);
    sim.answer_all();
    assert!(sim.answered.contains(&first) && sim.answered.contains(&second));
    // A single worker traces for itself.
    let mut alone = Sim::with_workers(1);
    let view_id = alone.ask_for(request);
    let worker = alone.orders[&view_id].worker;
    assert_eq!(alone.orders[&view_id].tracers, [alone.address(worker)]);
}

#[test]
fn traced_rays_count_as_demand_and_cost() {
    let mut sim = Sim::with_workers(2);
    let sampler = sim.sampler();
    for _ in 0..20 {
        let report = &mut sim.workers.get_mut(&sampler).unwrap().report;
        (report.rays_traced, report.ray_ms) = (report.rays_traced + 1000, Some(0.01));
        sim.second(40, 0);
    }
    let status = sim.core.status();
    assert!((status.rays_per_tick - 1000.0).abs() < 10.0, "{}", status.rays_per_tick);
    assert!((status.ray_ms - 0.01).abs() < 1e-6, "{}", status.ray_ms);
}

#[test]
fn an_idle_sampler_composes_as_well() {
    for helps in [true, false] {
        let config = Config { samplers_composite: helps, ..Config::default() };
        let mut sim = Sim::new(config);
        for name in ["a", "b"] {
            sim.join(name);
            sim.report_all();
        }
        let sampler = sim.sampler();
        let to_it = |sim: &Sim, view_ids: &[ViewId]| {
            view_ids.iter().filter(|view_id| sim.orders[view_id].worker == sampler).count()
        };
        let first: Vec<ViewId> = (0..20).map(|_| sim.ask(false)).collect();
        assert_eq!(to_it(&sim, &first), 0, "it has samples to render");
        let needed: Vec<_> = sim.orders[&first[0]].sources.iter().map(|source| source.id).collect();
        sim.workers.get_mut(&sampler).unwrap().report.held = needed;
        sim.report(sampler);
        let second: Vec<ViewId> = (0..60).map(|_| sim.ask(false)).collect();
        // It gets few at a time.
        assert_eq!(to_it(&sim, &second), if helps { 32 } else { 0 });
        // Due samples go first.
        sim.answer_all();
        let elsewhere = Camera::look_at(DVec3::new(-9.0, 30.0, -9.0), DVec3::new(-8.0, 0.0, -8.0));
        let due = sim.ask_from(elsewhere, PlanRequest::from_samples(), None);
        assert_ne!(sim.orders[&due].worker, sampler);
        let third: Vec<ViewId> = (0..20).map(|_| sim.ask(false)).collect();
        assert_eq!(to_it(&sim, &third), 0);
        sim.answer_all();
        assert!(sim.refused.is_empty());
    }
}

#[test]
fn a_draining_coordinator_refuses_new_views_and_answers_the_others() {
    let mut sim = Sim::with_workers(2);
    let old = sim.ask(false);
    sim.step(Event::Drain);
    let new = sim.ask(false);
    assert!(matches!(&sim.refused[..], [(t, Fault::Unavailable(_))] if *t == new));
    sim.answer(old);
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_pinned_device_is_waited_for_or_refused() {
    let mut sim = Sim::with_workers(2);
    let view_id = sim.ask(false);
    let order = sim.orders[&view_id].clone();
    let set = set_info();
    let mut pinned = |device: &str| {
        let view_id = ViewId(sim.next);
        sim.next += 1;
        let view = Box::new(View {
            camera: Camera::look_at(DVec3::new(3.0, 30.0, 4.0), DVec3::new(2.0, 0.0, 2.0)),
            width: 20,
            height: 15,
            outputs: Outputs::COLOR,
            plan: PlanRequest::from_samples(),
            pin: Some(argus_scene::Provenance {
                scene: set.scene,
                state: set.version.state,
                plan: order.plan.clone(),
                specification: None,
                device: device.to_owned(),
                history: false,
            }),
            flow_to: None,
            rays: None,
        });
        let client = "a client".into();
        sim.step(Event::Requested { view_id, client, view, deadline: None, last: None });
        view_id
    };
    let (same, other, any) = (pinned("device"), pinned("another"), pinned(""));
    assert_eq!(sim.orders[&same].plan, order.plan);
    assert_eq!(sim.orders[&any].plan, order.plan);
    assert!(matches!(&sim.refused[..], [(t, Fault::Pin(_))] if *t == other));
}
