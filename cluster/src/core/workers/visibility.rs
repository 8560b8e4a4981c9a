//! How triangles are seen: alike in all samples of a version, so it is settled before the first one is rendered.
//!
//! Where nobody said which visibility backend to take, one worker measures what each costs on its device with this scene,
//! and the cheapest is everybody's from then on. It is measured when samples are first wanted. Views from triangles do not
//! wait for it: until then each worker sees triangles by the backend that is expected to be best on its device.

use argus_scene::Visibility;

use super::{Worker, Workers};
use crate::core::event::{Action, Role};

/// Share of a process that views from triangles must take before views from samples are worth measuring.
const WORTH_MEASURING: f64 = 0.05;

/// Ticks for which they must do so before an idle worker measures: that takes seconds, in slices of which some are long.
const STEADY_TICKS: f64 = 8.0;

/// Ticks after which a busy worker measures, too, if none was idle meanwhile: views in its queue then wait.
const MOST_STEADY_TICKS: f64 = 16.0;

/// Share of all processes beyond which views from triangles leave no worker idle: a busy one measures, since views from
/// samples may be all that keeps the rate.
const BUSY: f64 = 0.75;

/// Ticks after which a busy worker measures where demand is beyond [`BUSY`]: not while a service starts, when its first views
/// need all of its time and costs are still those of compiling.
const BUSY_TICKS: f64 = 5.0;

impl Workers {
    /// Whether it is settled how triangles are seen: until then no samples are rendered.
    pub(in crate::core) fn visibility_is_settled(&self) -> bool {
        self.visibility_is_settled
    }

    /// Has some worker measure, one at a time: as soon as samples are wanted and it is open how triangles are seen, and each
    /// of them once steady demand says that views from samples may be worth their price.
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
            worker.answers() && (must_settle || (may_pay && unmeasured && !worker.has_been_told_to_measure()))
        };
        let may_wait = !(must_settle || is_busy) && self.steady_ticks < MOST_STEADY_TICKS;
        // An idle worker keeps no view waiting: further ones go to others.
        let is_wanted = |worker: &&mut Worker| is_wanted(worker) && !(may_wait && worker.queued() > 0);
        let candidates = self.workers.values_mut().filter(is_wanted);
        if let Some(worker) = candidates.min_by_key(|w| (w.queued(), w.id())) {
            actions.push(Action::Assign { worker: worker.id(), assignment: worker.measure() });
        }
    }

    /// Ticks have passed: counts those for which views from triangles have taken a good part of a process.
    pub(super) fn count_steady_ticks(&mut self, ticks: f64) {
        let is_much = self.direct_processes() > WORTH_MEASURING;
        self.steady_ticks = if is_much { self.steady_ticks + ticks } else { 0.0 };
    }

    /// How many processes views from triangles whose way was open keep busy.
    fn direct_processes(&self) -> f64 {
        let direct_secs = self.costs.direct_secs().unwrap_or(0.0);
        self.demand().direct_anywhere * direct_secs / self.config.tick.as_secs_f64()
    }

    /// Whether those who render samples have yet to hear of which set: until then compositors would render them.
    pub(in crate::core) fn set_is_on_its_way(&self) -> bool {
        let samples = |w: &&Worker| w.role().is_some_and(Role::samples) && w.seems_well();
        !self.visibility_is_settled || self.members().filter(samples).any(|worker| !worker.knows_set())
    }

    /// A worker measured: the cheapest backend is the one that all take. Which, if that settles it.
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
