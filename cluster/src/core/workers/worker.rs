//! The core's state of one worker.

use std::collections::BTreeMap;

use super::queues::{QueueEntry, QueueMembership};
use super::record::Record;
use super::silence::Rhythm;
use crate::core::event::{Assignment, Hello, Purchase, Report, Role, Source, ViewId, WorkerId};
use crate::core::time::Uptime;

/// Most of a view in work that counts as done, as long as it is not answered.
const MOST_DONE: f64 = 0.9;

/// A view in a worker's queue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::core) struct QueuedView {
    /// Predicted milliseconds of rendering.
    pub(in crate::core) predicted_ms: f64,
    /// Whether it is rendered from triangles.
    pub(in crate::core) direct: bool,
    /// Pixels to render, with sub-pixels.
    pub(in crate::core) work: u64,
}

/// Samples that workers prefetch, ahead of demand.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct PrefetchLists {
    /// The list of each worker that gets one.
    pub(in crate::core) lists: BTreeMap<WorkerId, Vec<Source>>,
    /// Samples of versions below this number can be dropped.
    pub(in crate::core) kept_from: u64,
    /// Addresses of suspected workers, for which no fetch waits.
    pub(in crate::core) suspected: Vec<String>,
}

/// A worker that joined and was not lost.
#[derive(Debug, Clone)]
pub(in crate::core) struct Worker {
    id: WorkerId,
    hello: Hello,
    last_report: Uptime,
    /// The regularity of its reports.
    pub(super) rhythm: Rhythm,
    /// The newest report; a default one before the first.
    report: Report,
    /// The role in effect; the assigned one once it is acknowledged. `None` until the first role is.
    acting: Option<Role>,
    /// The newest assignment.
    assigned: Assignment,
    /// Number of the first assignment with its present role.
    role_sequence: u64,
    /// Number of the first assignment with the sample set; `None` before it.
    set_sequence: Option<u64>,
    /// Number of the assignment that asked for measurements; `None` before it.
    measure_sequence: Option<u64>,
    /// Unanswered views.
    views: BTreeMap<ViewId, QueuedView>,
    /// When it began with the oldest of these.
    works_since: Uptime,
    /// Number of views that it ever got, which orders equal workers.
    dispatched: u64,
    /// Busy milliseconds at the start of the current tick.
    busy_at_tick_ms: f64,
    /// Whether it is silent or stuck.
    suspected: bool,
    /// Its failures at views.
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
                purchases: Vec::new(),
                kept_from: 0,
                measure_backends: false,
                suspected: Vec::new(),
                cell_holders: Vec::new(),
            },
            role_sequence: 1,
            set_sequence: knows_set.then_some(1),
            measure_sequence: None,
            views: BTreeMap::new(),
            works_since: Uptime::default(),
            dispatched: 0,
            busy_at_tick_ms: 0.0,
            suspected: false,
            record: Record::default(),
        }
    }

    /// Its id.
    pub(in crate::core) fn id(&self) -> WorkerId {
        self.id
    }

    /// Its introduction.
    pub(in crate::core) fn hello(&self) -> &Hello {
        &self.hello
    }

    /// The newest report; a default one before the first.
    pub(in crate::core) fn report(&self) -> &Report {
        &self.report
    }

    /// The time of the newest report.
    pub(super) fn last_report(&self) -> Uptime {
        self.last_report
    }

    /// Number of views in its queue.
    pub(in crate::core) fn queued(&self) -> usize {
        self.views.len()
    }

    /// Views in its queue.
    pub(in crate::core) fn views(&self) -> &BTreeMap<ViewId, QueuedView> {
        &self.views
    }

    /// Its place in the order of workers.
    pub(in crate::core) fn queue_entry(&self) -> QueueEntry {
        QueueEntry { queued: self.views.len(), dispatched: self.dispatched, worker: self.id }
    }

    /// The queues that it belongs in.
    pub(super) fn queue_membership(&self) -> QueueMembership {
        QueueMembership {
            entry: self.queue_entry(),
            ready: self.is_ready(),
            answers: self.answers(),
            composites: self.takes_views(),
            samples: self.takes_samples(),
        }
    }

    /// Whether it is silent or stuck.
    pub(in crate::core) fn is_suspected(&self) -> bool {
        self.suspected
    }

    /// Whether it has the scene and a role, and is not leaving.
    pub(in crate::core) fn is_ready(&self) -> bool {
        self.acting.is_some() && !self.report.leaving
    }

    /// The newest assignment.
    pub(in crate::core) fn assigned(&self) -> &Assignment {
        &self.assigned
    }

    /// Whether it has not taken the assigned role yet.
    pub(in crate::core) fn is_changing(&self) -> bool {
        self.acting.is_some_and(|acting| acting != self.assigned.role)
    }

    /// The assigned role; `None` while it starts.
    pub(in crate::core) fn role(&self) -> Option<Role> {
        self.acting.map(|_| self.assigned.role)
    }

    /// Whether it is neither suspected nor paused.
    pub(in crate::core) fn seems_well(&self) -> bool {
        !(self.suspected || self.record.is_paused())
    }

    /// Whether it can get a view: it is ready, and neither suspected nor paused. After a pause, one view at a time
    /// shows whether it works again.
    pub(in crate::core) fn answers(&self) -> bool {
        self.is_ready() && self.seems_well() && (!self.record.is_on_trial() || self.views.is_empty())
    }

    /// Whether it has the sample set.
    pub(in crate::core) fn knows_set(&self) -> bool {
        self.set_sequence.is_some_and(|sequence| self.report.applied >= sequence)
    }

    /// Whether it takes new samples and direct views. During a change of roles, both roles must include them.
    pub(in crate::core) fn takes_samples(&self) -> bool {
        let samples = self.acting.is_some_and(Role::samples) && self.assigned.role.samples();
        self.answers() && self.knows_set() && samples
    }

    /// Whether it takes new views to reconstruct.
    pub(in crate::core) fn takes_views(&self) -> bool {
        let composites = self.acting.is_some_and(Role::composites) && self.assigned.role.composites();
        self.answers() && self.knows_set() && composites
    }

    /// Assigns another role. A role that gives nothing up takes effect at once.
    pub(super) fn assign(&mut self, role: Role) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.role = role;
        self.role_sequence = self.assigned.sequence;
        if let Some(acting) = self.acting
            && !role.gives_up_something_of(acting)
        {
            self.acting = Some(role);
        }
        self.assigned.clone()
    }

    /// Makes the assignment to measure the cost of views from samples and, until the backend is chosen, of each
    /// visibility backend.
    pub(super) fn measure(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_backends = true;
        self.measure_sequence = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Whether the cost of its views from samples is not known, and it was not asked for it.
    pub(super) fn is_unmeasured(&self) -> bool {
        let unmeasured = self.report.direct_cost.is_some() && self.report.warp_cost.is_none();
        unmeasured && self.measure_sequence.is_none()
    }

    /// Whether it is measuring, which delays views.
    pub(in crate::core) fn is_measuring(&self) -> bool {
        self.measure_sequence.is_some_and(|sequence| self.report.applied < sequence)
    }

    /// Makes the assignment with the sample set. The worker renders views from triangles meanwhile, and takes other
    /// work once it acknowledges the set.
    pub(super) fn serve_set(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_backends = false;
        self.set_sequence = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Whether it holds light cells, which other workers may take over.
    pub(super) fn holds_cells(&self) -> bool {
        self.report.light_cells.is_some_and(|cells| cells.pages > 0)
    }

    /// Makes the assignment with a prefetch list, the oldest useful version, the suspected workers and the holders of light cells;
    /// `None` if nothing changed.
    pub(super) fn assign_prefetch(
        &mut self,
        prefetch: Vec<Source>,
        kept_from: u64,
        suspected: &[String],
        cell_holders: &[String],
    ) -> Option<Assignment> {
        let mut assigned = Assignment {
            prefetch,
            kept_from,
            suspected: suspected.to_vec(),
            cell_holders: cell_holders.iter().filter(|at| **at != self.hello.address).cloned().collect(),
            ..self.assigned.clone()
        };
        if assigned == self.assigned {
            return None;
        }
        assigned.sequence += 1;
        self.assigned = assigned;
        Some(self.assigned.clone())
    }

    /// Makes the assignment with the sources that it shall render.
    pub(super) fn assign_purchases(&mut self, purchases: Vec<Purchase>) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.purchases = purchases;
        self.assigned.clone()
    }

    /// Processes a report. `is_stuck` tells whether it shows a stuck worker.
    pub(super) fn take_report(&mut self, report: Report, is_stuck: bool, now: Uptime) {
        if self.report.applied == 0 {
            // It joined again after a restart of the coordinator: earlier busy time is not of this tick.
            self.busy_at_tick_ms = report.sampling_busy_ms + report.compositing_busy_ms;
        }
        self.rhythm.reported(now.since(self.last_report));
        self.last_report = now;
        self.suspected = is_stuck;
        // A later assignment with the same role acknowledges it, too.
        let acknowledged = report.applied >= self.role_sequence && self.acting != Some(self.assigned.role);
        if acknowledged {
            self.acting = Some(self.assigned.role);
        }
        self.report = report;
        // Later assignments do not repeat the request.
        self.assigned.measure_backends &= self.is_measuring();
    }

    /// Suspects it.
    pub(super) fn suspect(&mut self) {
        self.suspected = true;
    }

    /// Busy milliseconds since its process started.
    fn busy_ms(&self) -> f64 {
        self.report.sampling_busy_ms + self.report.compositing_busy_ms
    }

    /// Busy milliseconds since the current tick began.
    pub(super) fn busy_since_tick_ms(&self) -> f64 {
        self.busy_ms() - self.busy_at_tick_ms
    }

    /// Begins a tick.
    pub(super) fn begin_tick(&mut self) {
        self.busy_at_tick_ms = self.busy_ms();
    }

    /// Predicted milliseconds until the views in its queue are done. The oldest is in work since it came, or since the one before
    /// it was done.
    pub(in crate::core) fn queued_ms(&self, now: Uptime) -> f64 {
        let all: f64 = self.views.values().map(|view| view.predicted_ms).sum();
        let oldest_ms = self.views.values().next().map_or(0.0, |view| view.predicted_ms);
        let done_ms = now.since(self.works_since).as_secs_f64() * 1e3;
        // One that takes longer than predicted is not done yet.
        all - done_ms.min(MOST_DONE * oldest_ms)
    }

    /// Adds a view to its queue.
    pub(super) fn begin(&mut self, view_id: ViewId, view: QueuedView, now: Uptime) {
        if self.views.is_empty() {
            self.works_since = now;
        }
        self.views.insert(view_id, view);
        self.dispatched += 1;
    }

    /// Removes a view from its queue; whether it was there.
    pub(super) fn end(&mut self, view_id: ViewId, now: Uptime) -> bool {
        let was_there = self.views.remove(&view_id).is_some();
        if was_there {
            self.works_since = now;
        }
        was_there
    }

    /// Records that it answered a view.
    pub(super) fn answered(&mut self) {
        self.record.answered();
    }
}
