//! The simulated cluster: a queue of events between the coordinator's core, simulated workers and clients.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_cluster::core::{Action, Config, Core, Event, Failure, Uptime, ViewId, WorkerId};
use argus_cluster::worker::policy::threads_beside;
use argus_proto::Fault;
use argus_scene::{Camera, PlanRequest, SampleSetInfo, View};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

mod event_queue;
mod lifecycle;
mod worker_messages;

use self::event_queue::{Due, SimEvent};
use super::host::{Host, Link, transfer};
use super::parameters::{Machines, Parameters};
use super::work::{Attempt, Message, Task};
use super::worker::Worker;
use super::{Nanos, nanos};

/// A load: what clients ask for, and what they do with the answers.
pub(super) trait Load {
    /// A wake-up that the load asked for.
    fn wake(&mut self, tag: u64, world: &mut World);
    /// A client received its frame.
    fn answered(&mut self, client: u64, latency: Nanos, world: &mut World);
    /// A client's view was refused; `overload` tells whether because of overload.
    fn refused(&mut self, client: u64, overload: bool, world: &mut World);
}

/// A view that a client waits for.
struct Asked {
    client: u64,
    at: Nanos,
    answered: bool,
}

/// Counts since the start.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) asked: u64,
    pub(super) answered: u64,
    pub(super) overloaded: u64,
    pub(super) failed: u64,
    /// Views with at least one sample that had to be fetched or rendered after their dispatch.
    pub(super) waited_for_samples: u64,
    pub(super) samples_sent: u64,
    /// Longest latency of a frame, in nanoseconds.
    pub(super) slowest: Nanos,
    /// Real seconds spent in the core, and its events.
    pub(super) core_secs: f64,
    pub(super) core_steps: u64,
}

/// A coordinator's core with simulated workers and clients.
pub(super) struct World {
    pub(super) core: Core,
    pub(super) parameters: Parameters,
    pub(super) now: Nanos,
    pub(super) workers: Vec<Worker>,
    pub(super) tally: Tally,
    pub(super) rng: SmallRng,
    /// Random variation of task times, as a share of their mean.
    pub(super) noise: f64,
    heap: BinaryHeap<Reverse<Due>>,
    number: u64,
    hosts: Vec<Host<Task>>,
    links: Vec<Link>,
    slots: HashMap<WorkerId, usize>,
    /// Messages that reached a paused worker, and its tasks that ended meanwhile, by slot.
    while_paused: HashMap<usize, (Vec<Message>, Vec<Task>)>,
    views: HashMap<ViewId, Asked>,
    next_id: u64,
    load: Option<Box<dyn Load>>,
    report_every: Nanos,
    tick_every: Nanos,
}

/// Host numbers before the workers': the coordinator's machine and the clients'.
const COORDINATOR: usize = 0;
const CLIENTS: usize = 1;
const WORKERS: usize = 2;

impl World {
    /// A cluster whose workers have not joined yet.
    pub(super) fn new(config: Config, set: SampleSetInfo, parameters: Parameters, workers: usize) -> Self {
        let report_every = nanos(config.report_interval);
        // The same tick interval as in the coordinator's shell.
        let finest = if set.epoch_secs > 0.0 { config.epoch / 5 } else { Duration::MAX };
        let period = (config.tick / 10).min(finest);
        let tick_every = nanos(period.clamp(Duration::from_millis(5), Duration::from_millis(100)));
        let (hosts, count) = match parameters.machines {
            Machines::Shared { cores } => (vec![Host::new(cores)], 1),
            Machines::Each { cores } => {
                let cores = |host| if host == CLIENTS { u32::MAX } else { cores };
                ((0..WORKERS + workers).map(|host| Host::new(cores(host))).collect(), WORKERS + workers)
            }
        };
        let worker = |slot| Worker { name: format!("w{slot}"), slowness: 1.0, ..Worker::default() };
        let mut world = Self {
            core: Core::new(config, Arc::new(set)),
            parameters,
            now: 0,
            workers: (0..workers).map(worker).collect(),
            tally: Tally::default(),
            rng: SmallRng::seed_from_u64(1),
            noise: 0.1,
            heap: BinaryHeap::new(),
            number: 0,
            hosts,
            links: vec![Link::default(); count],
            slots: HashMap::new(),
            while_paused: HashMap::new(),
            views: HashMap::new(),
            next_id: 1,
            load: None,
            report_every,
            tick_every,
        };
        world.after(tick_every, SimEvent::CoreTick);
        world
    }

    /// Sets the load and wakes it at once, with tag 0.
    pub(super) fn with_load(&mut self, load: Box<dyn Load>) {
        self.load = Some(load);
        self.after(0, SimEvent::Wake { tag: 0 });
    }

    /// Ends the load: no more views are requested.
    pub(super) fn stop_load(&mut self) {
        self.load = None;
    }

    /// Runs the simulation for a time.
    pub(super) fn run_for(&mut self, time: Nanos) {
        let until = self.now + time;
        while let Some(Reverse(due)) = self.heap.peek() {
            if due.at > until {
                break;
            }
            let Some(Reverse(due)) = self.heap.pop() else { break };
            self.now = due.at;
            self.handle(due.event);
        }
        self.now = until;
    }

    /// Runs until a condition holds, tested every millisecond, for at most `most`. Returns whether it holds.
    pub(super) fn run_until(&mut self, most: Nanos, is_so: impl Fn(&Self) -> bool) -> bool {
        let until = self.now + most;
        while self.now < until {
            if is_so(self) {
                return true;
            }
            self.run_for(1_000_000);
        }
        is_so(self)
    }

    fn after(&mut self, time: Nanos, event: SimEvent) {
        self.at(self.now + time, event);
    }

    fn at(&mut self, at: Nanos, event: SimEvent) {
        self.number += 1;
        self.heap.push(Reverse(Due { at, number: self.number, event }));
    }

    fn latency(&self) -> Nanos {
        (self.parameters.latency_ms * 1e6) as Nanos
    }

    fn host_of(&self, place: usize) -> usize {
        match self.parameters.machines {
            Machines::Shared { .. } => 0,
            Machines::Each { .. } => place,
        }
    }

    /// Starts a task on the machine of a place.
    fn begin(&mut self, place: usize, ms: f64, task: Task) {
        let host = self.host_of(place);
        let spread = 1.0 + self.noise * self.rng.random_range(-1.0..1.0);
        self.hosts[host].begin(self.now, ms * spread, task);
        self.expect(host);
    }

    /// Starts a task beside a worker's render thread, or queues it if all threads are busy.
    fn begin_beside(&mut self, slot: usize, ms: f64, task: Task) {
        let (Machines::Shared { cores } | Machines::Each { cores }) = self.parameters.machines;
        let ms = ms * self.workers[slot].slowness;
        let worker = &mut self.workers[slot];
        if worker.beside >= threads_beside(cores) {
            return worker.beside_waits.push_back((ms, task));
        }
        worker.beside += 1;
        self.begin(WORKERS + slot, ms, task);
    }

    /// Ends a task beside the render thread and starts the next one.
    fn ended_beside(&mut self, slot: usize) {
        let worker = &mut self.workers[slot];
        match worker.beside_waits.pop_front() {
            Some((ms, task)) => self.begin(WORKERS + slot, ms, task),
            None => worker.beside -= 1,
        }
    }

    fn expect(&mut self, host: usize) {
        if let Some(at) = self.hosts[host].next_end() {
            let version = self.hosts[host].version;
            self.at(at.max(self.now), SimEvent::HostDone { host, version });
        }
    }

    fn send(&mut self, from: usize, to: usize, bytes: u64) -> Nanos {
        let (from, to) = (self.host_of(from), self.host_of(to));
        if to == CLIENTS {
            // Clients have as many machines as they need, so one client's reception delays no other.
            self.links[CLIENTS] = Link::default();
        }
        let rate = self.parameters.link_bytes_per_sec;
        transfer(&mut self.links, from, to, self.now, bytes, rate) + self.latency()
    }

    fn tell(&mut self, slot: usize, message: Message) {
        let life = self.workers[slot].life;
        let latency = self.latency();
        self.after(latency, SimEvent::ToWorker { slot, life, message });
    }

    // Clients.

    /// A client requests a view from its camera.
    pub(super) fn ask(&mut self, client: u64, camera: Camera, direct: bool) -> ViewId {
        let view_id = ViewId(self.next_id);
        self.next_id += 1;
        self.tally.asked += 1;
        self.views.insert(view_id, Asked { client, at: self.now, answered: false });
        let plan = match direct {
            true => PlanRequest { direct, ..PlanRequest::default() },
            false => PlanRequest::from_samples(),
        };
        let view = Box::new(View::new(camera, [200, 150], plan));
        let latency = self.latency();
        let requested =
            Event::Requested { view_id, client: client.to_string().into(), view, deadline: None, last: None };
        self.after(latency, SimEvent::ToCoordinator(Box::new(requested)));
        view_id
    }

    /// Wakes the load after a time.
    pub(super) fn wake_after(&mut self, time: Nanos, tag: u64) {
        self.after(time, SimEvent::Wake { tag });
    }

    fn with(&mut self, act: impl FnOnce(&mut dyn Load, &mut Self)) {
        if let Some(mut load) = self.load.take() {
            act(load.as_mut(), self);
            self.load = Some(load);
        }
    }

    /// Views that have no answer yet.
    pub(super) fn open_views(&self) -> usize {
        self.views.len()
    }

    // Events.

    fn handle(&mut self, event: SimEvent) {
        match event {
            SimEvent::HostDone { host, version } => {
                if self.hosts[host].version == version {
                    for task in self.hosts[host].ended(self.now) {
                        self.done(task);
                    }
                    self.expect(host);
                }
            }
            SimEvent::ToWorker { slot, life, message } if self.workers[slot].life == life => {
                match self.workers[slot].paused {
                    true => self.while_paused.entry(slot).or_default().0.push(message),
                    false => self.receive(slot, message),
                }
            }
            SimEvent::ToWorker { message: Message::Order(view_id, order), .. } => {
                // That process no longer exists.
                let failure = Failure::TryElsewhere;
                self.step(Event::Failed { view_id, attempt: order.attempt, failure });
            }
            SimEvent::ToWorker { .. } => {}
            SimEvent::ToCoordinator(event) => self.step(*event),
            SimEvent::FrameAtCoordinator { view } => {
                let ms = self.parameters.relay_ms;
                self.begin(COORDINATOR, ms, Task::Relay { view });
            }
            SimEvent::FrameAtClient { view_id } => {
                let ms = self.parameters.client_ms;
                self.begin(CLIENTS, ms, Task::Receive { view_id });
            }
            SimEvent::Report { slot, life } => {
                let worker = &self.workers[slot];
                if worker.life == life && worker.alive {
                    if !worker.paused {
                        self.report(slot);
                    }
                    let every = self.report_every;
                    self.after(every, SimEvent::Report { slot, life });
                }
            }
            SimEvent::Announced { slot, life, id } => {
                if self.workers[slot].life == life {
                    self.announced(slot, id);
                }
            }
            SimEvent::AskAgain { slot, life, id } => {
                let worker = &mut self.workers[slot];
                if worker.life == life
                    && let Some(fetch) = worker.fetches.get_mut(&id)
                {
                    (fetch.sources, fetch.asked) = (fetch.then.clone(), 0);
                    self.seek(slot, id);
                }
            }
            SimEvent::Rejoin { slot, life } => {
                let worker = &self.workers[slot];
                if worker.life == life && worker.alive && worker.id.is_none() && !worker.paused {
                    self.join(slot);
                }
            }
            SimEvent::CoreTick => {
                self.step(Event::Tick);
                let every = self.tick_every;
                self.after(every, SimEvent::CoreTick);
            }
            SimEvent::Wake { tag } => self.with(|load, world| load.wake(tag, world)),
        }
    }

    /// Passes an event to the core, and its actions to workers and clients.
    fn step(&mut self, event: Event) {
        let now = Uptime(Duration::from_nanos(self.now));
        let began = Instant::now();
        let actions = self.core.step(event, now);
        self.tally.core_secs += began.elapsed().as_secs_f64();
        self.tally.core_steps += 1;
        for action in actions {
            match action {
                Action::Assign { worker, assignment } => {
                    if let Some(slot) = self.slots.get(&worker).copied() {
                        self.tell(slot, Message::Assignment(assignment));
                    }
                }
                Action::Expel { worker, .. } => {
                    if let Some(slot) = self.slots.remove(&worker)
                        && self.workers[slot].id == Some(worker)
                    {
                        self.workers[slot].id = None;
                        let life = self.workers[slot].life;
                        self.after(200_000_000, SimEvent::Rejoin { slot, life });
                    }
                }
                Action::Dispatch { view_id, order } => {
                    let slot = self.slots.get(&order.worker).copied();
                    match slot {
                        Some(slot) => self.tell(slot, Message::Order(view_id, order)),
                        None => {
                            let failed = Event::Failed {
                                view_id,
                                attempt: order.attempt,
                                failure: Failure::TryElsewhere,
                            };
                            let latency = self.latency();
                            self.after(latency, SimEvent::ToCoordinator(Box::new(failed)));
                        }
                    }
                }
                Action::Deliver { .. } => {}
                Action::Refuse { view_id, fault } => {
                    let Some(asked) = self.views.remove(&view_id) else { continue };
                    let overload = matches!(fault, Fault::Overloaded { .. });
                    match overload {
                        true => self.tally.overloaded += 1,
                        false => self.tally.failed += 1,
                    }
                    self.with(|load, world| load.refused(asked.client, overload, world));
                }
            }
        }
    }

    /// A task on a machine has ended.
    fn done(&mut self, task: Task) {
        let of = match task {
            Task::Render { slot, life }
            | Task::Encode { slot, life, .. }
            | Task::Pack { slot, life, .. }
            | Task::Unpack { slot, life, .. } => Some((slot, life)),
            Task::Relay { .. } | Task::Receive { .. } => None,
        };
        if let Some((slot, life)) = of {
            if self.workers[slot].life != life {
                return;
            }
            if self.workers[slot].paused {
                self.while_paused.entry(slot).or_default().1.push(task);
                return;
            }
        }
        if let Task::Encode { slot, .. } | Task::Pack { slot, .. } | Task::Unpack { slot, .. } = task {
            self.ended_beside(slot);
        }
        match task {
            Task::Render { slot, .. } => self.rendered(slot),
            Task::Encode { slot, view, .. } => {
                let bytes = self.parameters.frame_bytes;
                self.workers[slot].sending -= 1;
                if self.parameters.relayed {
                    let at = self.send(WORKERS + slot, COORDINATOR, bytes);
                    self.at(at, SimEvent::FrameAtCoordinator { view });
                } else {
                    let latency = self.latency();
                    self.after(latency, SimEvent::ToCoordinator(Box::new(answered(view))));
                    let at = self.send(WORKERS + slot, CLIENTS, bytes);
                    self.at(at, SimEvent::FrameAtClient { view_id: view.view_id });
                }
            }
            Task::Pack { slot, id, .. } => {
                let receivers = self.workers[slot].packing.remove(&id).unwrap_or_default();
                self.workers[slot].packed.insert(id);
                receivers.into_iter().for_each(|to| self.pass_on(slot, id, to));
            }
            Task::Unpack { slot, id, .. } => {
                self.workers[slot].packed.insert(id);
                self.gained(slot, id);
            }
            Task::Relay { view } => {
                let Some(asked) = self.views.get_mut(&view.view_id).filter(|asked| !asked.answered) else {
                    return;
                };
                asked.answered = true;
                self.step(answered(view));
                let bytes = self.parameters.frame_bytes;
                let at = self.send(COORDINATOR, CLIENTS, bytes);
                self.at(at, SimEvent::FrameAtClient { view_id: view.view_id });
            }
            Task::Receive { view_id } => {
                let Some(asked) = self.views.remove(&view_id) else { return };
                self.tally.answered += 1;
                let latency = self.now - asked.at;
                self.tally.slowest = self.tally.slowest.max(latency);
                self.with(|load, world| load.answered(asked.client, latency, world));
            }
        }
    }
}

fn answered(view: Attempt) -> Event {
    Event::Answered {
        view_id: view.view_id,
        attempt: view.attempt,
        uncovered: Some(0),
        ms: None,
        fell_short: false,
    }
}
