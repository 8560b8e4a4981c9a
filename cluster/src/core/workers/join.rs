//! Joining, reports and loss of workers.

use super::{WorkKind, Worker, Workers};
use crate::core::event::{Action, Hello, Report, WorkerId};
use crate::core::time::Uptime;

impl Workers {
    /// The worker with this name. A worker that joins with the same name replaces it.
    pub(in crate::core) fn named(&self, name: &str) -> Option<WorkerId> {
        self.workers.values().find(|w| w.hello().name == name).map(Worker::id)
    }

    /// Adds a worker, and assigns its role.
    pub(in crate::core) fn join(
        &mut self,
        id: WorkerId,
        hello: Hello,
        now: Uptime,
        actions: &mut Vec<Action>,
    ) {
        self.counts.joined += 1;
        let worker = Worker::new(id, hello, self.role_of_newcomer(), self.visibility_is_settled, now);
        actions.push(Action::Assign { worker: id, assignment: worker.assigned().clone() });
        self.queues.update(worker.queue_membership());
        self.workers.insert(id, worker);
        self.changed = true;
    }

    /// Processes a worker's report. `largest_view` gives the pixels of the largest view in flight, with sub-pixels.
    /// Returns whether the worker's readiness changed.
    pub(in crate::core) fn report(
        &mut self,
        id: WorkerId,
        report: Report,
        now: Uptime,
        largest_view: impl FnOnce() -> u64,
    ) -> bool {
        let Some(worker) = self.workers.get(&id) else { return false };
        let is_stuck = self.is_stuck(worker, &report, largest_view);
        let before = worker.report();
        self.costs.learn(&report, before);
        // Demand for rays is known only once they are traced.
        if before.applied > 0 {
            self.rates.count(WorkKind::Rays, report.rays_traced.saturating_sub(before.rays_traced));
        }
        let state = |w: &Worker| (w.is_suspected(), w.takes_views(), w.takes_samples(), w.holds_cells());
        let (was_ready, was) = (worker.is_ready(), state(worker));
        let (is_ready, is) = self
            .change(id, |worker| {
                worker.take_report(report, is_stuck, now);
                (worker.is_ready(), state(worker))
            })
            .unwrap_or((was_ready, was));
        self.changed |= is != was;
        is_ready != was_ready
    }

    /// Removes a lost worker and returns it; `None` if it was lost already.
    pub(in crate::core) fn lose(&mut self, id: WorkerId) -> Option<Worker> {
        let worker = self.workers.remove(&id)?;
        self.queues.remove(id);
        self.changed = true;
        if !worker.report().leaving {
            self.counts.lost += 1;
        }
        Some(worker)
    }
}
