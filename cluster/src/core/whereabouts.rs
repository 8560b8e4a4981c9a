//! Who has which sample, and who is about to: kept up to date worker by worker, so that no question about a sample
//! looks at every worker.

use std::collections::{BTreeMap, BTreeSet};

use argus_scene::SampleId;

use super::event::WorkerId;

/// One sample.
#[derive(Debug, Clone, Default)]
struct Place {
    /// Workers that have it.
    holders: BTreeSet<WorkerId>,
    /// Workers with a view in their queue that needs it.
    readers: BTreeSet<WorkerId>,
}

/// All samples that anybody has or is about to have.
#[derive(Debug, Clone, Default)]
pub(super) struct Whereabouts {
    places: BTreeMap<SampleId, Place>,
    /// Samples that views in work need and nobody has: they are being rendered.
    due: BTreeSet<SampleId>,
    /// Samples that somebody was told to render ahead of demand and nobody has.
    ordered: BTreeSet<SampleId>,
}

impl Whereabouts {
    /// A worker has a sample.
    pub(super) fn gained(&mut self, id: SampleId, worker: WorkerId) {
        self.places.entry(id).or_default().holders.insert(worker);
        self.due.remove(&id);
        self.ordered.remove(&id);
    }

    /// A worker has a sample no longer.
    pub(super) fn lost(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| _ = place.holders.remove(&worker));
    }

    /// A view in a worker's queue is the first there that needs a sample.
    pub(super) fn wanted(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| _ = place.readers.insert(worker));
    }

    /// No view in a worker's queue needs a sample any more.
    pub(super) fn unwanted(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| _ = place.readers.remove(&worker));
    }

    fn change(&mut self, id: SampleId, change: impl FnOnce(&mut Place)) {
        let place = self.places.entry(id).or_default();
        change(place);
        match (place.holders.is_empty(), place.readers.is_empty()) {
            (true, false) => _ = self.due.insert(id),
            (false, _) => _ = self.due.remove(&id),
            (true, true) => {
                self.due.remove(&id);
                self.places.remove(&id);
            }
        }
    }

    /// Who has a sample, in the order in which they joined.
    pub(super) fn holders(&self, id: SampleId) -> impl Iterator<Item = WorkerId> {
        self.places.get(&id).into_iter().flat_map(|place| place.holders.iter().copied())
    }

    /// How many have a sample.
    pub(super) fn count(&self, id: SampleId) -> usize {
        self.places.get(&id).map_or(0, |place| place.holders.len())
    }

    /// Those who have a sample or have a view that needs it, from a worker on.
    pub(super) fn near(&self, id: SampleId, from: WorkerId) -> impl Iterator<Item = WorkerId> {
        let place = self.places.get(&id);
        let around = move |of: fn(&Place) -> &BTreeSet<WorkerId>| {
            let set = place.map(of);
            set.into_iter().flat_map(move |set| set.range(from..).chain(set.range(..from)).copied())
        };
        around(|place| &place.holders).chain(around(|place| &place.readers))
    }

    /// How many [`Self::near`] yields.
    pub(super) fn count_near(&self, id: SampleId) -> usize {
        self.places.get(&id).map_or(0, |place| place.holders.len() + place.readers.len())
    }

    /// Whether a worker has a sample.
    pub(super) fn has(&self, id: SampleId, worker: WorkerId) -> bool {
        self.places.get(&id).is_some_and(|place| place.holders.contains(&worker))
    }

    /// Whether a worker has a sample or a view that needs it.
    pub(super) fn is_near(&self, id: SampleId, worker: WorkerId) -> bool {
        let near = |place: &Place| place.holders.contains(&worker) || place.readers.contains(&worker);
        self.places.get(&id).is_some_and(near)
    }

    /// Whether anybody has a sample.
    pub(super) fn is_held(&self, id: SampleId) -> bool {
        self.count(id) > 0
    }

    /// Whether a view in somebody's queue needs a sample, so that it is being rendered or fetched.
    pub(super) fn is_on_its_way(&self, id: SampleId) -> bool {
        self.places.get(&id).is_some_and(|place| !place.readers.is_empty())
    }

    /// These are the samples that somebody was told to render ahead of demand.
    pub(super) fn order(&mut self, ids: impl Iterator<Item = SampleId>) {
        self.ordered =
            ids.filter(|id| self.places.get(id).is_none_or(|place| place.holders.is_empty())).collect();
    }

    /// Samples that somebody has to render: for views that wait first, then for those to come.
    pub(super) fn to_render(&self) -> impl Iterator<Item = SampleId> {
        self.due.iter().chain(&self.ordered).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: WorkerId = WorkerId(1);
    const B: WorkerId = WorkerId(2);

    fn id(index: u64) -> SampleId {
        SampleId { epoch: 0, generation: 1, index }
    }

    #[test]
    fn a_sample_is_to_be_rendered_as_long_as_it_is_wanted_and_nobody_has_it() {
        let mut places = Whereabouts::default();
        places.wanted(id(7), A);
        places.wanted(id(7), B);
        places.order([id(8)].into_iter());
        assert_eq!(places.to_render().collect::<Vec<_>>(), [id(7), id(8)]);
        places.gained(id(7), A);
        places.gained(id(8), B);
        assert_eq!(places.to_render().count(), 0);
        assert!(places.is_on_its_way(id(7)) && places.has(id(7), A) && !places.has(id(7), B));
        places.lost(id(7), A);
        assert_eq!(places.to_render().collect::<Vec<_>>(), [id(7)], "views still want it");
        for worker in [A, B] {
            places.unwanted(id(7), worker);
        }
        assert_eq!(places.to_render().count(), 0);
        assert!(!places.is_held(id(7)) && !places.is_on_its_way(id(7)));
    }

    #[test]
    fn what_nobody_has_and_nobody_wants_takes_no_room() {
        let mut places = Whereabouts::default();
        for index in 0..100 {
            places.gained(id(index), A);
            places.wanted(id(index), B);
            places.unwanted(id(index), B);
            places.lost(id(index), A);
        }
        assert!(places.places.is_empty() && places.due.is_empty());
    }

    #[test]
    fn those_near_a_sample_are_all_there_from_any_beginning() {
        let mut places = Whereabouts::default();
        (1..=5).for_each(|worker| places.gained(id(0), WorkerId(worker)));
        places.wanted(id(0), WorkerId(9));
        for from in 0..12 {
            let near: BTreeSet<WorkerId> = places.near(id(0), WorkerId(from)).collect();
            assert_eq!(near.len(), 6, "from {from}");
            assert_eq!(places.count_near(id(0)), 6);
        }
        assert_eq!(places.near(id(0), WorkerId(4)).next(), Some(WorkerId(4)));
    }
}
