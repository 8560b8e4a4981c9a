//! The machine driven by events alone: workers that come and go, demand that rises and falls.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{Camera, Outputs, PlanRequest, SampleId, View};
use glam::DVec3;
use proptest::prelude::*;

use super::tests::set_info;
use super::*;

/// A coordinator's core with workers that do as they are told, on a clock that only tests move.
struct Sim {
    core: Core,
    now: Uptime,
    next: u64,
    workers: BTreeMap<WorkerId, SimWorker>,
    /// Views in work, by ticket.
    orders: BTreeMap<Ticket, Order>,
    refused: Vec<(Ticket, Fault)>,
    answered: BTreeSet<Ticket>,
    expelled: Vec<WorkerId>,
    /// Costs that workers report.
    view_ms: f64,
    direct_ms: f64,
}

#[derive(Debug, Clone, Default)]
struct SimWorker {
    name: String,
    report: Report,
    told: Vec<Assignment>,
    /// Whether it acknowledges at its next report.
    obedient: bool,
}

impl Sim {
    fn new(config: Config) -> Self {
        Self {
            core: Core::new(config, Arc::new(set_info())),
            now: Uptime::default(),
            next: 1,
            workers: BTreeMap::new(),
            orders: BTreeMap::new(),
            refused: Vec::new(),
            answered: BTreeSet::new(),
            expelled: Vec::new(),
            view_ms: 2.0,
            direct_ms: 80.0,
        }
    }

    fn with_workers(count: usize) -> Self {
        let mut sim = Self::new(Config::default());
        for i in 0..count {
            sim.join(&format!("w{i}"));
            sim.report_all();
        }
        sim
    }

    fn step(&mut self, event: Event) {
        for action in self.core.step(event, self.now) {
            match action {
                Action::Assign { worker, assignment } => {
                    if let Some(worker) = self.workers.get_mut(&worker) {
                        worker.told.push(assignment);
                    }
                }
                Action::Expel { worker, .. } => {
                    self.workers.remove(&worker);
                    self.orders.retain(|_, order| order.worker != worker);
                    self.expelled.push(worker);
                }
                Action::Dispatch { ticket, order } => {
                    assert!(!self.answered.contains(&ticket), "an answered view was sent again");
                    assert!(self.workers.contains_key(&order.worker), "sent to a worker that is gone");
                    self.orders.insert(ticket, *order);
                }
                Action::Refuse { ticket, fault } => {
                    assert!(!self.answered.contains(&ticket), "an answered view was refused");
                    assert!(!self.refused.iter().any(|(t, _)| *t == ticket), "refused twice");
                    self.orders.remove(&ticket);
                    self.refused.push((ticket, fault));
                }
            }
        }
    }

    fn join(&mut self, name: &str) -> WorkerId {
        let id = WorkerId(self.next);
        self.next += 1;
        let worker = SimWorker { name: name.to_owned(), obedient: true, ..SimWorker::default() };
        self.workers.insert(id, worker);
        let hello = Hello {
            name: name.to_owned(),
            pid: id.0 as u32,
            address: format!("http://{name}"),
            device: "device".to_owned(),
            cores: 1,
        };
        self.step(Event::Joined { worker: id, hello });
        id
    }

    /// Its process ends, and with it what it was working on.
    fn leave(&mut self, id: WorkerId) {
        self.workers.remove(&id);
        self.orders.retain(|_, order| order.worker != id);
        self.step(Event::Left { worker: id });
    }

    fn report(&mut self, id: WorkerId) {
        let Some(worker) = self.workers.get_mut(&id) else { return };
        if let Some(told) = worker.told.last().filter(|_| worker.obedient) {
            worker.report.applied = told.sequence;
        }
        worker.report.sample_ms = Some(self.direct_ms);
        worker.report.direct_ms = Some(self.direct_ms);
        worker.report.view_ms = Some(self.view_ms);
        let report = worker.report.clone();
        self.step(Event::Reported { worker: id, report });
    }

    fn report_all(&mut self) {
        for id in self.workers.keys().copied().collect::<Vec<_>>() {
            self.report(id);
        }
    }

    fn ask(&mut self, direct: bool) -> Ticket {
        self.ask_with(direct, None)
    }

    fn ask_with(&mut self, direct: bool, deadline: Option<Duration>) -> Ticket {
        let ticket = Ticket(self.next);
        self.next += 1;
        let view = Box::new(View {
            camera: Camera::look_at(DVec3::new(3.0, 30.0, 4.0), DVec3::new(2.0, 0.0, 2.0)),
            width: 200,
            height: 150,
            outputs: Outputs::COLOR,
            plan: PlanRequest { direct, ..PlanRequest::default() },
            pin: None,
        });
        self.step(Event::Asked { ticket, view, deadline });
        ticket
    }

    fn answer(&mut self, ticket: Ticket) {
        let Some(order) = self.orders.remove(&ticket) else { return };
        if let Some(worker) = self.workers.get_mut(&order.worker) {
            match &order.plan {
                argus_scene::Plan::Direct { .. } => {
                    worker.report.views_direct += 1;
                    worker.report.sampling_busy_ms += self.direct_ms;
                }
                argus_scene::Plan::Warp { samples, .. } => {
                    worker.report.views_composed += 1;
                    worker.report.compositing_busy_ms += self.view_ms;
                    let held: BTreeSet<SampleId> =
                        worker.report.held.iter().chain(samples).copied().collect();
                    worker.report.held = held.into_iter().collect();
                }
            }
        }
        self.answered.insert(ticket);
        self.step(Event::Answered { ticket, attempt: order.attempt });
    }

    fn answer_all(&mut self) {
        while let Some(ticket) = self.orders.keys().next().copied() {
            self.answer(ticket);
        }
    }

    /// A second of demand, spread over four reports.
    fn second(&mut self, views: usize, direct: usize) {
        for quarter in 0..4 {
            let share = |n: usize| n * (quarter + 1) / 4 - n * quarter / 4;
            (0..share(views)).for_each(|_| _ = self.ask(false));
            (0..share(direct)).for_each(|_| _ = self.ask(true));
            self.answer_all();
            self.now = self.now.after(Duration::from_millis(250));
            self.report_all();
            self.step(Event::Tick);
        }
    }

    fn roles(&self) -> (u32, u32) {
        let status = self.core.status();
        (status.samplers, status.compositors)
    }

    fn roles_changed(&self) -> u64 {
        self.core.status().counters.roles_changed
    }
}

#[test]
fn one_worker_alone_plays_both_roles_and_a_second_takes_one_of_them() {
    let mut sim = Sim::new(Config::default());
    assert_eq!(sim.roles(), (0, 0));
    let waiting = sim.ask(false);
    assert!(sim.orders.is_empty(), "nobody there yet");
    let first = sim.join("a");
    assert!(sim.orders.is_empty(), "not ready yet");
    sim.report(first);
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.orders[&waiting].sources.len(), 4);
    assert!(sim.orders[&waiting].sources.iter().all(|s| s.addresses.is_empty()), "it renders them itself");
    let second = sim.join("b");
    sim.report(second);
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.workers[&first].told.last().unwrap().role, Role::Sampler);
    assert_eq!(sim.workers[&second].told.last().unwrap().role, Role::Compositor);
    sim.step(Event::Left { worker: second });
    assert_eq!(sim.roles(), (1, 1));
    assert_eq!(sim.workers[&first].told.last().unwrap().role, Role::Both);
}

#[test]
fn a_role_moves_when_demand_moves_and_only_then() {
    let mut sim = Sim::with_workers(3);
    (0..10).for_each(|_| sim.second(400, 0));
    assert_eq!(sim.roles(), (1, 2));
    let settled = sim.roles_changed();
    // 400 views are 0.8 s per tick, 30 direct ones 2.4 s: two shall sample.
    (0..3).for_each(|_| sim.second(400, 30));
    assert_eq!(sim.roles_changed(), settled, "the dwell is not over");
    (0..10).for_each(|_| sim.second(400, 30));
    assert_eq!(sim.roles(), (2, 1));
    assert_eq!(sim.roles_changed(), settled + 1);
    (0..20).for_each(|_| sim.second(400, 0));
    assert_eq!(sim.roles(), (1, 2));
    assert_eq!(sim.roles_changed(), settled + 2);
    (0..20).for_each(|_| sim.second(0, 20));
    assert_eq!(sim.roles(), (3, 0), "direct views alone: everybody renders");
    sim.second(400, 20);
    sim.second(400, 20);
    let (samplers, compositors) = sim.roles();
    assert!(samplers >= 1 && compositors >= 1, "views without a compositor do not wait for the dwell");
    assert!(sim.refused.is_empty());
}

#[test]
fn noise_about_a_boundary_moves_nothing() {
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
fn a_worker_that_changes_its_role_gets_nothing_new_until_it_has_finished() {
    let mut sim = Sim::with_workers(3);
    (0..10).for_each(|_| sim.second(400, 0));
    for worker in sim.workers.values_mut() {
        worker.obedient = false;
    }
    (0..10).for_each(|_| sim.second(400, 30));
    let status = sim.core.status();
    let changing: Vec<_> = status.workers.iter().filter(|w| w.draining).collect();
    assert_eq!(changing.len(), 1);
    let name = changing[0].hello.name.clone();
    let id = sim.workers.iter().find(|(_, w)| w.name == name).map(|(id, _)| *id).unwrap();
    for direct in [false, true] {
        for _ in 0..20 {
            let ticket = sim.ask(direct);
            assert_ne!(sim.orders[&ticket].worker, id);
        }
    }
    sim.answer_all();
    sim.workers.get_mut(&id).unwrap().obedient = true;
    sim.report(id);
    assert!(sim.core.status().workers.iter().all(|w| !w.draining));
    let to_it = (0..20).filter(|_| {
        let ticket = sim.ask(true);
        sim.orders[&ticket].worker == id
    });
    assert!(to_it.count() > 0);
}

#[test]
fn the_views_of_a_lost_worker_are_sent_to_another() {
    let mut sim = Sim::with_workers(3);
    let tickets: Vec<Ticket> = (0..40).map(|_| sim.ask(false)).collect();
    let victim = sim.orders[&tickets[0]].worker;
    let before: Vec<Ticket> = tickets.iter().filter(|t| sim.orders[t].worker == victim).copied().collect();
    assert!(before.len() > 1);
    sim.leave(victim);
    for ticket in &before {
        let order = &sim.orders[ticket];
        assert_ne!(order.worker, victim);
        assert_eq!(order.attempt, 2);
    }
    sim.answer_all();
    let counters = sim.core.status().counters;
    assert_eq!(counters.views_answered, 40);
    assert_eq!((counters.views_retried, counters.workers_lost), (before.len() as u64, 1));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_worker_that_falls_silent_is_lost_when_its_lease_is_over() {
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
    // It was only slow: what its old stream still says is answered by ending it.
    sim.step(Event::Reported { worker: silent, report: Report::default() });
    assert_eq!(sim.expelled, [silent, silent]);
}

#[test]
fn a_worker_of_the_same_name_replaces_the_older_one() {
    let mut sim = Sim::with_workers(2);
    let old = *sim.workers.keys().next().unwrap();
    let ticket = sim.ask(true);
    assert_eq!(sim.orders[&ticket].worker, old, "the sampler");
    let new = sim.join("w0");
    assert_eq!(sim.expelled, [old]);
    sim.report(new);
    sim.step(Event::Left { worker: old });
    assert_eq!(sim.core.status().processes, 2);
    assert_ne!(sim.orders[&ticket].worker, old);
    sim.answer_all();
    assert_eq!(sim.core.status().counters.views_answered, 1);
}

#[test]
fn what_comes_twice_or_too_late_is_ignored() {
    let mut sim = Sim::with_workers(3);
    let ticket = sim.ask(false);
    let first = sim.orders[&ticket].clone();
    sim.step(Event::Failed { ticket, attempt: first.attempt, failure: Failure::TryElsewhere });
    let second = sim.orders[&ticket].clone();
    assert_ne!(second.worker, first.worker);
    sim.step(Event::Failed { ticket, attempt: first.attempt, failure: Failure::Final });
    sim.step(Event::Answered { ticket, attempt: first.attempt });
    assert_eq!(sim.core.views_in_flight(), 1);
    sim.answer(ticket);
    sim.step(Event::Answered { ticket, attempt: second.attempt });
    sim.step(Event::Cancelled { ticket });
    let counters = sim.core.status().counters;
    assert_eq!((counters.views_answered, counters.views_failed, counters.views_retried), (1, 0, 1));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn a_view_at_which_every_worker_fails_is_given_up() {
    let mut sim = Sim::with_workers(3);
    let ticket = sim.ask(false);
    for attempt in 1..=4 {
        sim.step(Event::Failed { ticket, attempt, failure: Failure::TryElsewhere });
    }
    assert!(matches!(&sim.refused[..], [(t, Fault::Unavailable(_))] if *t == ticket));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn one_view_too_many_is_turned_away_at_once() {
    let mut sim = Sim::new(Config { max_views: 10, max_views_per_worker: 3, ..Config::default() });
    let worker = sim.join("a");
    sim.report(worker);
    let tickets: Vec<Ticket> = (0..12).map(|_| sim.ask(false)).collect();
    assert_eq!(sim.orders.len(), 3);
    assert_eq!(sim.refused.len(), 2);
    assert!(sim.refused.iter().all(|(_, f)| matches!(f, Fault::Overloaded { .. })));
    assert_eq!(sim.core.status().counters.views_rejected, 2);
    sim.answer_all();
    assert_eq!(sim.answered.len(), 10, "those admitted are answered, first come first served");
    assert!(tickets[..10].iter().all(|t| sim.answered.contains(t)));
}

#[test]
fn deadlines_patience_and_cancellation_end_a_wait() {
    let mut sim = Sim::new(Config::default());
    let hurried = sim.ask_with(false, Some(Duration::from_millis(100)));
    let patient = sim.ask(false);
    let cancelled = sim.ask(true);
    sim.step(Event::Cancelled { ticket: cancelled });
    sim.now = sim.now.after(Duration::from_millis(100));
    sim.step(Event::Tick);
    assert!(matches!(&sim.refused[..], [(t, Fault::Deadline(_))] if *t == hurried));
    sim.now = sim.now.after(Duration::from_secs(30));
    sim.step(Event::Tick);
    assert!(matches!(&sim.refused[1..], [(t, Fault::Unavailable(_))] if *t == patient));
    assert_eq!(sim.core.views_in_flight(), 0);
}

#[test]
fn samples_are_counted_once_and_again_only_when_nobody_holds_them() {
    let mut sim = Sim::with_workers(3);
    (0..30).for_each(|_| sim.second(40, 0));
    assert_eq!(sim.core.status().samples_per_tick, 0.0, "a static scene is sampled once");
    let ticket = sim.ask(false);
    let order = &sim.orders[&ticket];
    assert!(order.sources.iter().all(|s| !s.addresses.is_empty()), "the other holder or the sampler");
    // Everybody who held them leaves; those that come render anew.
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
    assert!(sim.answered.contains(&ticket));
}

#[test]
fn views_spread_over_compositors_and_ask_the_same_sampler_for_the_same_sample() {
    let mut sim = Sim::with_workers(4);
    let sampler = sim
        .core
        .status()
        .workers
        .iter()
        .find(|w| w.role == Some(Role::Sampler))
        .map(|w| w.hello.address.clone())
        .unwrap();
    let tickets: Vec<Ticket> = (0..30).map(|_| sim.ask(false)).collect();
    let mut count = BTreeMap::<WorkerId, usize>::new();
    for ticket in &tickets {
        let order = &sim.orders[ticket];
        *count.entry(order.worker).or_default() += 1;
        assert!(order.sources.iter().all(|s| s.addresses == [sampler.clone()]));
    }
    assert_eq!(count.len(), 3);
    assert!(count.values().all(|n| (8..=12).contains(n)), "{count:?}");
}

#[test]
fn a_worker_that_says_it_leaves_finishes_and_gets_nothing_new() {
    let mut sim = Sim::with_workers(3);
    let tickets: Vec<Ticket> = (0..10).map(|_| sim.ask(false)).collect();
    let leaver = sim.orders[&tickets[0]].worker;
    sim.workers.get_mut(&leaver).unwrap().report.leaving = true;
    sim.report(leaver);
    for _ in 0..20 {
        let ticket = sim.ask(false);
        assert_ne!(sim.orders[&ticket].worker, leaver);
    }
    assert_eq!(sim.core.status().processes, 2);
    sim.answer_all();
    sim.leave(leaver);
    let counters = sim.core.status().counters;
    assert_eq!((counters.views_answered, counters.workers_lost, counters.views_retried), (30, 0, 0));
}

#[test]
fn a_draining_coordinator_turns_new_views_away_and_answers_the_old() {
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
    let ticket = sim.ask(false);
    let order = sim.orders[&ticket].clone();
    let set = set_info();
    let mut pinned = |device: &str| {
        let ticket = Ticket(sim.next);
        sim.next += 1;
        let view = Box::new(View {
            camera: Camera::look_at(DVec3::new(3.0, 30.0, 4.0), DVec3::new(2.0, 0.0, 2.0)),
            width: 20,
            height: 15,
            outputs: Outputs::COLOR,
            plan: PlanRequest::default(),
            pin: Some(argus_scene::Provenance {
                scene: set.scene,
                epoch: set.epoch,
                generation: set.generation,
                plan: order.plan.clone(),
                device: device.to_owned(),
            }),
        });
        sim.step(Event::Asked { ticket, view, deadline: None });
        ticket
    };
    let (same, other, any) = (pinned("device"), pinned("another"), pinned(""));
    assert_eq!(sim.orders[&same].plan, order.plan);
    assert_eq!(sim.orders[&any].plan, order.plan);
    assert!(matches!(&sim.refused[..], [(t, Fault::Pin(_))] if *t == other));
}

/// What may happen, in any order.
#[derive(Debug, Clone)]
enum Step {
    Join(u8),
    Leave(usize),
    Report,
    Ask(bool),
    Answer(usize),
    Fail(usize, bool),
    Cancel(usize),
    Pass(u16),
}

fn any_step() -> impl Strategy<Value = Step> {
    prop_oneof![
        2 => (0u8..6).prop_map(Step::Join),
        1 => any::<usize>().prop_map(Step::Leave),
        4 => Just(Step::Report),
        8 => any::<bool>().prop_map(Step::Ask),
        6 => any::<usize>().prop_map(Step::Answer),
        2 => (any::<usize>(), any::<bool>()).prop_map(|(i, f)| Step::Fail(i, f)),
        1 => any::<usize>().prop_map(Step::Cancel),
        3 => (0u16..3000).prop_map(Step::Pass),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever happens, every view ends in exactly one of: answered, failed, refused, cancelled, in flight;
    /// and two ready workers or more always cover both roles, unless all render directly.
    #[test]
    fn no_view_is_lost_or_answered_twice(steps in prop::collection::vec(any_step(), 1..200)) {
        let mut sim = Sim::new(Config { max_views: 50, max_views_per_worker: 5, ..Config::default() });
        let (mut asked, mut ended) = (0_usize, 0_usize);
        let nth = |orders: &BTreeMap<Ticket, Order>, i: usize| {
            let count = orders.len().max(1);
            orders.keys().nth(i % count).copied()
        };
        for step in steps {
            match step {
                Step::Join(name) => drop(sim.join(&format!("w{name}"))),
                Step::Leave(i) => {
                    let count = sim.workers.len().max(1);
                    if let Some(worker) = sim.workers.keys().nth(i % count).copied() {
                        sim.leave(worker);
                    }
                }
                Step::Report => sim.report_all(),
                Step::Ask(direct) => {
                    asked += 1;
                    sim.ask(direct);
                }
                Step::Answer(i) => {
                    if let Some(ticket) = nth(&sim.orders, i) {
                        sim.answer(ticket);
                    }
                }
                Step::Fail(i, last) => {
                    if let Some(ticket) = nth(&sim.orders, i) {
                        let attempt = sim.orders[&ticket].attempt;
                        let failure = if last { Failure::Final } else { Failure::TryElsewhere };
                        sim.orders.remove(&ticket);
                        ended += usize::from(last);
                        sim.step(Event::Failed { ticket, attempt, failure });
                    }
                }
                Step::Cancel(i) => {
                    if let Some(ticket) = nth(&sim.orders, i) {
                        sim.orders.remove(&ticket);
                        ended += 1;
                        sim.step(Event::Cancelled { ticket });
                    }
                }
                Step::Pass(ms) => {
                    sim.now = sim.now.after(Duration::from_millis(ms.into()));
                    sim.step(Event::Tick);
                }
            }
            let closed = sim.answered.len() + sim.refused.len() + ended;
            prop_assert_eq!(asked, closed + sim.core.views_in_flight());
            let status = sim.core.status();
            if status.processes >= 2 && sim.core.split != balance::Split::AllDirect {
                prop_assert!(status.samplers >= 1 && status.compositors >= 1, "{:?}", status.workers);
            }
        }
        // Given workers and time enough, what is in flight is answered or refused.
        for round in 0..20 {
            if sim.workers.is_empty() {
                sim.join(&format!("late{round}"));
            }
            sim.report_all();
            sim.answer_all();
        }
        prop_assert_eq!(sim.core.views_in_flight(), 0);
    }
}
