//! Views on their way: admitted or turned away, given to a worker, given to another if that one fails.
//!
//! Whom a view is given to is for `choose` to say.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::rig::Survey;
use argus_scene::{Plan, Prediction, Preset, SampleId, View};

use super::admission::Client;
use super::directory::{Directory, Known};
use super::event::{Action, Failure, LastView, Order, Source, Ticket, WorkerId};
use super::machine::Core;
use super::open::OpenView;
use super::pending::{Pending, device_kind, sub_pixels};
use super::plan::{MOST_SAMPLES, plan};
use super::time::Uptime;
use super::wishes::{Planned, Quest};
use super::worker::Worker;

/// Views bound to certain workers that are looked at in one go.
const MOST_BOUND: usize = 64;

/// Attempts that end where a refinement is not where it was thought to be, before it is rendered for the view after all.
const MOST_WITHOUT: u32 = 3;

impl Core {
    pub(super) fn ask(
        &mut self,
        ticket: Ticket,
        (client, deadline): (Client, Option<Duration>),
        view: &View,
        (survey, last): (Option<Box<Survey>>, Option<Box<LastView>>),
        now: Uptime,
        actions: &mut Vec<Action>,
    ) {
        self.wake(now);
        match self.admit(&client, view, deadline, now) {
            Err(fault) => {
                match fault {
                    Fault::Overloaded { .. } => self.counters.views_rejected += 1,
                    _ => self.counters.views_failed += 1,
                }
                actions.push(Action::Refuse { ticket, fault });
            }
            Ok(Planned { plan, expected, quest }) => {
                let epoch = view.pin.as_ref().map_or(self.set.epoch, |pin| pin.epoch);
                let longest = self.config.max_view_time;
                let deadline = deadline.unwrap_or(longest).min(longest);
                let pixels = u64::from(view.width) * u64::from(view.height);
                self.admission.enter(&client, pixels.saturating_mul(sub_pixels(&plan)), &self.config, now);
                let pending = Pending {
                    client,
                    camera: view.camera,
                    pixels,
                    epoch,
                    plan,
                    open: OpenView::of(view, survey, last),
                    pinned: view.pin.is_some(),
                    expected,
                    quest,
                    device_kind: view
                        .pin
                        .as_ref()
                        .map(|pin| device_kind(&pin.device).to_owned())
                        .unwrap_or_default(),
                    deadline: (now.after(deadline), deadline),
                    asked: now,
                    due: now,
                    attempt: 0,
                    worker: None,
                    tried: BTreeSet::new(),
                };
                match (pending.open.is_some(), pending.is_direct()) {
                    // Counted once it is decided.
                    (true, _) => {}
                    (_, true) => self.rates.direct.count(1),
                    (_, false) => self.rates.views.count(1),
                }
                if view.pin.is_none() {
                    self.note_use(pending.samples().iter().map(|id| id.index), now);
                }
                self.in_flight.add(&pending);
                self.views.insert(ticket, pending);
                self.wait(ticket);
            }
        }
    }

    fn admit(
        &self,
        client: &str,
        view: &View,
        deadline: Option<Duration>,
        now: Uptime,
    ) -> Result<Planned, Fault> {
        if self.draining {
            return Err(Fault::Unavailable("the coordinator is shutting down".to_owned()));
        }
        self.check_epoch(view)?;
        // Who is turned away anyway costs no planning: where many are, that is what the coordinator would spend its time on.
        let open = view.pin.is_none() && view.plan.leaves_way_open();
        let least = match open {
            true => self.expected_wait_anywhere(),
            false => self.expected_wait(true).min(self.expected_wait(false)),
        };
        self.check_load(client, deadline, least, now)?;
        let nearest = |count| self.sample_ids(&view.camera, count, self.set.epoch);
        let plain = plan(view, &self.set, nearest, &self.config)?;
        if open {
            return Ok(Planned { plan: plain, expected: None, quest: None });
        }
        let mut planned = self.planned(view, plain);
        if planned.quest.is_none() && view.pin.is_none() {
            self.widen(view, &mut planned.plan);
        }
        let direct = matches!(planned.plan, Plan::Direct { .. });
        self.check_load(client, deadline, self.expected_wait(direct), now)?;
        if let Some(device) = view.pin.as_ref().map(|pin| &pin.device).filter(|device| !device.is_empty()) {
            let mut ready = self.workers.values().filter(|w| w.is_ready()).peekable();
            if ready.peek().is_some() && !ready.any(|w| w.hello.device == device_kind(device)) {
                return Err(Fault::Pin(format!("no worker has the device {device:?}")));
            }
        }
        Ok(planned)
    }

    /// Whether a view that has to wait so long until its turn may come in.
    fn check_load(
        &self,
        client: &str,
        deadline: Option<Duration>,
        expected: Duration,
        now: Uptime,
    ) -> Result<(), Fault> {
        let bearable = deadline.unwrap_or(Duration::MAX).min(self.config.max_wait);
        // By then half of what is in flight is done.
        let retry_after = (expected / 2).clamp(Duration::from_millis(50), Duration::from_secs(5));
        if self.views.len() >= self.config.max_views || expected > bearable {
            let (count, secs) = (self.views.len(), expected.as_secs_f64());
            let what =
                format!("{count} views are waiting or in work, {secs:.1} s of it before this one's turn");
            return Err(Fault::Overloaded { what, retry_after });
        }
        self.admission.check(client, &self.config, retry_after, now)
    }

    /// A plan whose request leaves it open takes further samples, those that are at hand anyway: what none of the first ones
    /// saw, another camera may have seen, and a new sample costs more.
    fn widen(&self, view: &View, plan: &mut Plan) {
        let open = view.plan.samples.is_none() && matches!(view.plan.preset, None | Some(Preset::Balanced));
        let (true, Plan::Warp(warp)) = (open, plan) else { return };
        let readers = self.lines.compositors().len();
        let at_hand = |id: &SampleId| readers > 0 && 2 * self.whereabouts.count(*id) >= readers;
        let all = self.sample_ids(&view.camera, MOST_SAMPLES, self.set.epoch).into_iter();
        let further: Vec<SampleId> =
            all.filter(|id| !id.is_surroundings() && !warp.samples.contains(id) && at_hand(id)).collect();
        // What surrounds the scene comes last.
        let own = warp.samples.iter().filter(|id| !id.is_surroundings()).count();
        warp.samples.splice(own..own, further.into_iter().take(MOST_SAMPLES.saturating_sub(own)));
    }

    /// How long the views of one kind that are in flight will take those who play that role, as far as their
    /// cost was measured. Where nothing but direct views is in flight, all will soon render them.
    pub(super) fn expected_wait(&self, direct: bool) -> Duration {
        let costs = self.believed_costs();
        let (cost, ahead) = match direct {
            true => (costs.direct_secs, self.in_flight.direct),
            false => (costs.view_secs, self.in_flight.composed),
        };
        let hands = match direct {
            true if self.in_flight.composed == 0 => self.lines.ready(),
            true => self.lines.samplers().len(),
            false => self.lines.compositors().len(),
        };
        Duration::try_from_secs_f64(cost * ahead as f64 / hands.max(1) as f64).unwrap_or(Duration::MAX)
    }

    /// How long the views that any worker can answer will take all of them, as far as that is predicted.
    fn expected_wait_anywhere(&self) -> Duration {
        let queued_ms: f64 = self.workers.values().map(Worker::queued_ms).sum();
        let decided: usize = self.workers.values().map(|worker| worker.views.len()).sum();
        let each_ms = if decided > 0 { queued_ms / decided as f64 } else { 0.0 };
        let ahead_ms = queued_ms + each_ms * self.waiting.open.len() as f64;
        let secs = ahead_ms * 1e-3 / self.lines.ready().max(1) as f64;
        Duration::try_from_secs_f64(secs).unwrap_or(Duration::MAX)
    }

    /// A view waits for a worker, among the others by its age.
    fn wait(&mut self, ticket: Ticket) {
        let Some(view) = self.views.get_mut(&ticket) else { return };
        self.waiting.insert(ticket, view);
        self.due.remove(&(view.due, ticket));
        let patient = view.asked.after(self.config.patience);
        view.due = view.deadline.0.min(patient);
        self.due.insert((view.due, ticket));
    }

    /// A view that was put back for another plan waits anew.
    pub(super) fn begin_again(
        &mut self,
        ticket: Ticket,
        plan: Plan,
        expected: Prediction,
        quest: Box<Quest>,
    ) {
        let Some(view) = self.views.get_mut(&ticket) else { return };
        self.in_flight.subtract(view);
        view.begin_again(plan, expected, quest);
        self.in_flight.add(view);
        self.wait(ticket);
    }

    /// A view is over.
    pub(super) fn forget(&mut self, ticket: Ticket) -> Option<Pending> {
        let view = self.views.remove(&ticket)?;
        self.admission.leave(&view.client);
        self.in_flight.subtract(&view);
        self.due.remove(&(view.due, ticket));
        self.waiting.remove(ticket);
        Some(view)
    }

    /// Gives waiting views to workers with room, the oldest first of those that are reconstructed and of those
    /// rendered directly, until one has to wait; a view that is bound to certain workers holds nobody up.
    pub(super) fn pump(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        for ticket in self.waiting.bound.iter().copied().take(MOST_BOUND).collect::<Vec<_>>() {
            if self.place(ticket, now, actions) {
                self.waiting.bound.remove(&ticket);
            }
        }
        let mut full = [false; 3];
        loop {
            let lines = [&self.waiting.direct, &self.waiting.composed, &self.waiting.open];
            let first = |line: usize| lines[line].first().map(|ticket| (*ticket, line));
            let next = (0..full.len()).filter(|line| !full[*line]).filter_map(first).min();
            let Some((ticket, line)) = next else { return };
            match self.place(ticket, now, actions) {
                true => self.waiting.remove(ticket),
                false => full[line] = true,
            }
        }
    }

    /// Gives a view to the best worker there is; false if none has room.
    fn place(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) -> bool {
        if self.views.get(&ticket).is_some_and(|view| view.open.is_some()) {
            return self.place_open(ticket, actions);
        }
        if self.views.get(&ticket).is_some_and(|view| !view.is_direct()) && self.set_is_on_its_way() {
            return false;
        }
        self.leave_out_lost(ticket);
        let Some(view) = self.views.get(&ticket) else { return true };
        let Some(id) = self.choose(view) else { return false };
        let samples = view.samples().to_vec();
        let mut sources = Vec::with_capacity(samples.len());
        // What was lost before anybody knew of it shall not send a view to and fro.
        let may_come_back = view.attempts() < MOST_WITHOUT;
        let lacks = |sample: &SampleId| !self.whereabouts.has(*sample, id);
        let dispensable = |sample: &SampleId| lacks(sample) && self.is_dispensable(view, *sample);
        let dispensable: Vec<SampleId> =
            samples.iter().copied().filter(|sample| may_come_back && dispensable(sample)).collect();
        for &sample in &samples {
            let known = Known { workers: &self.workers, lines: &self.lines, whereabouts: &self.whereabouts };
            if dispensable.contains(&sample) {
                sources.push(Directory::among_holders(sample, id, known));
                continue;
            }
            let (source, to_render) = self.directory.locate(sample, id, known, &mut self.spread, now);
            self.rates.samples.count(to_render.into());
            sources.push(source);
        }
        self.dispatch(ticket, id, &samples, sources, actions);
        true
    }

    /// Whether a view's plan could be made without a sample: refinements are used where they are at hand, and rendered when
    /// nobody waits. Where the scene moves they come with each moment as all samples do.
    fn is_dispensable(&self, view: &Pending, id: SampleId) -> bool {
        !view.pinned && self.set.epoch_secs == 0.0 && self.set.rig.level(id.index) > Some(0)
    }

    /// A view that names refinements which were lost meanwhile gets the next best samples that somebody has.
    fn leave_out_lost(&mut self, ticket: Ticket) {
        let Some(view) = self.views.get(&ticket) else { return };
        let answers = |worker: WorkerId| self.workers.get(&worker).is_some_and(|w| !w.suspected);
        let is_lost = |id: SampleId| !self.whereabouts.holders(id).any(answers);
        let lost = |id: &&SampleId| self.is_dispensable(view, **id) && is_lost(**id);
        let Some(&SampleId { epoch, generation, .. }) = view.samples().iter().find(lost) else { return };
        let there = |index: &u64| !is_lost(SampleId { epoch, generation, index: *index });
        let usable: Vec<u64> = self.placement.usable().iter().copied().filter(there).collect();
        let count = view.samples().iter().filter(|id| !id.is_surroundings()).count();
        let ids = self.sample_ids_among(&view.camera, count, epoch, &usable);
        if let Some(Pending { plan: Plan::Warp(warp), .. }) = self.views.get_mut(&ticket) {
            warp.samples = ids;
        }
    }

    pub(super) fn dispatch(
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
        let costs =
            [self.costs.direct.value(), self.costs.view.value()].map(|secs| secs.unwrap_or(0.0) * 1e3);
        let decision = view.open.as_ref().and_then(|open| open.decision);
        let usual_ms = if view.is_direct() { costs[0] } else { costs[1] };
        let predicted_ms = decision.map_or(usual_ms, |decision| decision.render_ms);
        worker.begin(ticket, predicted_ms, samples, &mut self.whereabouts);
        self.lines.update(worker);
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
            decision,
            fallback: view.open.as_ref().filter(|_| !view.is_direct()).map(|open| open.samples_per_pixel),
        };
        actions.push(Action::Dispatch { ticket, order: Box::new(order) });
    }

    pub(super) fn answered(&mut self, ticket: Ticket, attempt: u32, uncovered: Option<u64>, ms: Option<f64>) {
        if self.is_current(ticket, attempt) {
            if let Some(ms) = ms {
                self.learn_pace(ticket, ms);
            }
            if let Some(view) = self.views.get(&ticket) {
                let costs = &mut self.costs;
                let pixels = if view.is_direct() { &mut costs.direct_pixels } else { &mut costs.view_pixels };
                pixels.observe(view.work() as f64);
                if let Some(worker) = view.worker.and_then(|id| self.workers.get_mut(&id)) {
                    worker.record.answered();
                }
            }
            self.take_back(ticket, true);
            let Some(view) = self.forget(ticket) else { return };
            if let (Some(open), Some(ms)) = (&view.open, ms) {
                self.learn_savings(&view, open, ms);
            } else if let Some(uncovered) = uncovered
                && !view.is_direct()
                && !view.pinned
            {
                let used: Vec<u64> = view.samples().iter().map(|id| id.index).collect();
                let uncovered = uncovered.min(view.pixels);
                let rig = (&self.set.rig, self.sight.as_deref());
                self.placement.learn(rig, &view.camera, &used, uncovered, view.pixels);
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
            Failure::OfWorker => {
                self.blame(self.views.get(&ticket).and_then(|view| view.worker), ticket, now);
                self.retry(ticket, now, actions);
            }
            Failure::Final => {
                self.take_back(ticket, false);
                self.forget(ticket);
                self.counters.views_failed += 1;
            }
        }
    }

    /// Whether another attempt would leave one more to fail.
    pub(super) fn may_be_retried(&self, view: &Pending) -> bool {
        view.attempts() + 1 < self.config.max_attempts
    }

    /// Puts a view whose worker failed first in the queue, or gives it up after too many attempts.
    pub(super) fn retry(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) {
        self.take_back(ticket, false);
        let Some(view) = self.views.get_mut(&ticket) else { return };
        view.worker = None;
        if now >= view.deadline.0 {
            return self.expire_one(ticket, now, actions);
        }
        if view.attempts() >= self.config.max_attempts {
            let fault = Fault::Unavailable(format!("{} workers failed at this view", view.attempts()));
            return self.refuse(ticket, fault, actions);
        }
        self.counters.views_retried += 1;
        self.wait(ticket);
    }

    /// Ends the deadlines and the patience that are over.
    pub(super) fn expire(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        while let Some(&(due, ticket)) = self.due.first().filter(|(due, _)| now >= *due) {
            self.due.remove(&(due, ticket));
            self.expire_one(ticket, now, actions);
        }
    }

    fn expire_one(&mut self, ticket: Ticket, now: Uptime, actions: &mut Vec<Action>) {
        let Some(view) = self.views.get_mut(&ticket) else { return };
        let (at, asked_for) = view.deadline;
        if now >= at {
            self.refuse(ticket, Fault::Deadline(asked_for), actions);
        } else if view.worker.is_none() && now.since(view.asked) >= self.config.patience {
            let secs = self.config.patience.as_secs_f64();
            let ready = self.lines.ready();
            let fault = Fault::Unavailable(format!("none of {ready} ready workers had room within {secs} s"));
            self.refuse(ticket, fault, actions);
        } else {
            // In work: what is left is its deadline.
            view.due = at;
            self.due.insert((at, ticket));
        }
    }

    fn refuse(&mut self, ticket: Ticket, fault: Fault, actions: &mut Vec<Action>) {
        self.take_back(ticket, false);
        self.forget(ticket);
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
            worker.end(ticket, view.samples(), answered, &mut self.whereabouts);
            self.lines.update(worker);
        }
    }
}
