//! Choice of the visibility backend, which all samples of a version share.
//!
//! If the configuration names no backend, one worker measures all of them on its device with this scene, once samples
//! are wanted. The cheapest becomes everyone's. Views from triangles do not wait: until then each worker uses the
//! backend that is expected to be best on its device.

use argus_scene::Visibility;

use super::{Worker, Workers};
use crate::core::event::{Action, Role};

/// Ticks after which a worker whose cost of views from samples is not known measures it, if it is idle: not while a service
/// starts, when its first views need all of its time.
const IDLE_TICKS: f64 = 1.0;

/// Ticks after which it measures, even if it is busy: a decision may need the cost. It does so in slices, and while views lack time it
/// leaves them to the other workers.
const BUSY_TICKS: f64 = 2.0;

impl Workers {
    /// Whether the backend is chosen. Until then no samples are rendered.
    pub(in crate::core) fn visibility_is_settled(&self) -> bool {
        self.visibility_is_settled
    }

    /// Has one worker at a time measure: at once if samples are wanted and the backend is not chosen, else each worker soon
    /// after it is ready, before any decision needs the cost of views from samples.
    pub(in crate::core) fn seek_visibility(&mut self, samples_are_wanted: bool, actions: &mut Vec<Action>) {
        if self.workers.values().any(Worker::is_measuring) {
            return;
        }
        let must_settle = !self.visibility_is_settled && samples_are_wanted;
        let ticks = self.unmeasured_ticks;
        let is_due = |worker: &Worker| match worker.queued() {
            0 => ticks >= IDLE_TICKS,
            _ => ticks >= BUSY_TICKS,
        };
        let is_wanted = |worker: &&mut Worker| {
            worker.answers() && (must_settle || (worker.is_unmeasured() && is_due(worker)))
        };
        let candidates = self.workers.values_mut().filter(is_wanted);
        if let Some(worker) = candidates.min_by_key(|w| (w.queued(), w.id())) {
            actions.push(Action::Assign { worker: worker.id(), assignment: worker.measure() });
        }
    }

    /// Counts consecutive ticks in which the cost of views from samples was not known of some worker.
    pub(super) fn count_unmeasured_ticks(&mut self, ticks: f64) {
        let is_unmeasured = self.members().any(Worker::is_unmeasured);
        self.unmeasured_ticks = if is_unmeasured { self.unmeasured_ticks + ticks } else { 0.0 };
    }

    /// Whether samplers have not got the sample set yet. Until then compositors would have to render samples.
    pub(in crate::core) fn set_is_on_its_way(&self) -> bool {
        let samples = |w: &&Worker| w.role().is_some_and(Role::samples) && w.seems_well();
        !self.visibility_is_settled || self.members().filter(samples).any(|worker| !worker.knows_set())
    }

    /// Chooses the cheapest of a worker's measured backends, and returns it; `None` if there is nothing to choose.
    pub(in crate::core) fn settle_visibility(
        &mut self,
        measured: &[(Visibility, f64)],
        actions: &mut Vec<Action>,
    ) -> Option<Visibility> {
        if self.visibility_is_settled {
            return None;
        }
        let measured = measured.iter().filter(|(_, ms)| ms.is_finite());
        let &(visibility, _) = measured.min_by(|a, b| a.1.total_cmp(&b.1))?;
        self.visibility_is_settled = true;
        for worker in self.workers.values_mut() {
            actions.push(Action::Assign { worker: worker.id(), assignment: worker.serve_set() });
            self.queues.update(worker.queue_membership());
        }
        Some(visibility)
    }
}
