//! How triangles are seen: alike in all samples of a generation, so it is settled before the first one is rendered.
//!
//! Where nobody said which way, one worker measures what each costs on its device with this scene, and the cheapest is
//! everybody's from then on. Until then workers get ready, and none counts as such.

use std::sync::Arc;

use argus_scene::{SampleSetInfo, Visibility};

use super::event::Action;
use super::machine::Core;

impl Core {
    /// Has some worker measure, if that is to be done and nobody is at it.
    pub(super) fn seek_way(&mut self, actions: &mut Vec<Action>) {
        if self.way_is_settled || self.workers.values().any(|w| w.assigned().measure_ways) {
            return;
        }
        if let Some(worker) = self.workers.values_mut().next() {
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
            actions.push(Action::Assign { worker: worker.id, assignment: worker.serve_another_set() });
            self.lines.update(worker);
        }
    }
}
