//! Distribution trees: how a sample reaches compositors without one worker sending it to all.
//!
//! Workers are ordered by when they were assigned a sample. The first [`FAN_OUT`] fetch it from a holder, each
//! other one from an earlier worker: its *parent*, which passes on what it has or will have. A parent always precedes
//! its children, and no worker changes places while a sample lasts, so there are no cycles. If one transfer takes
//! time t, a thousand workers have the sample after FAN_OUT · log_FAN_OUT(1000) · t, which is least near e: 19 t at
//! three, where one sender takes 1000 t.

use std::collections::HashMap;

use argus_scene::SampleId;

use crate::core::event::WorkerId;

/// Most children of a worker.
pub(super) const FAN_OUT: usize = 3;

/// The order in which workers were assigned one sample.
#[derive(Debug, Clone, Default)]
pub(super) struct DistributionTree {
    /// The workers in order; `None` for a lost one.
    order: Vec<Option<WorkerId>>,
    places: HashMap<WorkerId, usize>,
}

impl DistributionTree {
    /// The parent of a worker, which is appended to the tree if it is not in it. `None`: it fetches from a holder.
    pub(super) fn parent(&mut self, worker: WorkerId) -> Option<WorkerId> {
        let order = &mut self.order;
        let place = *self.places.entry(worker).or_insert_with(|| {
            order.push(Some(worker));
            order.len() - 1
        });
        let above = |place: usize| (place / FAN_OUT).checked_sub(1);
        let mut at = above(place);
        while let Some(place) = at {
            if let Some(parent) = self.order[place] {
                return Some(parent);
            }
            at = above(place);
        }
        None
    }

    fn forget(&mut self, worker: WorkerId) {
        if let Some(place) = self.places.remove(&worker) {
            self.order[place] = None;
        }
    }
}

/// The trees of all samples in distribution.
#[derive(Debug, Clone, Default)]
pub(super) struct DistributionTrees {
    trees: HashMap<SampleId, DistributionTree>,
}

impl DistributionTrees {
    /// The tree of a sample.
    pub(super) fn tree(&mut self, id: SampleId) -> &mut DistributionTree {
        self.trees.entry(id).or_default()
    }

    /// Removes a lost worker; its children get its parent.
    pub(super) fn forget(&mut self, worker: WorkerId) {
        self.trees.values_mut().for_each(|tree| tree.forget(worker));
    }

    /// Keeps the trees of useful samples.
    pub(super) fn retain(&mut self, is_of_use: impl Fn(SampleId) -> bool) {
        self.trees.retain(|id, _| is_of_use(*id));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depth(tree: &mut DistributionTree, worker: WorkerId) -> usize {
        let mut depth = 1;
        let mut at = worker;
        while let Some(parent) = tree.parent(at) {
            at = parent;
            depth += 1;
            assert!(depth < 100, "workers wait for each other");
        }
        depth
    }

    #[test]
    fn a_thousand_workers_are_reached_in_seven_steps_of_three_children() {
        let mut tree = DistributionTree::default();
        let mut children: HashMap<Option<WorkerId>, usize> = HashMap::new();
        for worker in (0..1000).map(WorkerId) {
            *children.entry(tree.parent(worker)).or_default() += 1;
        }
        assert!(children.values().all(|&count| count <= FAN_OUT), "{children:?}");
        let deepest = (0..1000).map(|worker| depth(&mut tree, WorkerId(worker))).max();
        assert!(deepest.is_some_and(|depth| depth <= 7), "{deepest:?}");
    }

    #[test]
    fn the_children_of_a_lost_worker_get_its_parent() {
        let mut tree = DistributionTree::default();
        (0..200).for_each(|worker| _ = tree.parent(WorkerId(worker)));
        for gone in (0..200).filter(|worker| worker % 3 != 1) {
            tree.forget(WorkerId(gone));
        }
        for worker in (0..200).filter(|worker| worker % 3 == 1) {
            let parent = tree.parent(WorkerId(worker));
            assert!(parent.is_none_or(|parent| parent.0 % 3 == 1), "{parent:?} is gone");
            depth(&mut tree, WorkerId(worker));
        }
        // A worker that joins again is appended.
        assert_eq!(tree.order.len(), 200);
        depth(&mut tree, WorkerId(0));
        assert_eq!(tree.order.last(), Some(&Some(WorkerId(0))));
    }
}
