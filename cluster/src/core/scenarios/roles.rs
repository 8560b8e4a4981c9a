//! Workers that join and leave, and their roles.

use std::time::Duration;

use argus_proto::v1;

use super::sim::Sim;
use crate::core::*;

#[test]
fn a_single_worker_plays_both_roles_and_a_second_takes_one() {
    let mut sim = Sim::new(Config::default());
    assert_eq!(sim.roles(), (0, 0));
    let waiting = sim.ask(false);
    assert!(sim.orders.is_empty(), "there is no worker yet");
    let first = sim.join("a");
    assert!(sim.orders.is_empty(), "not ready yet");
    sim.report(first);
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.orders[&waiting].sources.len(), 4);
    assert!(sim.orders[&waiting].sources.iter().all(|s| s.addresses.is_empty()), "it renders them itself");
    let second = sim.join("b");
    sim.report(second);
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.workers[&first].assignments.last().unwrap().role, Role::Sampler);
    assert_eq!(sim.workers[&second].assignments.last().unwrap().role, Role::Compositor);
    sim.step(Event::Left { worker: second });
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.workers[&first].assignments.last().unwrap().role, Role::Both);
}

#[test]
fn roles_change_only_with_demand() {
    let mut sim = Sim::with_workers(3);
    (0..10).for_each(|_| sim.second(400, 0));
    assert_eq!(sim.roles(), (1, 2));
    let settled = sim.roles_changed();
    // 400 views are 0.8 s per tick, 30 direct ones 2.4 s: two workers must sample.
    (0..3).for_each(|_| sim.second(400, 30));
    assert_eq!(sim.roles_changed(), settled, "the dwell is not over");
    (0..10).for_each(|_| sim.second(400, 30));
    assert_eq!(sim.roles(), (2, 1));
    assert_eq!(sim.roles_changed(), settled + 1);
    (0..20).for_each(|_| sim.second(400, 0));
    assert_eq!(sim.roles(), (1, 2));
    assert_eq!(sim.roles_changed(), settled + 2);
    (0..20).for_each(|_| sim.second(0, 20));
    assert_eq!(sim.roles(), (3, 0), "only direct views: all workers render");
    sim.second(400, 20);
    sim.second(400, 20);
    let (samplers, compositors) = sim.roles();
    assert!(samplers >= 1 && compositors >= 1, "views without a compositor do not wait for the dwell");
    assert!(sim.refused.is_empty());
}

#[test]
fn noise_around_a_boundary_changes_no_role() {
    let mut sim = Sim::with_workers(3);
    // a·(P − K) = b·(K − 1) at K = 2: a tie between one sampler and two.
    sim.view_ms = 4.0;
    (0..10).for_each(|_| sim.second(200, 10));
    let settled = sim.roles_changed();
    for i in 0..120_usize {
        let tremble = (i * 7919) % 13;
        sim.view_ms = 4.0 * (0.94 + 0.01 * tremble as f64);
        sim.second(194 + tremble, 10);
    }
    assert_eq!(sim.roles_changed(), settled);
}

#[test]
fn a_worker_that_changes_its_role_drains_first() {
    let mut sim = Sim::with_workers(3);
    (0..10).for_each(|_| sim.second(400, 0));
    for worker in sim.workers.values_mut() {
        worker.obedient = false;
    }
    (0..10).for_each(|_| sim.second(400, 30));
    let status = sim.core.status();
    let changing: Vec<_> = status.workers.iter().filter(|w| w.role() == v1::Role::Draining).collect();
    assert_eq!(changing.len(), 1);
    let name = changing[0].id.clone();
    let id = sim.workers.iter().find(|(_, w)| w.name == name).map(|(id, _)| *id).unwrap();
    for direct in [false, true] {
        for _ in 0..20 {
            let view_id = sim.ask(direct);
            assert_ne!(sim.orders[&view_id].worker, id);
        }
    }
    sim.answer_all();
    sim.workers.get_mut(&id).unwrap().obedient = true;
    sim.report(id);
    assert!(sim.core.status().workers.iter().all(|w| w.role() != v1::Role::Draining));
    let to_it = (0..20).filter(|_| {
        let view_id = sim.ask(true);
        sim.orders[&view_id].worker == id
    });
    assert!(to_it.count() > 0);
}

#[test]
fn a_silent_worker_is_lost_when_its_lease_ends() {
    let mut sim = Sim::with_workers(2);
    let silent = *sim.workers.keys().next().unwrap();
    let other = *sim.workers.keys().last().unwrap();
    for _ in 0..19 {
        sim.now = sim.now.after(Duration::from_millis(250));
        sim.report(other);
        sim.step(Event::Tick);
    }
    assert!(sim.expelled.is_empty());
    sim.now = sim.now.after(Duration::from_millis(250));
    sim.step(Event::Tick);
    assert_eq!(sim.expelled, [silent]);
    assert_eq!(sim.roles(), (1, 1));
    // It was only slow: reports on its old stream are answered by ending that.
    sim.step(Event::Reported { worker: silent, report: Report::default() });
    assert_eq!(sim.expelled, [silent, silent]);
}

/// Time passes in which all workers but one report.
fn all_but(sim: &mut Sim, silent: WorkerId, quarters: u32) {
    for _ in 0..quarters {
        sim.now = sim.now.after(Duration::from_millis(250));
        let others: Vec<WorkerId> = sim.workers.keys().copied().filter(|id| *id != silent).collect();
        others.into_iter().for_each(|id| sim.report(id));
        sim.step(Event::Tick);
    }
}

#[test]
fn the_views_of_a_suspected_worker_are_retried_before_it_is_lost() {
    let mut sim = Sim::with_workers(3);
    let view_id = sim.ask(true);
    let hangs = sim.orders[&view_id].worker;
    let (address, roles) = (sim.orders[&view_id].address.clone(), sim.roles());
    all_but(&mut sim, hangs, 2);
    assert_eq!(sim.orders[&view_id].worker, hangs, "a moment's silence is nothing");
    all_but(&mut sim, hangs, 1);
    assert_ne!(sim.orders[&view_id].worker, hangs);
    assert!(sim.expelled.is_empty() && sim.roles() == roles, "its place is kept");
    let suspected = |sim: &Sim| {
        let others = sim.workers.iter().filter(|(id, _)| **id != hangs);
        others.map(|(_, w)| w.assignments.last().unwrap().suspected.clone()).collect::<Vec<_>>()
    };
    assert!(
        suspected(&sim).iter().all(|suspected| *suspected == [address.clone()]),
        "other workers do not wait for it"
    );
    for direct in [false, true, false, true] {
        let next = sim.ask(direct);
        assert_ne!(sim.orders[&next].worker, hangs);
        assert!(sim.orders[&next].sources.iter().all(|s| !s.addresses.contains(&address)));
    }
    sim.answer_all();
    // It was only slow.
    sim.report(hangs);
    all_but(&mut sim, hangs, 1);
    assert!(suspected(&sim).iter().all(Vec::is_empty));
    let back = (0..8).filter(|_| {
        let next = sim.ask(true);
        sim.orders[&next].worker == hangs
    });
    assert!(back.count() > 0);
    assert_eq!((sim.expelled.len(), sim.core.status().counts().workers_lost), (0, 0));
}

#[test]
fn a_suspected_worker_gets_no_new_prefetch_list() {
    let mut sim = Sim::with_workers(3);
    // Prefetch lists hold refinements and samples of the next version.
    let lists = |sim: &Sim| -> Vec<Vec<Source>> {
        sim.workers.values().map(|w| w.assignments.last().unwrap().prefetch.clone()).collect()
    };
    for _ in 0..40 {
        let view_id = sim.ask(false);
        sim.answer_with(view_id, 2000);
    }
    for _ in 0..8 {
        sim.now = sim.now.after(Duration::from_millis(250));
        sim.report_all();
        sim.step(Event::Tick);
    }
    let before = lists(&sim);
    assert!(before.iter().any(|list| !list.is_empty()), "nothing is prefetched: {before:?}");
    // It is the only sampler.
    assert_eq!(sim.roles().0, 1);
    let view_id = sim.ask(true);
    let sampler = sim.orders[&view_id].worker;
    sim.answer(view_id);
    let assignments = sim.workers[&sampler].assignments.len();
    all_but(&mut sim, sampler, 8);
    assert_eq!(lists(&sim), before);
    assert_eq!(sim.workers[&sampler].assignments.len(), assignments, "it hears nothing while it may hang");
}

#[test]
fn views_of_hanging_workers_move_as_soon_as_one_recovers() {
    let mut sim = Sim::with_workers(2);
    let view_id = sim.ask(true);
    let has = sim.orders[&view_id].worker;
    let other = *sim.workers.keys().find(|id| **id != has).unwrap();
    for _ in 0..8 {
        sim.now = sim.now.after(Duration::from_millis(250));
        sim.step(Event::Tick);
    }
    assert_eq!(sim.orders[&view_id].worker, has, "no other worker can have it");
    sim.report(other);
    sim.step(Event::Tick);
    assert_eq!(sim.orders[&view_id].worker, other);
}

#[test]
fn after_a_pause_of_the_coordinator_no_worker_is_suspected() {
    let mut sim = Sim::with_workers(2);
    sim.step(Event::Tick);
    let view_id = sim.ask(true);
    let before = sim.orders[&view_id].attempt;
    sim.now = sim.now.after(Duration::from_secs(3));
    sim.step(Event::Tick);
    assert_eq!(sim.orders[&view_id].attempt, before);
}

#[test]
fn a_view_on_its_last_attempt_stays_with_a_suspected_worker() {
    let mut sim = Sim::with_workers(2);
    let view_id = sim.ask(true);
    let last = sim.core.config().max_attempts;
    for _ in 1..last {
        let has = sim.orders[&view_id].worker;
        all_but(&mut sim, has, 7);
        sim.report(has);
    }
    assert!(sim.refused.is_empty(), "{:?}", sim.refused);
    assert_eq!(sim.orders[&view_id].attempt, last - 1, "the last one is for a worker that is lost");
}

#[test]
fn a_worker_of_the_same_name_replaces_the_older_one() {
    let mut sim = Sim::with_workers(2);
    let old = *sim.workers.keys().next().unwrap();
    let view_id = sim.ask(true);
    assert_eq!(sim.orders[&view_id].worker, old, "the sampler");
    let new = sim.join("w0");
    assert_eq!(sim.expelled, [old]);
    sim.report(new);
    sim.step(Event::Left { worker: old });
    assert_eq!(sim.core.status().processes, 2);
    assert_ne!(sim.orders[&view_id].worker, old);
    sim.answer_all();
    assert_eq!(sim.core.status().counts().views_answered, 1);
}

#[test]
fn a_leaving_worker_finishes_its_views_and_gets_no_new_ones() {
    let mut sim = Sim::with_workers(3);
    let view_ids: Vec<ViewId> = (0..10).map(|_| sim.ask(false)).collect();
    let leaver = sim.orders[&view_ids[0]].worker;
    sim.workers.get_mut(&leaver).unwrap().report.leaving = true;
    sim.report(leaver);
    for _ in 0..20 {
        let view_id = sim.ask(false);
        assert_ne!(sim.orders[&view_id].worker, leaver);
    }
    assert_eq!(sim.core.status().processes, 2);
    sim.answer_all();
    sim.leave(leaver);
    let counters = sim.core.status().counts();
    assert_eq!((counters.views_answered, counters.workers_lost, counters.views_retried), (30, 0, 0));
}

/// Time passes in which all workers report, and one reports the time in its present piece of work.
fn at_one_piece(sim: &mut Sim, id: WorkerId, piece: Duration) {
    sim.workers.get_mut(&id).unwrap().report.piece_ms = piece.as_secs_f64() * 1e3;
    sim.now = sim.now.after(Duration::from_millis(250));
    sim.report_all();
    sim.step(Event::Tick);
}

#[test]
fn a_stuck_worker_is_suspected_if_another_one_answers() {
    let secs = Duration::from_secs_f64;
    let mut sim = Sim::with_workers(3);
    (0..4).for_each(|_| sim.second(40, 2));
    let view_id = sim.ask(true);
    let (stuck, address) = (sim.orders[&view_id].worker, sim.orders[&view_id].address.clone());
    at_one_piece(&mut sim, stuck, secs(4.9));
    assert_eq!(sim.orders[&view_id].worker, stuck);
    at_one_piece(&mut sim, stuck, secs(5.1));
    assert_ne!(sim.orders[&view_id].worker, stuck);
    let other = sim.orders[&view_id].worker;
    assert_eq!(
        sim.workers[&other].assignments.last().unwrap().suspected,
        [address],
        "other workers do not wait for it"
    );
    for direct in [false, true, false, true] {
        let next = sim.ask(direct);
        assert_ne!(sim.orders[&next].worker, stuck);
    }
    at_one_piece(&mut sim, stuck, secs(5.4));
    assert_eq!(sim.core.status().counts().views_retried, 1, "one piece of work is one suspicion");
    sim.answer_all();
    at_one_piece(&mut sim, stuck, secs(0.0));
    assert!(sim.workers[&other].assignments.last().unwrap().suspected.is_empty(), "it was only slow");
    assert!(sim.expelled.is_empty());
}

#[test]
fn work_that_is_expected_to_take_long_causes_no_suspicion() {
    let secs = Duration::from_secs_f64;
    let mut sim = Sim::with_workers(3);
    // The cost of a direct view is unknown: its device may be compiling shaders.
    let view_id = sim.ask(true);
    let busy = sim.orders[&view_id].worker;
    at_one_piece(&mut sim, busy, secs(50.0));
    assert_eq!(sim.orders[&view_id].worker, busy);
    sim.answer(view_id);
    // Two seconds each, as measured.
    sim.direct_ms = 2000.0;
    (0..8).for_each(|_| sim.second(0, 2));
    let view_id = sim.ask(true);
    let busy = sim.orders[&view_id].worker;
    at_one_piece(&mut sim, busy, secs(19.0));
    assert_eq!(sim.orders[&view_id].worker, busy);
    at_one_piece(&mut sim, busy, secs(90.0));
    assert_ne!(sim.orders[&view_id].worker, busy);
}

#[test]
fn a_single_worker_is_not_suspected_for_its_reports() {
    let mut sim = Sim::with_workers(1);
    (0..4).for_each(|_| sim.second(20, 2));
    let view_id = sim.ask(true);
    let only = sim.orders[&view_id].worker;
    at_one_piece(&mut sim, only, Duration::from_secs(200));
    assert_eq!((sim.orders[&view_id].attempt, sim.core.can_answer()), (1, true));
}

#[test]
fn a_failing_worker_pauses_and_is_then_tried_with_one_view() {
    let mut sim = Sim::with_workers(3);
    sim.answer_all();
    // A compositor, whose queue is the shortest after each failure.
    let view_id = sim.ask(false);
    let broken = sim.orders[&view_id].worker;
    sim.answer(view_id);
    // Lets it fail at its views; the number of views that it got.
    let press = |sim: &mut Sim, views: usize| {
        let asked: Vec<ViewId> = (0..views).map(|_| sim.ask(false)).collect();
        let mut given = 0;
        for view_id in asked {
            let (worker, attempt) = (sim.orders[&view_id].worker, sim.orders[&view_id].attempt);
            if worker == broken {
                given += 1;
                sim.step(Event::Failed { view_id, attempt, failure: Failure::OfWorker });
            }
            assert_ne!(sim.orders[&view_id].worker, broken, "not twice");
            sim.answer(view_id);
        }
        given
    };
    let given: usize = (0..60).map(|_| press(&mut sim, 1)).sum();
    assert_eq!(given, 3);
    let pass = |sim: &mut Sim, millis: u64| {
        for _ in 0..millis / 250 {
            sim.now = sim.now.after(Duration::from_millis(250));
            sim.report_all();
            sim.step(Event::Tick);
        }
    };
    pass(&mut sim, 750);
    assert_eq!(press(&mut sim, 20), 0);
    pass(&mut sim, 500);
    assert_eq!(press(&mut sim, 20), 1, "one is enough to find out");
    pass(&mut sim, 1500);
    assert_eq!(press(&mut sim, 20), 0, "twice as long as before");
    pass(&mut sim, 750);
    let asked: Vec<ViewId> = (0..20).map(|_| sim.ask(false)).collect();
    sim.answer_all();
    assert!(asked.iter().all(|view_id| sim.answered.contains(view_id)));
    let again = (0..20).map(|_| sim.ask(false)).collect::<Vec<_>>();
    let given = again.iter().filter(|view_id| sim.orders[view_id].worker == broken).count();
    assert!(given > 5, "it has answered: {given}");
    assert_eq!(sim.core.status().counts().views_failed, 0);
}

#[test]
fn if_all_workers_fail_they_still_get_views() {
    let mut sim = Sim::with_workers(2);
    for _ in 0..12 {
        let view_id = sim.ask(false);
        let attempt = sim.orders[&view_id].attempt;
        sim.step(Event::Failed { view_id, attempt, failure: Failure::OfWorker });
        sim.step(Event::Cancelled { view_id });
        sim.orders.remove(&view_id);
    }
    let view_id = sim.ask(false);
    assert!(sim.orders.contains_key(&view_id));
}

#[test]
fn a_cluster_of_suspected_workers_is_not_ready() {
    let mut sim = Sim::with_workers(1);
    let only = *sim.workers.keys().next().unwrap();
    assert!(sim.core.can_answer());
    all_but(&mut sim, only, 7);
    assert!(sim.expelled.is_empty() && !sim.core.can_answer());
    sim.report(only);
    assert!(sim.core.can_answer());
}

#[test]
fn a_cluster_answers_before_its_views_have_a_price_and_is_ready_for_load_with_it() {
    let mut sim = Sim::with_workers(1);
    let only = *sim.workers.keys().next().unwrap();
    let report = |sim: &mut Sim, cost| {
        let report = Report { direct_cost: cost, direct_ms: None, ..sim.workers[&only].report.clone() };
        sim.step(Event::Reported { worker: only, report });
    };
    report(&mut sim, None);
    assert!(sim.core.can_answer() && !sim.core.is_ready_for_load());
    report(&mut sim, Some(quality::Cost { fixed_ms: 1.0, ms_per_megapixel: 10.0 }));
    assert!(sim.core.is_ready_for_load());
}
