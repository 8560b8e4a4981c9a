//! The machine itself: state, and which part of it each event concerns.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::SampleSetInfo;
use argus_scene::rig::Sight;
use serde::Serialize;

use super::admission::Admission;
use super::balance::{Costs, Demand, Split};
use super::calibrated_error::CalibratedError;
use super::cameras::LastChoice;
use super::config::Config;
use super::copies::Lately;
use super::directory::Directory;
use super::epochs::Epochs;
use super::event::{Action, Event, Hello, Report, Ticket, WorkerId};
use super::hysteresis::Hysteresis;
use super::investments::Investments;
use super::lines::Lines;
use super::pending::{InFlight, Pending, Waiting};
use super::placement::Placement;
use super::quality::{Model, Pace};
use super::silence::Awake;
use super::smooth::{Rate, Smoothed};
use super::spread::Spread;
use super::time::Uptime;
use super::whereabouts::Whereabouts;
use super::worker::Worker;

/// Views a tick of demand that are looked at to see which samples would be worth their price: that changes slowly.
const MOST_THOUGHTS: u32 = 4;

/// What happened since the coordinator started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counters {
    /// Views whose frame was relayed whole.
    pub views_answered: u64,
    /// Views that ended with a fault other than overload.
    pub views_failed: u64,
    /// Views turned away because of overload.
    pub views_rejected: u64,
    /// Session cameras that a newer one overtook before they were rendered.
    pub cameras_superseded: u64,
    /// Views sent to another worker after the first one failed.
    pub views_retried: u64,
    /// Frames that were thrown away because they were not good enough for their request.
    pub frames_refused: u64,
    /// Roles that a worker was told in place of another.
    pub roles_changed: u64,
    /// Workers that joined.
    pub workers_joined: u64,
    /// Workers that fell silent or whose stream ended unannounced.
    pub workers_lost: u64,
    /// Sessions that are open now.
    pub sessions_open: u64,
}

/// What is asked for, counted tick by tick.
#[derive(Debug, Clone)]
pub(super) struct Rates {
    pub(super) samples: Rate,
    pub(super) direct: Rate,
    /// Views from triangles whose request left the way open.
    pub(super) direct_anywhere: Rate,
    pub(super) views: Rate,
    pub(super) rays: Rate,
}

/// What things cost, as the workers measured it, seconds.
#[derive(Debug, Clone)]
pub(super) struct MeasuredCosts {
    pub(super) sample: Smoothed,
    pub(super) direct: Smoothed,
    pub(super) view: Smoothed,
    pub(super) ray: Smoothed,
    /// What is rendered for such a view, pixels with their sub-pixels.
    pub(super) direct_pixels: Smoothed,
    pub(super) view_pixels: Smoothed,
    /// Busy seconds of the busiest worker in a tick.
    pub(super) tick_secs: f64,
}

/// The cluster as its coordinator sees it. [`Core::step`] is the only way it changes.
#[derive(Debug)]
pub struct Core {
    pub(super) config: Config,
    pub(super) set: Arc<SampleSetInfo>,
    pub(super) workers: BTreeMap<WorkerId, Worker>,
    pub(super) views: BTreeMap<Ticket, Pending>,
    /// What clients have of what they may.
    pub(super) admission: Admission,
    pub(super) in_flight: InFlight,
    /// Views that no worker has room for yet.
    pub(super) waiting: Waiting,
    /// When which view's deadline or patience is over.
    pub(super) due: BTreeSet<(Uptime, Ticket)>,
    pub(super) lines: Lines,
    pub(super) whereabouts: Whereabouts,
    pub(super) spread: Spread,
    /// By camera: one who composes from the last epoch's sample and lacks the next one's.
    pub(super) laggards: BTreeMap<u64, WorkerId>,
    /// Samples that are worth a second copy.
    pub(super) lately: Lately,
    /// Whether what workers shall have at hand may be another than they were told.
    pub(super) to_refine: bool,
    pub(super) directory: Directory,
    pub(super) placement: Placement,
    pub(super) investments: Investments,
    /// Views that may still be looked at to see which samples are worth their price, in the tick that runs.
    pub(super) thoughts: Cell<u32>,
    /// Views from triangles since the last one that was looked at.
    pub(super) unthought: u32,
    /// Ticks for which views from triangles have taken so much time that samples may be worth measuring.
    pub(super) steady_ticks: f64,
    pub(super) epochs: Epochs,
    /// What probes have taught of predicted errors.
    pub(super) error: CalibratedError,
    /// What calibration measured of the scene, of each kind of device; none where nobody calibrated.
    pub(super) models: Vec<Arc<Model>>,
    /// Which of the rig's cameras see what a view shows; where nobody knows, the nearest are the best.
    pub(super) sight: Option<Arc<dyn Sight>>,
    pub(super) last_choice: LastChoice,
    /// How costs differ from what the models say.
    pub(super) pace: Pace,
    pub(super) rates: Rates,
    pub(super) costs: MeasuredCosts,
    pub(super) hysteresis: Hysteresis,
    pub(super) split: Split,
    pub(super) counters: Counters,
    pub(super) draining: bool,
    /// Whether it is known how triangles are seen.
    pub(super) way_is_settled: bool,
    /// Workers that will probably join.
    pub(super) expected: usize,
    pub(super) awake: Awake,
    tick_began: Uptime,
}

impl Core {
    /// Plans views by what the rig's cameras see.
    #[must_use]
    pub fn with_sight(self, sight: Option<Arc<dyn Sight>>) -> Self {
        Self { sight, ..self }
    }

    /// A cluster without workers that serves samples of one set, from uptime zero on.
    pub fn new(config: Config, set: Arc<SampleSetInfo>) -> Self {
        let rate = || Rate::new(config.smoothing);
        let cost = || Smoothed::new(config.smoothing);
        let every = (set.epoch_secs > 0.0).then_some(config.epoch);
        let epochs =
            Epochs::new(every, config.epoch_interest, config.epoch_patience).with_plans(config.refresh_views);
        let way_is_settled = config.visibility.is_some();
        let set = match config.visibility {
            Some(visibility) => Arc::new(SampleSetInfo { visibility, ..(*set).clone() }),
            None => set,
        };
        let idle_secs = config.tick.as_secs_f64() * config.idle_fraction;
        Self {
            hysteresis: Hysteresis::new(config.margin, config.dwell, idle_secs),
            rates: Rates {
                samples: rate(),
                direct: rate(),
                direct_anywhere: rate(),
                views: rate(),
                rays: rate(),
            },
            costs: MeasuredCosts {
                sample: cost(),
                direct: cost(),
                view: cost(),
                ray: cost(),
                direct_pixels: cost(),
                view_pixels: cost(),
                tick_secs: 0.0,
            },
            models: Vec::new(),
            sight: None,
            last_choice: LastChoice::default(),
            pace: Pace::new(config.smoothing),
            config,
            set,
            workers: BTreeMap::new(),
            views: BTreeMap::new(),
            admission: Admission::default(),
            in_flight: InFlight::default(),
            waiting: Waiting::default(),
            due: BTreeSet::new(),
            lines: Lines::default(),
            whereabouts: Whereabouts::default(),
            spread: Spread::default(),
            laggards: BTreeMap::new(),
            lately: Lately::default(),
            to_refine: false,
            directory: Directory::default(),
            placement: Placement::default(),
            investments: Investments::default(),
            thoughts: Cell::default(),
            unthought: 0,
            steady_ticks: 0.0,
            epochs,
            error: CalibratedError::default(),
            split: Split::Nobody,
            counters: Counters::default(),
            draining: false,
            way_is_settled,
            expected: 0,
            awake: Awake::default(),
            tick_began: Uptime::default(),
        }
    }

    /// What it was configured with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The set that all samples belong to, at the epoch that is served. Its lighting is that of epoch 0: who renders
    /// asks the scene.
    pub fn set(&self) -> &Arc<SampleSetInfo> {
        &self.set
    }

    /// Whether it is settled how triangles are seen: until then no samples are rendered.
    pub fn visibility_is_settled(&self) -> bool {
        self.way_is_settled
    }

    /// Views waiting or in work.
    pub fn views_in_flight(&self) -> usize {
        self.views.len()
    }

    /// The same, where so many workers are expected to join: the first ones then take the roles that they will have
    /// among all, and not those of a cluster of one or two.
    pub fn expecting(mut self, workers: usize) -> Self {
        self.expected = workers;
        self
    }

    /// Whether a view that is asked for now has somebody to render it.
    pub fn can_answer(&self) -> bool {
        !self.draining && self.members().any(Worker::seems_well)
    }

    /// Whether that view waits or is in work.
    pub fn is_open(&self, ticket: Ticket) -> bool {
        self.views.contains_key(&ticket)
    }

    /// Whether new views are turned away since the process is about to end.
    pub fn is_draining(&self) -> bool {
        self.draining
    }

    /// Takes one event in, at `now`, which never goes back. The actions are to be done in order.
    pub fn step(&mut self, event: Event, now: Uptime) -> Vec<Action> {
        let mut actions = Vec::new();
        match event {
            Event::Joined { worker, hello } => self.join(worker, hello, now, &mut actions),
            Event::Reported { worker, report } => self.report(worker, report, now, &mut actions),
            Event::Left { worker } => self.leave(worker, now, &mut actions),
            Event::Asked { ticket, client, view, deadline, survey } => {
                self.ask(ticket, (client, deadline), &view, survey, now, &mut actions);
            }
            Event::Surveyed { pixels, survey } => self.learn_thought(pixels, &survey),
            Event::Judged { ticket, attempt, observed, ms } => {
                self.judge(ticket, attempt, observed, ms, &mut actions);
            }
            Event::Answered { ticket, attempt, uncovered, ms } => {
                self.answered(ticket, attempt, uncovered, ms);
            }
            Event::Failed { ticket, attempt, failure } => {
                self.failed(ticket, attempt, failure, now, &mut actions);
            }
            Event::Cancelled { ticket } => {
                self.take_back(ticket, false);
                self.forget(ticket);
            }
            Event::SessionOpened { client } => self.admission.open_session(&client),
            Event::SessionClosed { client } => self.admission.close_session(&client),
            Event::CameraSuperseded => self.counters.cameras_superseded += 1,
            Event::Drain => self.draining = true,
            Event::Tick => self.tick(now, &mut actions),
        }
        self.counters.sessions_open = self.admission.sessions() as u64;
        self.pump(now, &mut actions);
        actions
    }

    /// Whether that client may open a session now; what is decided is so until the next event.
    ///
    /// # Errors
    /// [`Fault::Overloaded`].
    pub fn check_session(&self, client: &str) -> Result<(), Fault> {
        match self.draining {
            true => Err(Fault::Unavailable("the coordinator is shutting down".to_owned())),
            false => self.admission.check_session(client, &self.config),
        }
    }

    fn join(&mut self, id: WorkerId, hello: Hello, now: Uptime, actions: &mut Vec<Action>) {
        let same_name = |w: &&Worker| w.hello.name == hello.name;
        if let Some(older) = self.workers.values().find(same_name).map(|w| w.id) {
            let reason = format!("worker {} joined again", hello.name);
            actions.push(Action::Expel { worker: older, reason });
            self.lose(older, now, actions);
        }
        self.counters.workers_joined += 1;
        let worker = Worker::new(id, hello, self.role_of_newcomer(), self.way_is_settled, now);
        actions.push(Action::Assign { worker: id, assignment: worker.assigned().clone() });
        self.lines.update(&worker);
        self.workers.insert(id, worker);
        self.to_refine = true;
    }

    fn report(&mut self, id: WorkerId, mut report: Report, now: Uptime, actions: &mut Vec<Action>) {
        let is_stuck = self.workers.get(&id).is_some_and(|worker| self.is_stuck(worker, &report));
        let Some(worker) = self.workers.get_mut(&id) else {
            let reason = "its lease ran out, or it was replaced".to_owned();
            actions.push(Action::Expel { worker: id, reason });
            return;
        };
        let before = &worker.report;
        let observe = |cost: &mut Smoothed, done: u64, done_before: u64, ms: Option<f64>| {
            if let Some(ms) = ms.filter(|_| done > done_before) {
                cost.observe(ms * 1e-3);
            }
        };
        let costs = &mut self.costs;
        observe(&mut costs.sample, report.samples_rendered, before.samples_rendered, report.sample_ms);
        observe(&mut costs.direct, report.views_direct, before.views_direct, report.direct_ms);
        observe(&mut costs.view, report.views_composed, before.views_composed, report.view_ms);
        observe(&mut costs.ray, report.rays_traced, before.rays_traced, report.ray_ms);
        if let Some((error, predicted)) = report.probed.since(&before.probed) {
            self.error.observe(error, predicted);
        }
        // How many rays a view needs is known once they are traced.
        if before.applied > 0 {
            self.rates.rays.count(report.rays_traced.saturating_sub(before.rays_traced));
        }
        let (was_ready, was_suspected) = (worker.is_ready(), worker.suspected);
        if before.applied == 0 {
            // Joined again after a coordinator's restart: what it was busy with before is not this tick's.
            worker.busy_at_tick_ms = report.sampling_busy_ms + report.compositing_busy_ms;
        }
        let ways = std::mem::take(&mut report.ways);
        let (could_compose, could_sample) = (worker.takes_views(), worker.takes_samples());
        let news = worker.take_report(report, now, &mut self.whereabouts);
        worker.suspected = is_stuck;
        self.lines.update(worker);
        self.to_refine |= was_suspected != is_stuck
            || news
            || (could_compose, could_sample) != (worker.takes_views(), worker.takes_samples());
        if worker.is_ready() != was_ready {
            self.processes_changed(actions);
        }
        self.settle_way(&ways, actions);
        self.seek_way(actions);
        // It may have what the next epoch waits for; then the one after it is issued at once.
        if news && self.epochs.moves() && self.advance(now) {
            self.refine(now, actions);
        }
    }

    /// A worker's stream ended: announced if it said that it leaves and has nothing left to do.
    fn leave(&mut self, id: WorkerId, now: Uptime, actions: &mut Vec<Action>) {
        if self.workers.contains_key(&id) {
            self.lose(id, now, actions);
        }
    }

    /// Forgets a worker; its views go to others.
    fn lose(&mut self, id: WorkerId, now: Uptime, actions: &mut Vec<Action>) {
        let Some(worker) = self.workers.remove(&id) else { return };
        worker.vanish(&mut self.whereabouts);
        self.lines.remove(id);
        self.spread.forget(id);
        self.to_refine = true;
        if !worker.report.leaving {
            self.counters.workers_lost += 1;
        }
        for ticket in worker.views.keys().copied() {
            self.retry(ticket, now, actions);
        }
        self.processes_changed(actions);
    }

    fn tick(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        self.advance(now);
        self.suspect(now, actions);
        let silent = |w: &&Worker| now.since(w.last_report) >= self.config.lease;
        let lost: Vec<WorkerId> = self.workers.values().filter(silent).map(|w| w.id).collect();
        for worker in lost {
            let reason = format!("silent for {:.1} s", self.config.lease.as_secs_f64());
            actions.push(Action::Expel { worker, reason });
            self.lose(worker, now, actions);
        }
        self.expire(now, actions);
        let elapsed = now.since(self.tick_began);
        if elapsed >= self.config.tick {
            // A shell that was held up for several ticks closes one: what came meanwhile is counted in it.
            self.tick_began = now;
            self.thoughts.set(MOST_THOUGHTS);
            let ticks = elapsed.as_secs_f64() / self.config.tick.as_secs_f64();
            self.place_samples(ticks);
            self.invest(ticks);
            self.error.relax(elapsed.as_secs_f64());
            self.count_steady_ticks(ticks);
            let Rates { samples, direct, direct_anywhere, views, rays } = &mut self.rates;
            for rate in [samples, direct, direct_anywhere, views, rays] {
                rate.roll();
            }
            self.measure_tick(elapsed.as_secs_f64());
            self.directory.prune(&self.whereabouts, now);
            self.admission.prune(now);
            self.to_refine = true;
        }
        self.seek_way(actions);
        self.rebalance(now, actions);
        if self.to_refine {
            self.refine(now, actions);
        }
    }

    /// The busiest worker's time in the tick that ends: what the formula's tick predicts.
    fn measure_tick(&mut self, elapsed_secs: f64) {
        let mut busiest = 0.0_f64;
        for worker in self.workers.values_mut() {
            busiest = busiest.max(worker.busy_ms() - worker.busy_at_tick_ms);
            worker.busy_at_tick_ms = worker.busy_ms();
        }
        let ticks = elapsed_secs / self.config.tick.as_secs_f64();
        let tick_secs = &mut self.costs.tick_secs;
        *tick_secs += self.config.smoothing * (busiest * 1e-3 / ticks - *tick_secs);
    }

    /// S, D, R, V per tick.
    pub(super) fn demand(&self) -> Demand {
        Demand {
            samples: self.rates.samples.per_tick(),
            direct: self.rates.direct.per_tick(),
            direct_anywhere: self.rates.direct_anywhere.per_tick(),
            rays: self.rates.rays.per_tick(),
            views: self.rates.views.per_tick(),
        }
    }

    /// What is believed of costs by the formula. A direct view and a sample are alike (both render the triangles), so either
    /// stands in for the other while that is unmeasured. The planner goes by what each worker measured, and never by another
    /// kind's cost.
    pub(super) fn believed_costs(&self) -> Costs {
        let (sample, direct) = (self.costs.sample.value(), self.costs.direct.value());
        Costs {
            sample_secs: sample.or(direct).unwrap_or(0.0),
            direct_secs: direct.or(sample).unwrap_or(0.0),
            ray_secs: self.costs.ray.value().unwrap_or(0.0),
            view_secs: self.costs.view.value().unwrap_or(0.0),
        }
    }
}
