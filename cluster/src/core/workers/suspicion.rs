//! Workers that nothing new is given while others can have it: those that are silent (`silence`), that do not get on, or
//! that fail at all that they are given (`record`).
//!
//! A worker keeps its role and its samples throughout: all three pass, and being wrong costs the time of a view.

use std::time::Duration;

use super::silence::PAUSE;
use super::{Worker, Workers};
use crate::core::event::{Report, ViewId, WorkerId};
use crate::core::time::Uptime;

/// Of a piece of work's expected time, what it may take: costs are means, and a machine may be busy with something else.
const PATIENCE: f64 = 10.0;

impl Workers {
    /// Suspects workers that have been silent for too long. Ends the rests that are over.
    pub(in crate::core) fn notice(&mut self, now: Uptime) {
        self.notice_silence(now);
        for worker in self.workers.values_mut() {
            if worker.record.wakes(now) {
                self.queues.update(worker.queue_membership());
                self.changed = true;
            }
        }
    }

    /// Suspects workers that have been silent for a part of their lease.
    fn notice_silence(&mut self, now: Uptime) {
        let (soon, late) = (self.config.doubted_after(), self.config.suspected_after());
        // Longer than from one report to the next, and as long as two of these.
        let (on_time, two) = (soon / 2, soon * 2 / 3);
        self.awake.tick(on_time.max(PAUSE), now);
        // Whoever has just been late itself says nothing about others: more than one of them was held up.
        let punctual =
            |w: &Worker| w.answers() && w.rhythm.is_steady(two) && now.since(w.last_report()) < on_time;
        let others_are_heard = self.workers.values().any(punctual);
        for worker in self.workers.values_mut().filter(|worker| !worker.is_suspected()) {
            let alone = worker.rhythm.patience(soon, late);
            let patience = if others_are_heard { alone } else { late };
            if self.awake.silence(worker.last_report(), now) >= patience {
                worker.suspect();
                self.queues.update(worker.queue_membership());
                self.changed = true;
            }
        }
    }

    /// Workers whose lease is over.
    pub(in crate::core) fn silent(&self, now: Uptime) -> Vec<WorkerId> {
        let silent = |w: &&Worker| now.since(w.last_report()) >= self.config.lease;
        self.workers.values().filter(silent).map(Worker::id).collect()
    }

    /// Whether a worker that goes on reporting is stuck: its render thread has been at one piece of work for far longer
    /// than that takes, and another worker can have its views. `largest_view` gives the pixels of the largest view in
    /// flight, sub-pixels counted.
    pub(super) fn is_stuck(
        &self,
        worker: &Worker,
        report: &Report,
        largest_view: impl FnOnce() -> u64,
    ) -> bool {
        let piece = Duration::try_from_secs_f64(report.piece_ms * 1e-3).unwrap_or_default();
        piece >= self.config.stuck_after
            && self.workers.values().any(|other| other.id() != worker.id() && other.answers())
            && piece >= self.longest_piece(worker, largest_view())
    }

    /// How long a worker's thread may be at one piece of work: all of its views are one batch at the most, and larger views
    /// than are usual take longer.
    fn longest_piece(&self, worker: &Worker, largest_view: u64) -> Duration {
        let costs = &self.costs;
        let (sample, view) = (costs.sample_secs().or(costs.direct_secs()), costs.view_secs());
        let views: f64 = worker.views().values().map(|view| costs.expected_secs(view)).sum();
        // Whoever samples also traces what others have no samples of.
        let rays = costs.ray_secs().unwrap_or(0.0) * largest_view as f64;
        let samples = sample.unwrap_or(0.0) * self.samples_per_batch as f64;
        let expected = Duration::try_from_secs_f64(PATIENCE * (views + rays + samples));
        let unmeasured =
            sample.is_none() || (view.is_none() && worker.role().is_some_and(|role| role.composites()));
        let least = if unmeasured { self.config.first_of_its_kind } else { Duration::ZERO };
        expected.unwrap_or(Duration::MAX).max(self.config.stuck_after).max(least)
    }

    /// A worker failed at a view by its own fault.
    pub(in crate::core) fn blame(&mut self, id: WorkerId, view_id: ViewId, now: Uptime) {
        let rests = self.change(id, |worker| {
            worker.record.failed(view_id, now);
            worker.record.rests()
        });
        self.changed |= rests == Some(true);
    }
}
