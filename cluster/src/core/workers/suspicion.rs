//! Suspicion: workers that are silent (`silence`), stuck at a piece of work, or failing (`record`) get no new views
//! while other workers can have them.
//!
//! A suspected worker keeps its role and its samples: all three states may pass, and a wrong suspicion costs only the
//! time of a view.

use std::time::Duration;

use super::silence::PAUSE;
use super::{Worker, Workers};
use crate::core::event::{Report, ViewId, WorkerId};
use crate::core::time::Uptime;

/// A piece of work may take this many times its expected time: costs are means, and the machine may be busy.
const PATIENCE: f64 = 10.0;

impl Workers {
    /// Suspects silent workers, and ends pauses of failing ones.
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
        // More than one interval between reports, and two of them.
        let (on_time, two) = (soon / 2, soon * 2 / 3);
        self.awake.tick(on_time.max(PAUSE), now);
        // Workers that were late themselves prove nothing about others: several may have been held up together.
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

    /// Workers whose lease has ended.
    pub(in crate::core) fn silent(&self, now: Uptime) -> Vec<WorkerId> {
        let silent = |w: &&Worker| now.since(w.last_report()) >= self.config.lease;
        self.workers.values().filter(silent).map(Worker::id).collect()
    }

    /// Whether a reporting worker is stuck: its render thread has been at one piece of work for far longer than
    /// expected, and another worker can have its views. `largest_view` gives the pixels of the largest view in
    /// flight, with sub-pixels.
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

    /// Longest plausible time of one piece of a worker's work: at most all of its views are one batch, and larger
    /// views take longer.
    fn longest_piece(&self, worker: &Worker, largest_view: u64) -> Duration {
        let costs = &self.costs;
        let (sample, view) = (costs.sample_secs().or(costs.direct_secs()), costs.view_secs());
        let views: f64 = worker.views().values().map(|view| costs.expected_secs(view)).sum();
        // Samplers also trace the holes of other workers' views.
        let rays = costs.ray_secs().unwrap_or(0.0) * largest_view as f64;
        let samples = sample.unwrap_or(0.0) * self.samples_per_batch as f64;
        let expected = Duration::try_from_secs_f64(PATIENCE * (views + rays + samples));
        let unmeasured =
            sample.is_none() || (view.is_none() && worker.role().is_some_and(|role| role.composites()));
        let least = if unmeasured { self.config.first_of_its_kind } else { Duration::ZERO };
        expected.unwrap_or(Duration::MAX).max(self.config.stuck_after).max(least)
    }

    /// Records that a worker failed at a view, and is at fault.
    pub(in crate::core) fn blame(&mut self, id: WorkerId, view_id: ViewId, now: Uptime) {
        let is_paused = self.change(id, |worker| {
            worker.record.failed(view_id, now);
            worker.record.is_paused()
        });
        self.changed |= is_paused == Some(true);
    }
}
