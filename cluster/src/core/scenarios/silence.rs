//! Missing reports: from one worker or from all, for a moment or for good.

use std::time::Duration;

use super::sim::Sim;
use crate::core::*;

/// Time step of the simulation, milliseconds.
const STEP: u64 = 10;

/// Intervals between reports of a worker and between ticks, milliseconds.
const REPORT: u64 = 250;
const TICK: u64 = 100;

/// Whether a punctual worker reports now; each worker has its own phase.
fn on_time(worker: WorkerId, millis: u64) -> bool {
    (millis + 70 * worker.0).is_multiple_of(REPORT)
}

/// Lets time pass, in which `reports` tells which worker reports at which millisecond of uptime, until `enough` at
/// most.
fn pass(sim: &mut Sim, millis: u64, reports: impl Fn(WorkerId, u64) -> bool, enough: impl Fn(&Sim) -> bool) {
    let began = sim.now.0.as_millis() as u64;
    for now in (began + STEP..=began + millis).step_by(STEP as usize) {
        sim.now = Uptime(Duration::from_millis(now));
        let speak: Vec<WorkerId> = sim.workers.keys().copied().filter(|id| reports(*id, now)).collect();
        speak.into_iter().for_each(|id| sim.report(id));
        if now.is_multiple_of(TICK) {
            sim.step(Event::Tick);
        }
        if enough(sim) {
            return;
        }
    }
}

fn retried(sim: &Sim) -> u64 {
    sim.core.status().counts().views_retried
}

/// Three punctual workers, a view, and the worker that has it.
fn busy() -> (Sim, ViewId, WorkerId) {
    let mut sim = Sim::with_workers(3);
    pass(&mut sim, 3000, on_time, |_| false);
    let view_id = sim.ask(true);
    let has = sim.orders[&view_id].worker;
    (sim, view_id, has)
}

#[test]
fn the_views_of_a_hanging_worker_are_retried_within_a_second() {
    for began in (0..REPORT).step_by(STEP as usize) {
        let (mut sim, view_id, has) = busy();
        pass(&mut sim, began, on_time, |_| false);
        let hangs = sim.now;
        let others = |id, now| id != has && on_time(id, now);
        pass(&mut sim, 1000, others, |sim| sim.orders[&view_id].worker != has);
        assert_ne!(sim.orders[&view_id].worker, has, "after {began} ms");
        let took = sim.now.since(hangs);
        assert!(took >= Duration::from_millis(500), "three reports were due: {took:?}");
        assert!(sim.expelled.is_empty());
    }
}

#[test]
fn a_late_report_moves_no_view() {
    for late in (0..2 * REPORT).step_by(STEP as usize) {
        let (mut sim, _, has) = busy();
        let due = (3000..).step_by(STEP as usize).find(|now| on_time(has, *now)).unwrap();
        // The reports that were due after it come with it.
        let reports = |id, now| match id == has && (due..=due + late).contains(&now) {
            true => now == due + late,
            false => on_time(id, now),
        };
        pass(&mut sim, 3000, reports, |_| false);
        assert_eq!(retried(&sim), 0, "{late} ms late");
    }
}

#[test]
fn while_all_workers_are_late_none_is_suspected_early() {
    let (mut sim, view_id, has) = busy();
    // All workers are starved: each reports once in 800 ms, one after the other.
    let seldom = |id: WorkerId, now: u64| (now + 70 * id.0).is_multiple_of(800);
    pass(&mut sim, 8000, seldom, |_| false);
    assert_eq!((retried(&sim), sim.orders[&view_id].worker), (0, has));
    // It also holds for a moment afterwards, when some are on time again.
    pass(&mut sim, 1600, |id, now| if id == has { seldom(id, now) } else { on_time(id, now) }, |_| false);
    assert_eq!((retried(&sim), sim.orders[&view_id].worker), (0, has));
}

#[test]
fn a_worker_that_is_often_late_is_suspected_only_once() {
    let (mut sim, _, has) = busy();
    let often = |id: WorkerId, now: u64| match id == has {
        true => now.is_multiple_of(1000),
        false => on_time(id, now),
    };
    let mut first = None;
    for _ in 0..20 {
        sim.answer_all();
        (0..6).for_each(|_| _ = sim.ask(true));
        let given = sim.orders.values().filter(|order| order.worker == has).count() as u64;
        assert!(given > 0, "it was heard of just now");
        first.get_or_insert(given);
        pass(&mut sim, 1000, often, |_| false);
    }
    assert_eq!(Some(retried(&sim)), first, "those of the first time, and it is known by then");
    // It is trusted after each report. After a while of punctual reports, it is suspected as fast as any other
    // worker.
    pass(&mut sim, 8000, on_time, |_| false);
    let others = |id, now| id != has && on_time(id, now);
    let answers = |sim: &Sim| sim.core.workers().get(has).is_some_and(|worker| worker.answers());
    assert!(answers(&sim));
    pass(&mut sim, 1000, others, |sim| !answers(sim));
    assert!(!answers(&sim));
    pass(&mut sim, REPORT, on_time, |_| false);
    assert!(answers(&sim));
}

#[test]
fn after_a_pause_of_the_whole_machine_no_worker_is_suspected() {
    // The duration of the pause, and the delay between workers after it. Leases are not part of this test.
    let pauses = [(100, 80), (200, 80), (300, 80), (400, 240), (800, 240), (1500, 240), (4000, 240)];
    for (paused, apart) in pauses {
        for first in 0..3 {
            let (mut sim, view_id, has) = busy();
            pass(&mut sim, 70 * (first + 1), on_time, |_| false);
            sim.now = sim.now.after(Duration::from_millis(paused));
            let awake = sim.now.0.as_millis() as u64 + STEP;
            let reports = |id: WorkerId, now: u64| {
                let goes_on = awake + apart * ((id.0 + first) % 3);
                now == goes_on || now > goes_on && on_time(id, now)
            };
            pass(&mut sim, 2000, reports, |_| false);
            assert_eq!((retried(&sim), sim.orders[&view_id].worker), (0, has), "{paused} ms, {first}");
            assert!(sim.expelled.is_empty());
        }
    }
}

#[test]
fn workers_that_fall_silent_together_are_suspected_later_and_finally_lost() {
    let (mut sim, view_id, has) = busy();
    pass(&mut sim, 1200, |_, _| false, |_| false);
    assert!(sim.core.can_answer(), "it may be this process that hears nothing");
    pass(&mut sim, 400, |_, _| false, |_| false);
    assert!(!sim.core.can_answer());
    assert_eq!(sim.orders[&view_id].worker, has, "no other worker can have it");
    pass(&mut sim, 3600, |_, _| false, |_| false);
    assert_eq!(sim.expelled.len(), 3);
}
