//! How a sample reaches those who compose: down a tree, so that whoever rendered it need not feed a thousand.
//!
//! Workers that are told to fetch a sample stand in the order in which they were told. The first [`FAN_OUT`] fetch it
//! from where it is, each other one from a worker that was told before: its *parent*, which passes on what it has or
//! is about to have. A parent always stands before its children, and nobody changes places while a sample lasts, so no
//! two wait for each other. Over a link that takes time t for a sample, a thousand workers have it after
//! FAN_OUT · log_FAN_OUT(1000) · t, which is least near e: 19 t at three, where one sender takes 1000 t.

use std::collections::HashMap;

use argus_scene::SampleId;

use crate::core::event::WorkerId;

/// Children of a worker.
pub(super) const FAN_OUT: usize = 3;

/// The order in which workers were told to fetch one sample.
#[derive(Debug, Clone, Default)]
pub(super) struct DistributionTree {
    /// `None` where one is gone.
    order: Vec<Option<WorkerId>>,
    places: HashMap<WorkerId, usize>,
}

impl DistributionTree {
    /// The parent of a worker, which joins the tree as its last if it is not part of it; `None`: it is fed by who has
    /// the sample already.
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

/// The trees of all samples that are on their way.
#[derive(Debug, Clone, Default)]
pub(super) struct DistributionTrees {
    trees: HashMap<SampleId, DistributionTree>,
}

impl DistributionTrees {
    /// The tree of a sample.
    pub(super) fn tree(&mut self, id: SampleId) -> &mut DistributionTree {
        self.trees.entry(id).or_default()
    }

    /// A worker is gone; its children are fed by its own parent.
    pub(super) fn forget(&mut self, worker: WorkerId) {
        self.trees.values_mut().for_each(|tree| tree.forget(worker));
    }

    /// Keeps the trees of samples that are still of use.
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
    fn a_thousand_workers_are_reached_in_seven_steps_and_nobody_feeds_more_than_three() {
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
    fn whoever_loses_its_parent_is_fed_by_the_one_above_and_nobody_waits_for_each_other() {
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
        // One that comes again comes last.
        assert_eq!(tree.order.len(), 200);
        depth(&mut tree, WorkerId(0));
        assert_eq!(tree.order.last(), Some(&Some(WorkerId(0))));
    }
}
