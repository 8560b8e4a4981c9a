//! The machine itself: which part each event concerns, and what one part decides that the others have to know.
//!
//! `workers` reads neither of the other parts, `samples` reads `workers`, `views` reads both. What goes back is a returned
//! value, and it is passed on here and nowhere else.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::rig::Sight;
use argus_scene::{SampleSetInfo, Version, View};

use super::config::Config;
use super::event::{Action, Event, Hello, LastView, Report, ViewId, WorkerId};
use super::quality::Model;
use super::samples::Samples;
use super::status::Status;
use super::time::Uptime;
use super::views::{Cluster, Output, NewView, SurveyWanted, Views};
use super::workers::balance::Split;
use super::workers::{WorkKind, Worker, Workers};

/// The cluster as its coordinator sees it. [`Core::step`] is the only way it changes.
#[derive(Debug)]
pub struct Core {
    config: Arc<Config>,
    workers: Workers,
    samples: Samples,
    views: Views,
    tick_began: Uptime,
}

impl Core {
    /// A cluster without workers that serves samples of one set, from uptime zero on.
    pub fn new(config: Config, set: Arc<SampleSetInfo>) -> Self {
        let config = Arc::new(config);
        Self {
            workers: Workers::new(&config, set.sampling.batch() as u64),
            samples: Samples::new(&config, set),
            views: Views::new(&config),
            tick_began: Uptime::default(),
            config,
        }
    }

    /// Plans views by what the rig's cameras see.
    #[must_use]
    pub fn with_sight(mut self, sight: Option<Arc<dyn Sight>>) -> Self {
        self.samples.plan_by(sight);
        self
    }

    /// With what calibration measured of the scene that is served; models of other scenes and rigs are dropped.
    #[must_use]
    pub fn with_models(mut self, mut models: Vec<Model>) -> Self {
        let set = self.samples.set();
        models.retain(|model| model.fits(set.scene, &set.rig));
        self.views.learn_models(models);
        self
    }

    /// Expects so many workers to join: the first ones then take the roles that they will have among all, and not those of
    /// a cluster of one or two.
    pub fn expecting(mut self, workers: usize) -> Self {
        self.workers.expect(workers);
        self
    }

    /// What it was configured with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The set that all samples belong to, in the version that is served. Its lighting is that of epoch 0: who renders
    /// asks the scene.
    pub fn set(&self) -> &Arc<SampleSetInfo> {
        self.samples.set()
    }

    /// The versions whose samples workers may be told of.
    pub fn live_versions(&self) -> Vec<Version> {
        self.samples.live_versions()
    }

    /// Whether it is settled how triangles are seen: until then no samples are rendered.
    pub fn visibility_is_settled(&self) -> bool {
        self.workers.visibility_is_settled()
    }

    /// Views waiting or in work.
    pub fn views_in_flight(&self) -> usize {
        self.views.len()
    }

    /// Whether there is a worker to render a view that is asked for now.
    pub fn can_answer(&self) -> bool {
        !self.views.is_draining() && self.workers.members().any(Worker::seems_well)
    }

    /// Whether that view waits or is in work.
    pub fn is_open(&self, view_id: ViewId) -> bool {
        self.views.is_open(view_id)
    }

    /// Whether new views are turned away since the process is about to end.
    pub fn is_draining(&self) -> bool {
        self.views.is_draining()
    }

    /// Whether that client may open a session now; what is decided is so until the next event.
    ///
    /// # Errors
    /// [`Fault::Overloaded`].
    pub fn check_session(&self, client: &str) -> Result<(), Fault> {
        self.views.check_session(client)
    }

    /// What is to be found out about a view before it is asked for; `None` where that would change nothing: its way is not
    /// open, or no worker holds a sample near it.
    pub fn survey_wanted(&self, view: &View, last: Option<&LastView>) -> Option<SurveyWanted> {
        self.cluster().survey_wanted(view, last)
    }

    /// What is to be found out about a view, while no client waits for it, to see which samples would be worth their price;
    /// [`Event::Surveyed`] brings the answer. `None` for most views: a few a second tell enough.
    pub fn bundle_survey_wanted(&self, view: &View) -> Option<SurveyWanted> {
        self.views.bundle_survey_wanted(view, self.cluster())
    }

    /// The cluster at a glance.
    pub fn status(&self) -> Status {
        Status::of(&self.workers, &self.samples, &self.views)
    }

    fn cluster(&self) -> Cluster<'_> {
        Cluster { config: &self.config, workers: &self.workers, samples: &self.samples }
    }

    /// Views to change, and the cluster that they read.
    fn parts(&mut self) -> (&mut Views, Cluster<'_>) {
        let cluster = Cluster { config: &self.config, workers: &self.workers, samples: &self.samples };
        (&mut self.views, cluster)
    }

    /// Takes one event in, at `now`, which never goes back. The actions are to be done in order.
    pub fn step(&mut self, event: Event, now: Uptime) -> Vec<Action> {
        let mut actions = Vec::new();
        match event {
            Event::Joined { worker, hello } => self.join(worker, hello, now, &mut actions),
            Event::Reported { worker, report } => self.report(worker, report, now, &mut actions),
            Event::Left { worker } => self.lose(worker, now, &mut actions),
            Event::Requested { view_id, client, view, deadline, survey, last } => {
                self.samples.wake(now, self.views.needed_versions());
                let new = NewView { view_id, client, view: &view, deadline, survey, last };
                self.on_views(now, &mut actions, |views, cluster| views.submit(new, cluster, now));
            }
            Event::Surveyed { pixels, survey } => self
                .on_views(now, &mut actions, |views, cluster| views.learn_bundle_survey(pixels, &survey, cluster)),
            Event::Judged { view_id, attempt, observed, ms } => {
                self.on_views(now, &mut actions, |views, cluster| {
                    views.judge((view_id, attempt), observed, ms, cluster)
                });
            }
            Event::Answered { view_id, attempt, uncovered, ms } => {
                self.on_views(now, &mut actions, |views, cluster| {
                    views.answered((view_id, attempt), uncovered, ms, cluster)
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

    /// Changes views by what workers and samples are, and passes on what follows for these.
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
        let has_news = self.samples.reported(id, &report.held, &worker.report().held);
        if let Some((error, predicted)) = report.probed.since(&worker.report().probed) {
            self.samples.observe_error(error, predicted);
        }
        let measured = std::mem::take(&mut report.ways);
        if self.workers.report(id, report, now, || self.views.largest()) {
            self.processes_changed(actions);
        }
        let settled = self.workers.settle_visibility(&measured, actions);
        if let Some(version) = settled.and_then(|visibility| self.samples.see_by(visibility)) {
            self.views.move_waiting(version);
        }
        self.seek_visibility(actions);
        // It may have what the next version waits for; then the one after it is issued at once.
        if has_news && self.samples.scene_moves() && self.advance(now) {
            self.refine(now, actions);
        }
    }

    /// Forgets a worker; its views go to others.
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
            // A shell that was held up for several ticks closes one: what came meanwhile is counted in it.
            self.tick_began = now;
            let ticks = elapsed.as_secs_f64() / self.config.tick.as_secs_f64();
            let ordered = self.samples.tick(&self.workers, ticks, now);
            self.workers.count(WorkKind::Samples, ordered as u64);
            self.workers.tick(ticks);
            self.views.tick(now);
        }
        self.seek_visibility(actions);
        if let Some(split) = self.workers.better_split(now) {
            self.divide(split, actions);
        }
        if self.workers.has_changed() || self.samples.has_changed() {
            self.refine(now, actions);
        }
    }

    /// Gives views that wait to workers with room, one after the other: each changes what the next one goes by.
    fn pump(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let mut round = self.views.begin_round();
        loop {
            let (views, cluster) = self.parts();
            let Some(given) = views.next(&mut round, cluster) else { return };
            let (sources, to_render) = self.samples.find(given.worker, &given.samples, &self.workers, now);
            self.workers.count(WorkKind::Samples, to_render);
            if let Some(kind) = given.decided {
                self.workers.count(kind, 1);
            }
            let (views, cluster) = self.parts();
            let Some((order, queued)) = views.give(&given, sources, cluster) else { continue };
            self.workers.begin(given.worker, given.view_id, queued);
            self.samples.begin(given.worker, given.samples.iter().map(|(id, _)| *id));
            actions.push(Action::Dispatch { view_id: given.view_id, order });
        }
    }

    /// Passes on what follows from a view.
    fn apply(&mut self, output: Output, now: Uptime, actions: &mut Vec<Action>) {
        match output {
            Output::Act(action) => actions.push(action),
            Output::Demand(kind) => self.workers.count(kind, 1),
            Output::Used { cameras } => self.samples.note_use(&cameras, now),
            Output::Answered { worker, direct, work } => self.workers.answered(worker, direct, work),
            Output::Blamed { worker, view_id } => self.workers.blame(worker, view_id, now),
            Output::TakenBack { worker, view_id, samples, answered } => {
                if self.workers.end(worker, view_id) {
                    self.samples.end(worker, &samples, answered);
                }
            }
            Output::Holes { camera, used, uncovered, pixels } => {
                self.samples.learn_holes(&camera, &used, uncovered, pixels);
            }
            Output::Saved { cameras, secs } => self.samples.credit(&cameras, secs, &self.workers),
            Output::WouldSave { cameras, secs } => self.samples.learn_bundle(cameras, secs),
        }
    }

    /// Serves the next version once it is ready, and issues the one after it. S counts its samples. Whether anything
    /// changed.
    fn advance(&mut self, now: Uptime) -> bool {
        let advanced = self.samples.advance(&self.workers, self.views.needed_versions(), now);
        self.workers.count(WorkKind::Samples, advanced.ordered as u64);
        advanced.changed
    }

    /// Has a worker measure, where samples are wanted and it is open how triangles are seen.
    fn seek_visibility(&mut self, actions: &mut Vec<Action>) {
        let samples_are_wanted =
            self.views.want_samples() || self.samples.placement().placed().next().is_some();
        self.workers.seek_visibility(samples_are_wanted, actions);
    }

    /// A worker became ready, or no longer is.
    fn processes_changed(&mut self, actions: &mut Vec<Action>) {
        let split = self.workers.split_of_change();
        self.divide(split, actions);
    }

    /// Gives workers the roles that they have under a split.
    fn divide(&mut self, split: Split, actions: &mut Vec<Action>) {
        self.workers.divide(split, &self.samples.stakes(), actions);
    }

    /// Tells workers what to have at hand, where that is news.
    fn refine(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        let prefetch = self.samples.refine(&self.workers, self.views.needed_versions(), now);
        self.workers.assign_prefetch(prefetch, actions);
    }
}

#[cfg(test)]
impl Core {
    /// What tests look at.
    pub(super) fn workers(&self) -> &Workers {
        &self.workers
    }

    /// What tests look at.
    pub(super) fn samples(&self) -> &Samples {
        &self.samples
    }
}
