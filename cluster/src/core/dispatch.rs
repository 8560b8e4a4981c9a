//! Views on their way: admitted or turned away, given to a worker, given to another if that one fails.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::{Camera, Holes, Plan, Prediction, SampleId, View, Visibility};

use super::event::{Action, Failure, Order, Source, Ticket, WorkerId};
use super::machine::Core;
use super::plan::plan;
use super::time::Uptime;
use super::wishes::{Planned, Quest};
use super::worker::Worker;

/// Samplers that are named in an order as those who can trace: a second and a third chance.
const MOST_TRACERS: usize = 3;

/// Views that a sampler with time to spare has at the same time: a small batch.
const MOST_SPARE_VIEWS: usize = 16;

/// An admitted view.
#[derive(Debug, Clone)]
pub(super) struct Pending {
    camera: Camera,
    /// How many the frame has.
    pub(super) pixels: u64,
    pub(super) epoch: u64,
    pub(super) plan: Plan,
    /// What is expected of its frame.
    pub(super) expected: Option<Prediction>,
    /// The search for a frame within a bound.
    pub(super) quest: Option<Box<Quest>>,
    /// Its plan was pinned: what it lacks says nothing of the plans made here.
    pinned: bool,
    /// Pinned kind of device; empty: any.
    device_kind: String,
    /// When its answer is worthless, and how long that was when it was asked.
    deadline: Option<(Uptime, Duration)>,
    asked: Uptime,
    attempt: u32,
    worker: Option<WorkerId>,
    tried: BTreeSet<WorkerId>,
}

/// The kind of device in a frame's.
fn device_kind(device: &str) -> &str {
    Visibility::of_device(device).0
}

impl Pending {
    /// Its frame was not good enough: another is made, by whomever.
    pub(super) fn begin_again(&mut self, plan: Plan, expected: Prediction, quest: Box<Quest>) {
        (self.plan, self.expected, self.quest) = (plan, Some(expected), Some(quest));
        (self.worker, self.tried) = (None, BTreeSet::new());
    }

    /// Attempts that failed, or are in work: without those whose frame was thrown away.
    fn attempts(&self) -> u32 {
        self.attempt - self.quest.as_ref().map_or(0, |quest| quest.thrown_away())
    }

    fn is_direct(&self) -> bool {
        matches!(self.plan, Plan::Direct { .. })
    }

    fn traces_holes(&self) -> bool {
        matches!(&self.plan, Plan::Warp(warp) if warp.holes == Holes::Trace)
    }

    /// The epoch whose samples it needs, if it needs any.
    pub(super) fn sampled_epoch(&self) -> Option<u64> {
        self.samples().first().map(|id| id.epoch)
    }

    fn samples(&self) -> &[SampleId] {
        match &self.plan {
            Plan::Direct { .. } => &[],
            Plan::Warp(warp) => &warp.samples,
        }
    }
}

impl Core {
    pub(super) fn ask(
        &mut self,
        ticket: Ticket,
        view: &View,
        deadline: Option<Duration>,
        now: Uptime,
        actions: &mut Vec<Action>,
    ) {
        self.wake(now);
        match self.admit(view, deadline) {
            Err(fault) => {
                match fault {
                    Fault::Overloaded { .. } => self.counters.views_rejected += 1,
                    _ => self.counters.views_failed += 1,
                }
                actions.push(Action::Refuse { ticket, fault });
            }
            Ok(Planned { plan, expected, quest }) => {
                let epoch = view.pin.as_ref().map_or(self.set.epoch, |pin| pin.epoch);
                let pending = Pending {
                    camera: view.camera,
                    pixels: u64::from(view.width) * u64::from(view.height),
                    epoch,
                    plan,
                    pinned: view.pin.is_some(),
                    expected,
                    quest,
                    device_kind: view
                        .pin
                        .as_ref()
                        .map(|pin| device_kind(&pin.device).to_owned())
                        .unwrap_or_default(),
                    deadline: deadline.map(|d| (now.after(d), d)),
                    asked: now,
                    attempt: 0,
                    worker: None,
                    tried: BTreeSet::new(),
                };
                match pending.is_direct() {
                    true => self.rates.direct.count(1),
                    false => self.rates.views.count(1),
                }
                if view.pin.is_none() {
                    self.epochs.used(pending.samples().iter().map(|id| id.index), now);
                }
                self.views.insert(ticket, pending);
                self.waiting.push_back(ticket);
            }
        }
    }

    fn admit(&self, view: &View, deadline: Option<Duration>) -> Result<Planned, Fault> {
        if self.draining {
            return Err(Fault::Unavailable("the coordinator is shutting down".to_owned()));
        }
        self.check_epoch(view)?;
        let plain = plan(view, &self.set, self.placement.usable(), &self.config)?;
        let planned = self.planned(view, plain);
        let direct = matches!(planned.plan, Plan::Direct { .. });
        let expected = self.expected_wait(direct);
        let bearable = deadline.unwrap_or(Duration::MAX).min(self.config.max_wait);
        if self.views.len() >= self.config.max_views || expected > bearable {
            let (count, secs) = (self.views.len(), expected.as_secs_f64());
            let what =
                format!("{count} views are waiting or in work, {secs:.1} s of it before this one's turn");
            // By then half of what is in flight is done.
            let retry_after = (expected / 2).clamp(Duration::from_millis(50), Duration::from_secs(5));
            return Err(Fault::Overloaded { what, retry_after });
        }
        if let Some(device) = view.pin.as_ref().map(|pin| &pin.device).filter(|device| !device.is_empty()) {
            let mut ready = self.workers.values().filter(|w| w.is_ready()).peekable();
            if ready.peek().is_some() && !ready.any(|w| w.hello.device == device_kind(device)) {
                return Err(Fault::Pin(format!("no worker has the device {device:?}")));
            }
        }
        Ok(planned)
    }

    /// The samples of an epoch that serve a viewpoint best, best first.
    pub(super) fn sample_ids(&self, camera: &Camera, count: usize, epoch: u64) -> Vec<SampleId> {
        let generation = self.set.generation;
        let indices = self.set.rig.nearest_among(camera, count, self.placement.usable()).into_iter();
        indices.map(|index| SampleId { epoch, generation, index }).collect()
    }

    /// How long the views of one kind that are in flight will take those who play that role, as far as their
    /// cost was measured. Where nothing but direct views is in flight, all will soon render them.
    pub(super) fn expected_wait(&self, direct: bool) -> Duration {
        let costs = self.believed_costs();
        let cost = if direct { costs.direct_secs } else { costs.view_secs };
        let ahead = self.views.values().filter(|view| view.is_direct() == direct).count();
        let all = direct && ahead == self.views.len();
        let takes = |w: &&Worker| match direct {
            true => w.takes_samples() || (all && w.is_ready()),
            false => w.takes_views(),
        };
        let hands = self.workers.values().filter(takes).count().max(1);
        Duration::try_from_secs_f64(cost * ahead as f64 / hands as f64).unwrap_or(Duration::MAX)
    }

    /// Gives waiting views to workers with room, oldest first. Stops looking once a reconstructed and a direct
    /// view had to wait; a view that is bound to certain workers holds nobody up.
    pub(super) fn pump(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let mut stay = Vec::new();
        let (mut direct_full, mut warp_full) = (false, false);
        while let Some(ticket) = self.waiting.pop_front() {
            let Some(view) = self.views.get(&ticket) else { continue };
            let (direct, bound) = (view.is_direct(), !view.device_kind.is_empty() || !view.tried.is_empty());
            if (if direct { direct_full } else { warp_full }) && !bound {
                stay.push(ticket);
            } else if !self.place(ticket, now, actions) {
                stay.push(ticket);
                direct_full |= direct && !bound;
                warp_full |= !direct && !bound;
            }
            if direct_full && warp_full {
                break;
            }
        }
        for ticket in stay.into_iter().rev() {
            self.waiting.push_front(ticket);
        }
    }

    /// Gives a view to the best worker there is; false if none has room.
    fn place(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) -> bool {
        let Some(view) = self.views.get(&ticket) else { return true };
        let Some(id) = self.choose(view) else { return false };
        let samples = view.samples().to_vec();
        let mut sources = Vec::new();
        for &sample in &samples {
            let (source, to_render) = self.directory.locate(sample, id, &self.workers, now);
            self.rates.samples.count(to_render.into());
            sources.push(source);
        }
        self.dispatch(ticket, id, &samples, sources, actions);
        true
    }

    fn dispatch(
        &mut self,
        ticket: Ticket,
        id: WorkerId,
        samples: &[SampleId],
        sources: Vec<Source>,
        actions: &mut Vec<Action>,
    ) {
        let traces = self.views.get(&ticket).is_some_and(Pending::traces_holes);
        let tracers = if traces { self.tracers(id) } else { Vec::new() };
        let (Some(view), Some(worker)) = (self.views.get_mut(&ticket), self.workers.get_mut(&id)) else {
            return;
        };
        worker.begin(ticket, samples);
        view.attempt += 1;
        view.worker = Some(id);
        view.tried.insert(id);
        let order = Order {
            attempt: view.attempt,
            worker: id,
            address: worker.hello.address.clone(),
            // Its samples say which moment a plan is of.
            epoch: samples.first().map_or(view.epoch, |id| id.epoch),
            plan: view.plan.clone(),
            sources,
            tracers,
            expected: view.expected,
            judged: view.quest.as_ref().is_some_and(|quest| quest.judged),
        };
        actions.push(Action::Dispatch { ticket, order: Box::new(order) });
    }

    /// Who traces pixels for a view that `reader` composes: itself if it samples, since that needs no transfer,
    /// then samplers of the same kind of device, whose bytes are the same, then others; those with least to do
    /// first; also those on their way to that role. None where nobody samples.
    fn tracers(&self, reader: WorkerId) -> Vec<String> {
        let device = self.workers.get(&reader).map(|w| &w.hello.device);
        let rank = |w: &&Worker| (w.id != reader, Some(&w.hello.device) != device, w.views.len(), w.id);
        let mut samplers: Vec<&Worker> =
            self.workers.values().filter(|w| w.is_ready() && w.assigned().role.samples()).collect();
        samplers.sort_by_key(rank);
        samplers.into_iter().take(MOST_TRACERS).map(|w| w.hello.address.clone()).collect()
    }

    /// The worker that will probably answer first: fewest views in its queue, each missing sample counted as
    /// [`super::Config::missing_sample_views`]; among equals the one that had the fewest views so far.
    ///
    /// Roles decide who is asked. Where nobody plays the role (the moment before roles change), or everybody
    /// who does has failed at this view, anybody is: a worker can do both, it is only slower to start.
    fn choose(&self, view: &Pending) -> Option<WorkerId> {
        let takes = |w: &&Worker| match view.is_direct() {
            true => w.takes_samples(),
            false => w.takes_views() || self.may_help_out(w, view.samples()),
        };
        let able: Vec<&Worker> = self
            .workers
            .values()
            .filter(|w| w.is_ready() && (view.device_kind.is_empty() || w.hello.device == view.device_kind))
            .collect();
        let untried: Vec<&Worker> = able.iter().filter(|w| !view.tried.contains(&w.id)).copied().collect();
        let open = if untried.is_empty() { able } else { untried };
        let suited: Vec<&Worker> = open.iter().filter(|w| takes(w)).copied().collect();
        let asked = if suited.is_empty() { open } else { suited };
        let cost = |w: &Worker| {
            w.views.len() as f64 + w.missing(view.samples()) as f64 * self.config.missing_sample_views
        };
        asked
            .into_iter()
            .filter(|w| w.views.len() < self.config.max_views_per_worker)
            .min_by(|a, b| {
                cost(a).total_cmp(&cost(b)).then(a.dispatched.cmp(&b.dispatched)).then(a.id.cmp(&b.id))
            })
            .map(|w| w.id)
    }

    /// Whether a sampler has time to compose a view: it holds the view's samples, nobody waits for one that it has
    /// yet to render, and it has few views, so that the next sample does not wait for long.
    fn may_help_out(&self, sampler: &Worker, samples: &[SampleId]) -> bool {
        let is_due = |id: SampleId| {
            self.directory.is_owner(sampler.id, id) && !self.workers.values().any(|w| w.held.contains(&id))
        };
        self.config.samplers_composite
            && sampler.takes_samples()
            && sampler.views.len() < MOST_SPARE_VIEWS
            && samples.iter().all(|id| sampler.held.contains(id))
            && !self.workers.values().flat_map(Worker::fetching).any(is_due)
    }

    pub(super) fn answered(&mut self, ticket: Ticket, attempt: u32, uncovered: u64, ms: Option<f64>) {
        if self.is_current(ticket, attempt) {
            if let Some(ms) = ms {
                self.learn_pace(ticket, ms);
            }
            self.take_back(ticket, true);
            if let Some(view) = self.views.remove(&ticket)
                && !view.is_direct()
                && !view.pinned
            {
                let used: Vec<u64> = view.samples().iter().map(|id| id.index).collect();
                let uncovered = uncovered.min(view.pixels);
                self.placement.learn(&self.set.rig, &view.camera, &used, uncovered, view.pixels);
            }
            self.counters.views_answered += 1;
        }
    }

    pub(super) fn failed(
        &mut self,
        ticket: Ticket,
        attempt: u32,
        failure: Failure,
        now: Uptime,
        actions: &mut Vec<Action>,
    ) {
        if !self.is_current(ticket, attempt) {
            return;
        }
        match failure {
            Failure::TryElsewhere => self.retry(ticket, now, actions),
            Failure::Final => {
                self.take_back(ticket, false);
                self.views.remove(&ticket);
                self.counters.views_failed += 1;
            }
        }
    }

    /// Puts a view whose worker failed first in the queue, or gives it up after too many attempts.
    pub(super) fn retry(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) {
        self.take_back(ticket, false);
        let Some(view) = self.views.get_mut(&ticket) else { return };
        view.worker = None;
        if view.deadline.is_some_and(|(at, _)| now >= at) {
            return self.expire_one(ticket, now, actions);
        }
        if view.attempts() >= self.config.max_attempts {
            let fault = Fault::Unavailable(format!("{} workers failed at this view", view.attempts()));
            return self.refuse(ticket, fault, actions);
        }
        self.counters.views_retried += 1;
        self.waiting.push_front(ticket);
    }

    /// Ends the deadlines and the patience that are over.
    pub(super) fn expire(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let tickets: Vec<Ticket> = self.views.keys().copied().collect();
        for ticket in tickets {
            self.expire_one(ticket, now, actions);
        }
    }

    fn expire_one(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) {
        let Some(view) = self.views.get(&ticket) else { return };
        if let Some((_, asked_for)) = view.deadline.filter(|(at, _)| now >= *at) {
            self.refuse(ticket, Fault::Deadline(asked_for), actions);
        } else if view.worker.is_none() && now.since(view.asked) >= self.config.patience {
            let secs = self.config.patience.as_secs_f64();
            let ready = self.workers.values().filter(|w| w.is_ready()).count();
            let fault = Fault::Unavailable(format!("none of {ready} ready workers had room within {secs} s"));
            self.refuse(ticket, fault, actions);
        }
    }

    fn refuse(&mut self, ticket: Ticket, fault: Fault, actions: &mut Vec<Action>) {
        self.take_back(ticket, false);
        self.views.remove(&ticket);
        self.counters.views_failed += 1;
        actions.push(Action::Refuse { ticket, fault });
    }

    /// Whether that attempt is the one the view's answer is awaited from.
    pub(super) fn is_current(&self, ticket: Ticket, attempt: u32) -> bool {
        self.views.get(&ticket).is_some_and(|view| view.attempt == attempt && view.worker.is_some())
    }

    /// Takes a view off the worker that has it.
    pub(super) fn take_back(&mut self, ticket: Ticket, answered: bool) {
        let Some(view) = self.views.get(&ticket) else { return };
        if let Some(worker) = view.worker.and_then(|id| self.workers.get_mut(&id)) {
            worker.end(ticket, view.samples(), answered);
        }
    }
}
