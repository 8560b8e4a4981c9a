//! Choice of the visibility backend, which all samples of a version share.
//!
//! If the configuration names no backend, one worker measures all of them on its device with this scene, once samples
//! are wanted. The cheapest becomes everyone's. Views from triangles do not wait: until then each worker uses the
//! backend that is expected to be best on its device.

use argus_scene::Visibility;

use super::{Worker, Workers};
use crate::core::event::{Action, Role};

/// Least share of a process that views from triangles must take, before views from samples are worth measuring.
const WORTH_MEASURING: f64 = 0.05;

/// Ticks of such demand before an idle worker measures, which takes seconds in partly long slices.
const STEADY_TICKS: f64 = 8.0;

/// Ticks of such demand before a busy worker measures, too. Views in its queue then wait.
const MOST_STEADY_TICKS: f64 = 16.0;

/// Share of all processes above which views from triangles leave no worker idle. Then a busy one measures, since only
/// views from samples may sustain the rate.
const BUSY: f64 = 0.75;

/// Ticks of demand above [`BUSY`] after which a busy worker measures: not while a service starts, when its first views
/// need all of its time, and costs include compiling.
const BUSY_TICKS: f64 = 5.0;

impl Workers {
    /// Whether the backend is chosen. Until then no samples are rendered.
    pub(in crate::core) fn visibility_is_settled(&self) -> bool {
        self.visibility_is_settled
    }

    /// Has one worker at a time measure: at once if samples are wanted and the backend is not chosen, else each
    /// worker once steady demand suggests that views from samples may pay.
    pub(in crate::core) fn seek_visibility(&mut self, samples_are_wanted: bool, actions: &mut Vec<Action>) {
        if self.workers.values().any(Worker::is_measuring) {
            return;
        }
        let must_settle = !self.visibility_is_settled && samples_are_wanted;
        let is_busy =
            self.steady_ticks >= BUSY_TICKS && self.direct_processes() > BUSY * self.members().count() as f64;
        let may_pay = is_busy || self.steady_ticks >= STEADY_TICKS;
        let is_wanted = |worker: &&mut Worker| {
            let unmeasured = worker.report().direct_cost.is_some() && worker.report().warp_cost.is_none();
            worker.answers() && (must_settle || (may_pay && unmeasured && !worker.was_asked_to_measure()))
        };
        let may_wait = !(must_settle || is_busy) && self.steady_ticks < MOST_STEADY_TICKS;
        // An idle worker delays no view, since new views go to other workers.
        let is_wanted = |worker: &&mut Worker| is_wanted(worker) && !(may_wait && worker.queued() > 0);
        let candidates = self.workers.values_mut().filter(is_wanted);
        if let Some(worker) = candidates.min_by_key(|w| (w.queued(), w.id())) {
            actions.push(Action::Assign { worker: worker.id(), assignment: worker.measure() });
        }
    }

    /// Counts consecutive ticks in which views from triangles took a considerable part of a process.
    pub(super) fn count_steady_ticks(&mut self, ticks: f64) {
        let is_much = self.direct_processes() > WORTH_MEASURING;
        self.steady_ticks = if is_much { self.steady_ticks + ticks } else { 0.0 };
    }

    /// Processes that are busy with views from triangles whose way was open.
    fn direct_processes(&self) -> f64 {
        let direct_secs = self.costs.direct_secs().unwrap_or(0.0);
        self.demand().direct_anywhere * direct_secs / self.config.tick.as_secs_f64()
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
