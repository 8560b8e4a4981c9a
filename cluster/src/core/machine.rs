//! The state machine: passes each event to the part that it concerns, and each part's results to the other parts.
//!
//! `workers` reads neither of the other parts, `samples` reads `workers`, `views` reads both. Results that concern
//! another part are returned values, passed on only here.

use std::sync::Arc;

use argus_proto::Fault;
use argus_proto::v1::StatusResponse;
use argus_scene::effects::EffectCost;
use argus_scene::rig::VisibilityQuery;
use argus_scene::{SampleSetInfo, Version};

use super::config::Config;
use super::event::{Action, Event, Hello, Purchase, Report, ViewId, WorkerId};
use super::quality::Model;
use super::samples::Samples;
use super::status;
use super::time::Uptime;
use super::views::{Answer, Cluster, NewView, Output, Views};
use super::workers::balance::Split;
use super::workers::{WorkKind, Worker, Workers};

/// The coordinator's state of the cluster. Only [`Core::step`] changes it.
#[derive(Debug)]
pub struct Core {
    config: Arc<Config>,
    workers: Workers,
    samples: Samples,
    views: Views,
    tick_began: Uptime,
    /// Time of the last event.
    now: Uptime,
}

impl Core {
    /// A cluster without workers, at uptime zero, that serves samples of one set.
    pub fn new(config: Config, set: Arc<SampleSetInfo>) -> Self {
        let config = Arc::new(config);
        Self {
            workers: Workers::new(&config, set.sampling.batch() as u64),
            samples: Samples::new(&config, set),
            views: Views::new(&config),
            tick_began: Uptime::default(),
            now: Uptime::default(),
            config,
        }
    }

    /// Sets the ray queries by which cameras are chosen; `None`: by distance.
    #[must_use]
    pub fn with_sight(mut self, sight: Option<Arc<dyn VisibilityQuery>>) -> Self {
        self.samples.plan_by(sight);
        self
    }

    /// Adds calibrated models. Models of other scenes or rigs are dropped.
    #[must_use]
    pub fn with_models(mut self, mut models: Vec<Model>) -> Self {
        let set = self.samples.set();
        models.retain(|model| model.fits(set.scene, &set.rig));
        self.views.learn_models(models);
        self
    }

    /// Expects this many workers, so that the first ones take the roles that they will have among all.
    pub fn expecting(mut self, workers: usize) -> Self {
        self.workers.expect(workers);
        self
    }

    /// Name of the first worker that renders samples or is about to; statuses show only roles that are in effect.
    #[cfg(test)]
    pub(super) fn first_sampler(&self) -> Option<String> {
        let samples = |w: &&Worker| w.role().is_some_and(super::event::Role::samples);
        self.workers.members().find(samples).map(|worker| worker.hello().name.clone())
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The sample set in the served version. Its lighting is that of epoch 0: renderers take the present lighting
    /// from the scene.
    pub fn set(&self) -> &Arc<SampleSetInfo> {
        self.samples.set()
    }

    /// The versions whose samples may be in assignments and orders.
    pub fn live_versions(&self) -> Vec<Version> {
        self.samples.live_versions()
    }

    /// Whether the visibility backend of samples is chosen. Until then no samples are rendered.
    pub fn visibility_is_settled(&self) -> bool {
        self.workers.visibility_is_settled()
    }

    /// Number of views waiting or in work.
    pub fn views_in_flight(&self) -> usize {
        self.views.len()
    }

    /// The last report of a worker; `None` if it is unknown.
    pub fn last_report(&self, worker: WorkerId) -> Option<&Report> {
        self.workers.get(worker).map(Worker::report)
    }

    /// Number of views that a worker has to answer.
    pub fn views_at(&self, worker: WorkerId) -> usize {
        self.workers.get(worker).map_or(0, Worker::queued)
    }

    /// Number of views that were answered so far.
    pub fn views_answered(&self) -> u64 {
        self.views.counts().answered
    }

    /// Processes that views ask for, each from triangles in full, at the last tick.
    pub fn asked(&self) -> f64 {
        self.views.asked()
    }

    /// Number of workers that answer views.
    pub fn answering(&self) -> usize {
        self.workers.members().filter(|worker| worker.answers()).count()
    }

    /// Number of open sessions.
    pub fn sessions_open(&self) -> usize {
        self.views.sessions()
    }

    /// Whether a new view could be answered now.
    pub fn can_answer(&self) -> bool {
        !self.views.is_draining() && self.workers.members().any(Worker::seems_well)
    }

    /// Whether new views could be answered now, and the planner knows what they cost: a worker measured it, or has rendered
    /// views.
    pub fn is_ready_for_load(&self) -> bool {
        let is_priced = |worker: &Worker| {
            let report = worker.report();
            report.direct_cost.is_some() || report.direct_ms.is_some()
        };
        !self.views.is_draining()
            && self.workers.members().any(|worker| worker.seems_well() && is_priced(worker))
    }

    /// What effects of light cost in views from triangles, as workers measured it.
    pub fn effect_costs(&self) -> Vec<EffectCost> {
        self.workers.effect_costs()
    }

    /// Whether a view is waiting or in work.
    pub fn is_open(&self, view_id: ViewId) -> bool {
        self.views.is_open(view_id)
    }

    /// Whether new views are refused because the process shuts down.
    pub fn is_draining(&self) -> bool {
        self.views.is_draining()
    }

    /// Checks whether a client may open a session. The answer holds until the next event.
    ///
    /// # Errors
    /// [`Fault::Overloaded`].
    pub fn check_session(&self, client: &str) -> Result<(), Fault> {
        self.views.check_session(client)
    }

    /// A snapshot of the cluster. The shell knows its scene, term and time of planning.
    pub fn status(&self) -> StatusResponse {
        let market = self.views.market_status(self.cluster(), self.now);
        status::of(&self.workers, &self.samples, &self.views, market)
    }

    /// Serves the scene with other transforms of nodes from now on. Views that wait show them, too, unless they are pinned. `kept`: the
    /// revisions that can still be shown. Returns the number of samples that show the state before.
    pub fn move_nodes(&mut self, revision: u64, kept: &[u64]) -> u64 {
        let stale = self.samples.move_nodes(revision, kept.iter().copied(), self.views.needed_versions());
        self.views.move_waiting(self.samples.set().version);
        stale
    }

    /// Pages of light cells that workers hold.
    pub fn cell_pages(&self) -> u64 {
        self.workers.members().filter_map(|worker| Some(worker.report().light_cells.as_ref()?.pages)).sum()
    }

    fn cluster(&self) -> Cluster<'_> {
        Cluster { config: &self.config, workers: &self.workers, samples: &self.samples }
    }

    /// The views, to be changed, and the other parts, to be read.
    fn parts(&mut self) -> (&mut Views, Cluster<'_>) {
        let cluster = Cluster { config: &self.config, workers: &self.workers, samples: &self.samples };
        (&mut self.views, cluster)
    }

    /// Processes one event at `now`, which never decreases. The shell executes the actions in order.
    pub fn step(&mut self, event: Event, now: Uptime) -> Vec<Action> {
        self.now = now;
        let mut actions = Vec::new();
        match event {
            Event::Joined { worker, hello } => self.join(worker, hello, now, &mut actions),
            Event::Reported { worker, report } => self.report(worker, report, now, &mut actions),
            Event::Left { worker } => self.lose(worker, now, &mut actions),
            Event::Requested { view_id, client, view, deadline, last } => {
                self.samples.wake(now, self.views.needed_versions());
                let new = NewView { view_id, client, view: &view, deadline, last };
                self.on_views(now, &mut actions, |views, cluster| views.submit(new, cluster, now));
            }
            Event::Judged { view_id, attempt, observed, ms } => {
                self.on_views(now, &mut actions, |views, cluster| {
                    views.judge((view_id, attempt), observed, ms, cluster)
                });
            }
            Event::Answered { view_id, attempt, uncovered, ms, fell_short } => {
                let answer = Answer { uncovered, ms, fell_short };
                self.on_views(now, &mut actions, |views, cluster| {
                    views.answered((view_id, attempt), answer, cluster)
                });
            }
            Event::Failed { view_id, attempt, failure } => {
                self.on_views(now, &mut actions, |views, cluster| {
                    views.failed((view_id, attempt), failure, cluster, now)
                });
            }
            Event::Cancelled { view_id } => {
                self.on_views(now, &mut actions, |views, _| views.cancel(view_id));
            }
            Event::SessionOpened { client } => self.views.open_session(&client),
            Event::SessionClosed { client } => self.views.close_session(&client),
            Event::CameraSuperseded => self.views.camera_superseded(),
            Event::Drain => self.views.drain(),
            Event::Tick => self.tick(now, &mut actions),
        }
        self.pump(now, &mut actions);
        actions
    }

    /// Changes the views, and applies their outputs.
    fn on_views<E: IntoIterator<Item = Output>>(
        &mut self,
        now: Uptime,
        actions: &mut Vec<Action>,
        change: impl FnOnce(&mut Views, Cluster<'_>) -> E,
    ) {
        let (views, cluster) = self.parts();
        for output in change(views, cluster) {
            self.apply(output, now, actions);
        }
    }

    fn join(&mut self, id: WorkerId, hello: Hello, now: Uptime, actions: &mut Vec<Action>) {
        if let Some(older) = self.workers.named(&hello.name) {
            let reason = format!("worker {} joined again", hello.name);
            actions.push(Action::Expel { worker: older, reason });
            self.lose(older, now, actions);
        }
        self.workers.join(id, hello, now, actions);
    }

    fn report(&mut self, id: WorkerId, mut report: Report, now: Uptime, actions: &mut Vec<Action>) {
        let Some(worker) = self.workers.get(id) else {
            let reason = "its lease ran out, or it was replaced".to_owned();
            actions.push(Action::Expel { worker: id, reason });
            return;
        };
        let before = worker.report();
        let (held, before) = ((&*report.held, &*report.partial), (&*before.held, &*before.partial));
        let has_news = self.samples.reported(id, held, before);
        // News are of one report, which is kept as the last one.
        let (sources, probes) = (report.sources.take(), std::mem::take(&mut report.probes));
        let done = sources.map_or_else(Vec::new, |news| self.samples.pool_mut().reported(id, &news));
        self.views.learn(&done, &probes);
        let measured = std::mem::take(&mut report.backend_costs);
        if self.workers.report(id, report, now, || self.views.largest()) {
            self.processes_changed(actions);
        }
        let (views, cluster) = self.parts();
        views.meet(cluster);
        let settled = self.workers.settle_visibility(&measured, actions);
        if let Some(version) = settled.and_then(|visibility| self.samples.see_by(visibility)) {
            self.views.move_waiting(version);
        }
        self.seek_visibility(actions);
        // The worker may hold the last samples of the next version; then the one after it is issued at once.
        if has_news && self.samples.versions_change() && self.advance(now) {
            self.refine(now, actions);
        }
    }

    /// Removes a lost worker, and retries its views.
    fn lose(&mut self, id: WorkerId, now: Uptime, actions: &mut Vec<Action>) {
        let Some(worker) = self.workers.lose(id) else { return };
        self.samples.forget(id);
        let lost = worker.views().keys().copied();
        self.on_views(now, actions, |views, cluster| views.retry_all(lost, cluster, now));
        self.processes_changed(actions);
    }

    fn tick(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        self.advance(now);
        self.workers.notice(now);
        self.on_views(now, actions, |views, cluster| views.leave_suspected(cluster, now));
        for worker in self.workers.silent(now) {
            let reason = format!("silent for {:.1} s", self.config.lease.as_secs_f64());
            actions.push(Action::Expel { worker, reason });
            self.lose(worker, now, actions);
        }
        self.on_views(now, actions, |views, cluster| views.expire(cluster, now));
        let elapsed = now.since(self.tick_began);
        if elapsed >= self.config.tick {
            // A shell that was held up for several ticks closes one, which counts everything since.
            self.tick_began = now;
            let ticks = elapsed.as_secs_f64() / self.config.tick.as_secs_f64();
            let (views, cluster) = self.parts();
            views.tick(cluster, now);
            let state = self.samples.set().version.state;
            self.samples.pool_mut().give_up(state, now);
            let ordered = self.samples.tick(&self.workers, ticks, now);
            self.workers.count(WorkKind::Samples, ordered as u64);
            self.workers.tick(ticks);
        }
        self.seek_visibility(actions);
        if let Some(split) = self.workers.better_split(now) {
            self.divide(split, actions);
        }
        if self.workers.has_changed() || self.samples.has_changed() {
            self.refine(now, actions);
        }
    }

    /// Dispatches waiting views to workers with room, one after the other: each dispatch changes the state for the
    /// next.
    fn pump(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let mut round = self.views.begin_round();
        loop {
            let (views, cluster) = self.parts();
            let Some(given) = views.next(&mut round, cluster, now) else { break };
            let (sources, to_render) = self.samples.find(given.worker, &given.samples, &self.workers, now);
            self.workers.count(WorkKind::Samples, to_render);
            given.decided.iter().for_each(|(kind, n)| self.workers.count(*kind, *n));
            let (views, cluster) = self.parts();
            let Some((order, queued)) = views.give(&given, sources, cluster) else { continue };
            self.workers.begin(given.worker, given.view_id, queued, now);
            self.samples.begin(given.worker, given.samples.iter().map(|(id, _)| *id));
            actions.push(Action::Dispatch { view_id: given.view_id, order });
        }
        self.buy(now, actions);
    }

    /// Orders the sources that are worth their price.
    fn buy(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        loop {
            let (views, cluster) = self.parts();
            let Some(coming) = views.purchase(cluster, now) else { return };
            let worker = coming.worker;
            self.samples.pool_mut().order(coming);
            let of_worker = self.samples.pool().coming().iter().filter(|coming| coming.worker == worker);
            let purchases = of_worker.map(|coming| Purchase { source: coming.source, state: coming.state });
            self.workers.assign_purchases(worker, purchases.collect(), actions);
        }
    }

    /// Applies one output of a view to the other parts.
    fn apply(&mut self, output: Output, now: Uptime, actions: &mut Vec<Action>) {
        match output {
            Output::Act(action) => actions.push(action),
            Output::Demand(kind) => self.workers.count(kind, 1),
            Output::Used { cameras } => self.samples.note_use(&cameras, now),
            Output::Answered { worker, direct, work } => self.workers.answered(worker, direct, work),
            Output::Blamed { worker, view_id } => self.workers.blame(worker, view_id, now),
            Output::TakenBack { worker, view_id, samples, answered } => {
                if self.workers.end(worker, view_id, now) {
                    self.samples.end(worker, &samples, answered);
                }
            }
            Output::Holes { camera, used, uncovered, pixels } => {
                self.samples.learn_holes(&camera, &used, uncovered, pixels);
            }
        }
    }

    /// Serves the next version once it is ready, and issues the one after it. S counts its samples. Returns whether
    /// anything changed.
    fn advance(&mut self, now: Uptime) -> bool {
        let advanced = self.samples.advance(&self.workers, self.views.needed_versions(), now);
        self.workers.count(WorkKind::Samples, advanced.ordered as u64);
        advanced.changed
    }

    /// Has a worker measure the visibility backends, if samples are wanted and the backend is not chosen.
    fn seek_visibility(&mut self, actions: &mut Vec<Action>) {
        let samples_are_wanted =
            self.views.want_samples() || self.samples.placement().placed().next().is_some();
        self.workers.seek_visibility(samples_are_wanted, actions);
    }

    /// Divides the roles anew, after a worker became ready or stopped being so.
    fn processes_changed(&mut self, actions: &mut Vec<Action>) {
        let split = self.workers.split_of_change();
        self.divide(split, actions);
    }

    /// Assigns roles by a split.
    fn divide(&mut self, split: Split, actions: &mut Vec<Action>) {
        self.workers.divide(split, &self.samples.sample_counts(), actions);
    }

    /// Sends changed prefetch lists.
    fn refine(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let prefetch = self.samples.refine(&self.workers, self.views.needed_versions(), now);
        self.workers.assign_prefetch(prefetch, actions);
    }
}

#[cfg(test)]
impl Core {
    /// Sets K, for tests.
    pub(super) fn set_most_purchases(&mut self, most: u32) {
        self.views.set_most_purchases(most);
    }

    /// The workers, for tests.
    pub(super) fn workers(&self) -> &Workers {
        &self.workers
    }

    /// The samples, for tests.
    pub(super) fn samples(&self) -> &Samples {
        &self.samples
    }
}
