//! Outcomes of views: answered, retried, failed, expired and cancelled.

use std::time::Duration;

use argus_proto::Fault;

use super::pending::Pending;
use super::{Cluster, Output, Views};
use crate::core::event::{Action, Failure, ViewId};
use crate::core::time::Uptime;
use crate::core::workers::Worker;

/// A view may wait for so many times the usual while a worker measures how samples are rendered.
const PATIENCE_FOR_A_SET: u32 = 4;

/// Such a view is looked at again after this time.
const CHECK_AGAIN: Duration = Duration::from_secs(1);

impl Views {
    /// Handles an answered attempt.
    pub(in crate::core) fn answered(
        &mut self,
        (view_id, attempt): (ViewId, u32),
        Answer { uncovered, ms, fell_short }: Answer,
        cluster: Cluster<'_>,
    ) -> Vec<Output> {
        if !self.is_current(view_id, attempt) {
            return Vec::new();
        }
        if let Some(ms) = ms {
            self.learn_pace(view_id, ms, cluster);
        }
        let taken_back = self.take_back(view_id, true);
        let Some(view) = self.forget(view_id) else { return Vec::new() };
        self.counts.answered += 1;
        let mut outputs = Vec::new();
        if let Some(worker) = view.worker {
            outputs.push(Output::Answered { worker, direct: view.is_direct(), work: view.work() });
        }
        outputs.extend(taken_back);
        if let Some(ms) = ms.filter(|_| !fell_short) {
            self.market.learn_answer(&view, uncovered, ms * 1e-3);
        }
        if view.needs_samples() {
            outputs.extend(holes(&view, uncovered));
        }
        outputs
    }

    /// Handles a failed attempt.
    pub(in crate::core) fn failed(
        &mut self,
        (view_id, attempt): (ViewId, u32),
        failure: Failure,
        cluster: Cluster<'_>,
        now: Uptime,
    ) -> Vec<Output> {
        if !self.is_current(view_id, attempt) {
            return Vec::new();
        }
        let mut outputs = Vec::new();
        match failure {
            Failure::TryElsewhere => self.retry(view_id, cluster, now, &mut outputs),
            Failure::OfWorker => {
                let worker = self.views.get(&view_id).and_then(|view| view.worker);
                outputs.extend(worker.map(|worker| Output::Blamed { worker, view_id }));
                self.retry(view_id, cluster, now, &mut outputs);
            }
            Failure::Final => {
                outputs.extend(self.cancel(view_id));
                self.counts.failed += 1;
            }
        }
        outputs
    }

    /// Cancels a view.
    pub(in crate::core) fn cancel(&mut self, view_id: ViewId) -> Option<Output> {
        let taken_back = self.take_back(view_id, false);
        self.forget(view_id);
        taken_back
    }

    /// Retries views whose worker is lost.
    pub(in crate::core) fn retry_all(
        &mut self,
        view_ids: impl IntoIterator<Item = ViewId>,
        cluster: Cluster<'_>,
        now: Uptime,
    ) -> Vec<Output> {
        let mut outputs = Vec::new();
        view_ids.into_iter().for_each(|view_id| self.retry(view_id, cluster, now, &mut outputs));
        outputs
    }

    /// Retries the views of suspected workers.
    pub(in crate::core) fn leave_suspected(&mut self, cluster: Cluster<'_>, now: Uptime) -> Vec<Output> {
        let workers = cluster.workers;
        // A view stays if no other worker can have it, or if it was retried too often.
        let can =
            |w: &Worker, v: &Pending| w.answers() && (v.device.is_empty() || w.hello().device == v.device);
        let elsewhere = |v: &Pending| workers.iter().any(|w| can(w, v));
        let moves = |view_id: &ViewId| {
            self.views.get(view_id).is_some_and(|view| self.may_be_retried(view) && elsewhere(view))
        };
        let suspected = workers.iter().filter(|w| w.is_suspected());
        let views: Vec<ViewId> = suspected.flat_map(|w| w.views().keys().copied()).filter(moves).collect();
        self.retry_all(views, cluster, now)
    }

    /// Handles deadlines and patience that have ended.
    pub(in crate::core) fn expire(&mut self, cluster: Cluster<'_>, now: Uptime) -> Vec<Output> {
        let mut outputs = Vec::new();
        while let Some(&(due, view_id)) = self.due.first().filter(|(due, _)| now >= *due) {
            self.due.remove(&(due, view_id));
            self.expire_one(view_id, cluster, now, &mut outputs);
        }
        outputs
    }

    /// Whether one attempt would be left after another one.
    fn may_be_retried(&self, view: &Pending) -> bool {
        view.attempts() + 1 < self.config.max_attempts
    }

    /// Queues a view again by its age, or refuses it after too many attempts.
    fn retry(&mut self, view_id: ViewId, cluster: Cluster<'_>, now: Uptime, outputs: &mut Vec<Output>) {
        outputs.extend(self.take_back(view_id, false));
        let Some(view) = self.views.get_mut(&view_id) else { return };
        view.worker = None;
        if now >= view.deadline.0 {
            return self.expire_one(view_id, cluster, now, outputs);
        }
        if view.attempts() >= self.config.max_attempts {
            let fault = Fault::Unavailable(format!("{} workers failed at this view", view.attempts()));
            return self.refuse(view_id, fault, outputs);
        }
        self.counts.retried += 1;
        self.wait(view_id);
    }

    fn expire_one(&mut self, view_id: ViewId, cluster: Cluster<'_>, now: Uptime, outputs: &mut Vec<Output>) {
        let Some(view) = self.views.get_mut(&view_id) else { return };
        let (at, asked_for) = view.deadline;
        if now >= at {
            self.refuse(view_id, Fault::Deadline(asked_for), outputs);
        } else if view.worker.is_none() && now.since(view.requested) >= self.config.patience {
            // On a busy machine, measuring how samples are best rendered may take longer than a worker's other work.
            let awaits_set = view.needs_samples() && cluster.workers.set_is_on_its_way();
            if awaits_set && now.since(view.requested) < self.config.patience * PATIENCE_FOR_A_SET {
                view.due = at.min(now.after(CHECK_AGAIN));
                self.due.insert((view.due, view_id));
                return;
            }
            let secs = now.since(view.requested).as_secs_f64();
            let ready = cluster.workers.queues().ready();
            let why = match awaits_set {
                true => format!(
                    "{ready} ready workers are still measuring how to render samples, after {secs:.0} s"
                ),
                false => format!("none of {ready} ready workers had room within {secs:.0} s"),
            };
            self.refuse(view_id, Fault::Unavailable(why), outputs);
        } else {
            // In work: only the deadline remains.
            view.due = at;
            self.due.insert((at, view_id));
        }
    }

    fn refuse(&mut self, view_id: ViewId, fault: Fault, outputs: &mut Vec<Output>) {
        outputs.extend(self.cancel(view_id));
        self.counts.failed += 1;
        outputs.push(Output::Act(Action::Refuse { view_id, fault }));
    }

    /// Removes an ended view.
    fn forget(&mut self, view_id: ViewId) -> Option<Pending> {
        let view = self.views.remove(&view_id)?;
        self.admission.leave(&view.client);
        self.in_flight.subtract(&view);
        self.due.remove(&(view.due, view_id));
        self.waiting.remove(view_id);
        Some(view)
    }

    /// Whether an attempt is the current one of a view.
    pub(super) fn is_current(&self, view_id: ViewId, attempt: u32) -> bool {
        self.views.get(&view_id).is_some_and(|view| view.attempt == attempt && view.worker.is_some())
    }

    /// Removes a view from its worker's queue.
    pub(super) fn take_back(&self, view_id: ViewId, answered: bool) -> Option<Output> {
        let view = self.views.get(&view_id)?;
        let samples = view.faces();
        Some(Output::TakenBack { worker: view.worker?, view_id, samples, answered })
    }
}

/// What the client's frame of an attempt was like.
#[derive(Debug, Clone, Copy)]
pub(in crate::core) struct Answer {
    /// Number of pixels that none of the plan's samples saw; `None` if unknown.
    pub(in crate::core) uncovered: Option<u64>,
    /// Milliseconds of rendering; `None` if they were judged before.
    pub(in crate::core) ms: Option<f64>,
    /// Whether the worker rendered it from triangles, since the frame by its plan was not good enough.
    pub(in crate::core) fell_short: bool,
}

/// The holes of a frame. Pinned plans are not counted, since their samples were not chosen here.
fn holes(view: &Pending, uncovered: Option<u64>) -> Option<Output> {
    if view.is_direct() || view.pinned {
        return None;
    }
    let uncovered = uncovered?.min(view.pixels);
    Some(Output::Holes { camera: view.camera, used: view.cameras(), uncovered, pixels: view.pixels })
}
