//! How triangles are seen: alike in all samples of a generation, so it is settled before the first one is rendered.
//!
//! Where nobody said which visibility backend to take, one worker measures what each costs on its device with this scene,
//! and the cheapest is everybody's from then on. It is measured when samples are first wanted. Views from triangles do not
//! wait for it: until then each worker sees triangles by the backend that is expected to be best on its device.

use std::sync::Arc;

use argus_scene::{SampleSetInfo, Visibility};

use super::event::Action;
use super::machine::Core;

impl Core {
    /// Has some worker measure, if samples are wanted and nobody is at it.
    pub(super) fn seek_way(&mut self, actions: &mut Vec<Action>) {
        let is_wanted = !self.waiting.composed.is_empty() || self.placement.placed().next().is_some();
        let is_measured = || self.workers.values().any(|w| w.assigned().measure_ways);
        if self.way_is_settled || !is_wanted || is_measured() {
            return;
        }
        // Whoever is idle keeps fewest waiting.
        let ready = self.workers.values_mut().filter(|w| w.answers());
        if let Some(worker) = ready.min_by_key(|w| (w.views.len(), w.id)) {
            actions.push(Action::Assign { worker: worker.id, assignment: worker.measure_ways() });
        }
    }

    /// A worker measured: the cheapest way is the one that all take.
    pub(super) fn settle_way(&mut self, ways: &[(Visibility, f64)], actions: &mut Vec<Action>) {
        if self.way_is_settled {
            return;
        }
        let measured = ways.iter().filter(|(_, ms)| ms.is_finite());
        let Some(&(visibility, _)) = measured.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
        self.way_is_settled = true;
        self.set = Arc::new(SampleSetInfo { visibility, ..(*self.set).clone() });
        for worker in self.workers.values_mut() {
            actions.push(Action::Assign { worker: worker.id, assignment: worker.serve_set() });
            self.lines.update(worker);
        }
    }
}
