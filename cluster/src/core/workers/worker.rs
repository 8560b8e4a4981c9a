//! What the core knows of one worker.

use std::collections::BTreeMap;

use super::queues::{QueueMembership, QueueEntry};
use super::record::Record;
use super::silence::Rhythm;
use crate::core::event::{Assignment, Hello, Report, Role, Source, ViewId, WorkerId};
use crate::core::time::Uptime;

/// A view in a worker's queue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::core) struct QueuedView {
    /// Milliseconds of rendering that are predicted of it.
    pub(in crate::core) predicted_ms: f64,
    /// Whether it is rendered from the triangles.
    pub(in crate::core) direct: bool,
    /// Pixels that are rendered for it, sub-pixels counted.
    pub(in crate::core) work: u64,
}

/// What workers shall have at hand ahead of demand.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct PrefetchLists {
    /// Of each worker that is told anything.
    pub(in crate::core) lists: BTreeMap<WorkerId, Vec<Source>>,
    /// Samples of versions with a lower number are of no use any more.
    pub(in crate::core) kept_from: u64,
    /// Addresses of workers that nobody shall wait for.
    pub(in crate::core) suspected: Vec<String>,
}

/// A worker that joined and was not lost.
#[derive(Debug, Clone)]
pub(in crate::core) struct Worker {
    id: WorkerId,
    hello: Hello,
    last_report: Uptime,
    /// How late its reports were lately.
    pub(super) rhythm: Rhythm,
    /// The newest report; a default one until the first.
    report: Report,
    /// What it did before the newest assignment that it has not acknowledged; `None` until its first role
    /// took effect.
    acting: Option<Role>,
    /// What it was told last.
    assigned: Assignment,
    /// Sequence of the first assignment that told it its role, and the set that it serves.
    role_told: u64,
    /// Sequence of the first assignment that told it the set that samples are rendered of; `None` until it was told.
    set_told: Option<u64>,
    /// Sequence of the assignment that told it to measure; `None` until one did.
    measure_told: Option<u64>,
    /// Views sent to it and not answered.
    views: BTreeMap<ViewId, QueuedView>,
    /// Views ever sent to it: whose turn it is among equals.
    dispatched: u64,
    /// Busy milliseconds when the current tick began.
    busy_at_tick_ms: f64,
    /// It has been silent for too long (`silence`), or does not get on with what it does.
    suspected: bool,
    /// How it has fared with its views.
    pub(super) record: Record,
}

impl Worker {
    pub(super) fn new(id: WorkerId, hello: Hello, role: Role, knows_set: bool, now: Uptime) -> Self {
        Self {
            id,
            hello,
            last_report: now,
            rhythm: Rhythm::default(),
            report: Report::default(),
            acting: None,
            assigned: Assignment {
                sequence: 1,
                role,
                prefetch: Vec::new(),
                kept_from: 0,
                measure_ways: false,
                suspected: Vec::new(),
            },
            role_told: 1,
            set_told: knows_set.then_some(1),
            measure_told: None,
            views: BTreeMap::new(),
            dispatched: 0,
            busy_at_tick_ms: 0.0,
            suspected: false,
            record: Record::default(),
        }
    }

    /// The id of its joining.
    pub(in crate::core) fn id(&self) -> WorkerId {
        self.id
    }

    /// What it said of itself when it joined.
    pub(in crate::core) fn hello(&self) -> &Hello {
        &self.hello
    }

    /// The newest report; a default one until the first.
    pub(in crate::core) fn report(&self) -> &Report {
        &self.report
    }

    /// When it was heard of last.
    pub(super) fn last_report(&self) -> Uptime {
        self.last_report
    }

    /// Views in its queue.
    pub(in crate::core) fn queued(&self) -> usize {
        self.views.len()
    }

    /// Views in its queue.
    pub(in crate::core) fn views(&self) -> &BTreeMap<ViewId, QueuedView> {
        &self.views
    }

    /// Its place among workers with room.
    pub(in crate::core) fn queue_entry(&self) -> QueueEntry {
        QueueEntry { queued: self.views.len(), dispatched: self.dispatched, worker: self.id }
    }

    /// What it can be given.
    pub(super) fn queue_membership(&self) -> QueueMembership {
        QueueMembership {
            entry: self.queue_entry(),
            ready: self.is_ready(),
            answers: self.answers(),
            composites: self.takes_views(),
            samples: self.takes_samples(),
        }
    }

    /// Whether it has been silent for too long, or does not get on with what it does.
    pub(in crate::core) fn is_suspected(&self) -> bool {
        self.suspected
    }

    /// Whether it has the scene and a role, and stays.
    pub(in crate::core) fn is_ready(&self) -> bool {
        self.acting.is_some() && !self.report.leaving
    }

    /// What it was told last.
    pub(in crate::core) fn assigned(&self) -> &Assignment {
        &self.assigned
    }

    /// Whether it is still on its way to the role it was told.
    pub(in crate::core) fn is_changing(&self) -> bool {
        self.acting.is_some_and(|acting| acting != self.assigned.role)
    }

    /// The role it counts for; `None` while it starts.
    pub(in crate::core) fn role(&self) -> Option<Role> {
        self.acting.map(|_| self.assigned.role)
    }

    /// Whether it was heard of lately, gets on, and does not rest from failures.
    pub(in crate::core) fn seems_well(&self) -> bool {
        !(self.suspected || self.record.rests())
    }

    /// Whether it can be given something: it is ready and seems well. One view is enough to find out whether one that
    /// failed works again.
    pub(in crate::core) fn answers(&self) -> bool {
        self.is_ready() && self.seems_well() && (!self.record.is_on_trial() || self.views.is_empty())
    }

    /// Whether it has the set that samples are rendered of.
    pub(in crate::core) fn knows_set(&self) -> bool {
        self.set_told.is_some_and(|told| self.report.applied >= told)
    }

    /// Whether it takes new samples and direct views: on the way to another role, only what both include.
    pub(in crate::core) fn takes_samples(&self) -> bool {
        let samples = self.acting.is_some_and(Role::samples) && self.assigned.role.samples();
        self.answers() && self.knows_set() && samples
    }

    /// Whether it takes new views to reconstruct.
    pub(in crate::core) fn takes_views(&self) -> bool {
        let composites = self.acting.is_some_and(Role::composites) && self.assigned.role.composites();
        self.answers() && self.knows_set() && composites
    }

    /// Tells it another role; what to send it. A role that gives nothing up counts at once.
    pub(super) fn assign(&mut self, role: Role) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.role = role;
        self.role_told = self.assigned.sequence;
        if let Some(acting) = self.acting
            && !role.gives_up_something_of(acting)
        {
            self.acting = Some(role);
        }
        self.assigned.clone()
    }

    /// Tells it to measure what views from samples cost and, while that is open, each way to see triangles; what to send it.
    pub(super) fn measure(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_ways = true;
        self.measure_told = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Whether it was ever told to measure.
    pub(super) fn has_been_told_to_measure(&self) -> bool {
        self.measure_told.is_some()
    }

    /// Whether it measures right now, so that views had better go elsewhere.
    pub(in crate::core) fn is_measuring(&self) -> bool {
        self.measure_told.is_some_and(|told| self.report.applied < told)
    }

    /// Tells it of which set samples are rendered; what to send it. It goes on with views from triangles, and takes
    /// others once it says that it has the set.
    pub(super) fn serve_set(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_ways = false;
        self.set_told = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Tells it what to have at hand, of which versions, and whom not to wait for; what to send it, if that is news.
    pub(super) fn assign_prefetch(
        &mut self,
        prefetch: Vec<Source>,
        kept_from: u64,
        suspected: &[String],
    ) -> Option<Assignment> {
        let told = &mut self.assigned;
        if told.prefetch == prefetch && told.kept_from == kept_from && told.suspected == suspected {
            return None;
        }
        told.sequence += 1;
        told.prefetch = prefetch;
        told.kept_from = kept_from;
        told.suspected = suspected.to_vec();
        Some(told.clone())
    }

    /// Takes a report in; `is_stuck` says whether it shows a worker that does not get on.
    pub(super) fn take_report(&mut self, report: Report, is_stuck: bool, now: Uptime) {
        if self.report.applied == 0 {
            // Joined again after a coordinator's restart: what it was busy with before is not this tick's.
            self.busy_at_tick_ms = report.sampling_busy_ms + report.compositing_busy_ms;
        }
        self.rhythm.reported(now.since(self.last_report));
        self.last_report = now;
        self.suspected = is_stuck;
        // A later assignment of the same role says so too.
        let acknowledged = report.applied >= self.role_told && self.acting != Some(self.assigned.role);
        if acknowledged {
            self.acting = Some(self.assigned.role);
        }
        self.report = report;
        // Later assignments do not repeat it.
        self.assigned.measure_ways &= self.is_measuring();
    }

    /// It has been silent for too long.
    pub(super) fn suspect(&mut self) {
        self.suspected = true;
    }

    /// Milliseconds it has been busy since its process started.
    fn busy_ms(&self) -> f64 {
        self.report.sampling_busy_ms + self.report.compositing_busy_ms
    }

    /// Milliseconds it has been busy since the current tick began.
    pub(super) fn busy_since_tick_ms(&self) -> f64 {
        self.busy_ms() - self.busy_at_tick_ms
    }

    /// A tick begins.
    pub(super) fn begin_tick(&mut self) {
        self.busy_at_tick_ms = self.busy_ms();
    }

    /// Milliseconds of rendering that are predicted of the views in its queue.
    pub(in crate::core) fn queued_ms(&self) -> f64 {
        self.views.values().map(|view| view.predicted_ms).sum()
    }

    /// A view was sent to it.
    pub(super) fn begin(&mut self, view_id: ViewId, view: QueuedView) {
        self.views.insert(view_id, view);
        self.dispatched += 1;
    }

    /// A view is no longer in its queue. Whether it was.
    pub(super) fn end(&mut self, view_id: ViewId) -> bool {
        self.views.remove(&view_id).is_some()
    }

    /// It answered a view.
    pub(super) fn answered(&mut self) {
        self.record.answered();
    }
}
