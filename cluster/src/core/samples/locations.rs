//! Which workers hold which sample, and which will soon. Updated worker by worker, so that no query examines all
//! workers.

use std::collections::{BTreeMap, BTreeSet};

use argus_scene::{FaceMask, SampleId};

use crate::core::event::WorkerId;

/// The locations of one sample.
#[derive(Debug, Clone, Default)]
struct SampleHolders {
    /// Workers that hold all of it.
    holders: BTreeSet<WorkerId>,
    /// Workers that hold some of its faces.
    partial: BTreeMap<WorkerId, FaceMask>,
    /// Workers with a queued view that needs it.
    readers: BTreeSet<WorkerId>,
}

impl SampleHolders {
    /// Whether any worker has any of it.
    fn is_held(&self) -> bool {
        !(self.holders.is_empty() && self.partial.is_empty())
    }
}

/// What one worker holds, and what its views need.
#[derive(Debug, Clone, Default)]
struct Holdings {
    /// Samples that it reported, and samples that it must hold since it used them, with the faces of each.
    held: BTreeMap<SampleId, FaceMask>,
    /// Whether it used samples since its newest report.
    used_since_report: bool,
    /// Samples that queued views need, with the number of such views. The worker will hold them.
    needed: BTreeMap<SampleId, usize>,
}

/// The samples that a worker reports, and those of them that lack faces.
pub(in crate::core) type Reported<'a> = (&'a [SampleId], &'a [(SampleId, FaceMask)]);

/// The locations of all samples. Unless a function says otherwise, a worker holds a sample if it holds all of its faces.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct SampleLocations {
    places: BTreeMap<SampleId, SampleHolders>,
    workers: BTreeMap<WorkerId, Holdings>,
    /// Samples that views in work need and no worker holds: they are being rendered.
    due: BTreeSet<SampleId>,
    /// Samples that a worker must render ahead of demand, with the faces that no worker holds.
    ordered: BTreeMap<SampleId, FaceMask>,
}

impl SampleLocations {
    /// Processes the samples that a worker reports, and those that it reported before. Returns whether there are new
    /// ones.
    pub(super) fn reported(&mut self, worker: WorkerId, held: Reported<'_>, before: Reported<'_>) -> bool {
        let holdings = self.workers.entry(worker).or_default();
        if !holdings.used_since_report && held == before {
            return false;
        }
        let (ids, partial) = held;
        let mut held: BTreeMap<SampleId, FaceMask> = ids.iter().map(|id| (*id, FaceMask::ALL)).collect();
        for (id, faces) in partial {
            held.entry(*id).and_modify(|held| *held = *faces);
        }
        let known = std::mem::replace(&mut holdings.held, held.clone());
        holdings.used_since_report = false;
        known.keys().filter(|id| !held.contains_key(id)).for_each(|&id| self.lost(id, worker));
        let mut news = false;
        for (id, faces) in held {
            let before = known.get(&id).copied().unwrap_or(FaceMask::NONE);
            if faces != before {
                self.gained(id, worker, faces);
                news |= !before.contains(faces);
            }
        }
        news
    }

    /// Number of samples of a version that workers hold.
    pub(super) fn held_of(&self, version: u64) -> u64 {
        let of_version = SampleId { version, camera: 0 }..=SampleId { version, camera: u64::MAX };
        self.places.range(of_version).filter(|(_, place)| place.is_held()).count() as u64
    }

    /// Whether any worker holds any sample.
    pub(super) fn holds_any(&self) -> bool {
        self.places.values().any(SampleHolders::is_held)
    }

    /// Records that a view that needs these samples was sent to a worker.
    pub(super) fn begin(&mut self, worker: WorkerId, samples: impl Iterator<Item = SampleId>) {
        for id in samples {
            let count = self.workers.entry(worker).or_default().needed.entry(id).or_default();
            *count += 1;
            if *count == 1 {
                self.wanted(id, worker);
            }
        }
    }

    /// Records that a view left a worker. A worker that answered it holds its samples.
    pub(super) fn end(&mut self, worker: WorkerId, samples: &[(SampleId, FaceMask)], answered: bool) {
        let Some(mut holdings) = self.workers.remove(&worker) else { return };
        for &(id, faces) in samples {
            let before = holdings.held.get(&id).copied().unwrap_or(FaceMask::NONE);
            if answered && !before.contains(faces) {
                holdings.used_since_report = true;
                holdings.held.insert(id, faces.union(before));
                self.gained(id, worker, faces.union(before));
            }
            if let Some(count) = holdings.needed.get_mut(&id) {
                *count -= 1;
                if *count == 0 {
                    holdings.needed.remove(&id);
                    self.unwanted(id, worker);
                }
            }
        }
        self.workers.insert(worker, holdings);
    }

    /// Forgets a lost worker.
    pub(super) fn forget(&mut self, worker: WorkerId) {
        let Some(Holdings { held, needed, .. }) = self.workers.remove(&worker) else { return };
        held.into_keys().for_each(|id| self.lost(id, worker));
        needed.into_keys().for_each(|id| self.unwanted(id, worker));
    }

    /// Number of samples that each worker holds.
    pub(super) fn holdings(&self) -> impl Iterator<Item = (WorkerId, usize)> {
        self.workers.iter().map(|(worker, holdings)| (*worker, holdings.held.len()))
    }

    /// Records that a worker holds these faces of a sample.
    fn gained(&mut self, id: SampleId, worker: WorkerId, faces: FaceMask) {
        let place = self.places.entry(id).or_default();
        if faces == FaceMask::ALL {
            place.holders.insert(worker);
            place.partial.remove(&worker);
        } else {
            place.holders.remove(&worker);
            place.partial.insert(worker, faces);
        }
        self.due.remove(&id);
        if self.ordered.get(&id).is_some_and(|ordered| faces.contains(*ordered)) {
            self.ordered.remove(&id);
        }
    }

    /// Records that a worker dropped a sample.
    fn lost(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| {
            place.holders.remove(&worker);
            place.partial.remove(&worker);
        });
    }

    /// Records that a worker's queue needs a sample.
    fn wanted(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| _ = place.readers.insert(worker));
    }

    /// Records that a worker's queue no longer needs a sample.
    fn unwanted(&mut self, id: SampleId, worker: WorkerId) {
        self.change(id, |place| _ = place.readers.remove(&worker));
    }

    fn change(&mut self, id: SampleId, change: impl FnOnce(&mut SampleHolders)) {
        let place = self.places.entry(id).or_default();
        change(place);
        match (!place.is_held(), place.readers.is_empty()) {
            (true, false) => _ = self.due.insert(id),
            (false, _) => _ = self.due.remove(&id),
            (true, true) => {
                self.due.remove(&id);
                self.places.remove(&id);
            }
        }
    }

    /// The workers that hold a sample, in the order in which they joined.
    pub(in crate::core) fn holders(&self, id: SampleId) -> impl Iterator<Item = WorkerId> {
        self.places.get(&id).into_iter().flat_map(|place| place.holders.iter().copied())
    }

    /// The workers that have these faces of a sample.
    pub(super) fn holders_of(&self, id: SampleId, faces: FaceMask) -> impl Iterator<Item = WorkerId> {
        let partial = self.places.get(&id).into_iter().flat_map(|place| &place.partial);
        let partial = partial.filter(move |(_, has)| has.contains(faces)).map(|(worker, _)| *worker);
        self.holders(id).chain(partial)
    }

    /// The faces of a sample that a worker has.
    pub(in crate::core) fn faces(&self, id: SampleId, worker: WorkerId) -> FaceMask {
        let place = self.places.get(&id);
        match place.is_some_and(|place| place.holders.contains(&worker)) {
            true => FaceMask::ALL,
            false => place.and_then(|place| place.partial.get(&worker)).copied().unwrap_or(FaceMask::NONE),
        }
    }

    /// The faces of a sample that some worker has.
    pub(in crate::core) fn faces_held(&self, id: SampleId) -> FaceMask {
        let Some(place) = self.places.get(&id) else { return FaceMask::NONE };
        match place.holders.is_empty() {
            true => place.partial.values().fold(FaceMask::NONE, |all, faces| all.union(*faces)),
            false => FaceMask::ALL,
        }
    }

    /// Number of workers that hold a sample.
    pub(in crate::core) fn count(&self, id: SampleId) -> usize {
        self.places.get(&id).map_or(0, |place| place.holders.len())
    }

    /// Workers that hold a sample or have a view that needs it, cyclically from worker `from` on.
    pub(in crate::core) fn near(&self, id: SampleId, from: WorkerId) -> impl Iterator<Item = WorkerId> {
        let place = self.places.get(&id);
        let around = move |of: fn(&SampleHolders) -> &BTreeSet<WorkerId>| {
            let set = place.map(of);
            set.into_iter().flat_map(move |set| set.range(from..).chain(set.range(..from)).copied())
        };
        around(|place| &place.holders).chain(around(|place| &place.readers))
    }

    /// Number of workers that [`Self::near`] yields.
    pub(in crate::core) fn count_near(&self, id: SampleId) -> usize {
        self.places.get(&id).map_or(0, |place| place.holders.len() + place.readers.len())
    }

    /// Whether a worker holds a sample.
    pub(in crate::core) fn has(&self, id: SampleId, worker: WorkerId) -> bool {
        self.places.get(&id).is_some_and(|place| place.holders.contains(&worker))
    }

    /// Number of these samples that a worker neither holds nor will soon hold.
    pub(in crate::core) fn missing(&self, samples: &[SampleId], worker: WorkerId) -> usize {
        samples.iter().filter(|id| !self.is_near(**id, worker)).count()
    }

    /// Whether a worker holds a sample or has a view that needs it.
    pub(super) fn is_near(&self, id: SampleId, worker: WorkerId) -> bool {
        let near = |place: &SampleHolders| place.holders.contains(&worker) || place.readers.contains(&worker);
        self.places.get(&id).is_some_and(near)
    }

    /// Whether any worker holds a sample.
    pub(in crate::core) fn is_held(&self, id: SampleId) -> bool {
        self.count(id) > 0
    }

    /// Whether a queued view needs a sample, so that it is being rendered or fetched.
    pub(super) fn is_on_its_way(&self, id: SampleId) -> bool {
        self.places.get(&id).is_some_and(|place| !place.readers.is_empty())
    }

    /// Sets the samples that workers must render ahead of demand.
    pub(super) fn order(&mut self, samples: impl Iterator<Item = (SampleId, FaceMask)>) {
        let lacks = |(id, faces): &(SampleId, FaceMask)| self.holders_of(*id, *faces).next().is_none();
        self.ordered = samples.filter(lacks).collect();
    }

    /// Samples to render: those that views wait for, then those ahead of demand.
    pub(in crate::core) fn to_render(&self) -> impl Iterator<Item = SampleId> {
        self.due.iter().chain(self.ordered.keys()).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: WorkerId = WorkerId(1);
    const B: WorkerId = WorkerId(2);

    fn id(index: u64) -> SampleId {
        SampleId { version: 0, camera: index }
    }

    #[test]
    fn a_sample_must_be_rendered_while_it_is_wanted_and_no_worker_holds_it() {
        let mut places = SampleLocations::default();
        places.wanted(id(7), A);
        places.wanted(id(7), B);
        places.order([(id(8), FaceMask::ALL)].into_iter());
        assert_eq!(places.to_render().collect::<Vec<_>>(), [id(7), id(8)]);
        places.gained(id(7), A, FaceMask::ALL);
        places.gained(id(8), B, FaceMask::ALL);
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
    fn samples_that_are_neither_held_nor_wanted_are_forgotten() {
        let mut places = SampleLocations::default();
        for index in 0..100 {
            places.gained(id(index), A, FaceMask::ALL);
            places.wanted(id(index), B);
            places.unwanted(id(index), B);
            places.lost(id(index), A);
        }
        assert!(places.places.is_empty() && places.due.is_empty());
    }

    #[test]
    fn used_samples_count_as_held_until_a_report_contradicts() {
        let mut places = SampleLocations::default();
        places.begin(A, [id(1), id(2)].into_iter());
        places.begin(A, [id(2)].into_iter());
        assert_eq!((places.missing(&[id(1), id(3)], A), places.missing(&[id(1)], B)), (1, 1));
        places.end(A, &[(id(1), FaceMask::ALL), (id(2), FaceMask::ALL)], true);
        assert!(places.has(id(1), A) && places.is_on_its_way(id(2)) && !places.is_on_its_way(id(1)));
        // An unchanged report still counts, since the worker used samples meanwhile.
        assert!(!places.reported(A, (&[], &[]), (&[], &[])), "nothing new");
        assert!(!places.has(id(1), A));
        assert!(places.reported(A, (&[id(3)], &[]), (&[], &[])) && places.has(id(3), A));
        assert!(!places.reported(A, (&[id(3)], &[]), (&[id(3)], &[])));
        assert_eq!(places.holdings().collect::<Vec<_>>(), [(A, 1)]);
    }

    #[test]
    fn a_lost_worker_leaves_no_locations() {
        let mut places = SampleLocations::default();
        places.reported(A, (&[id(1)], &[]), (&[], &[]));
        places.begin(A, [id(2)].into_iter());
        places.forget(A);
        places.forget(B);
        // A late event of one of its views changes nothing.
        places.end(A, &[(id(2), FaceMask::ALL)], true);
        assert!(places.places.is_empty() && places.workers.is_empty() && places.due.is_empty());
    }

    #[test]
    fn all_workers_near_a_sample_are_found_from_any_start() {
        let mut places = SampleLocations::default();
        (1..=5).for_each(|worker| places.gained(id(0), WorkerId(worker), FaceMask::ALL));
        places.wanted(id(0), WorkerId(9));
        for from in 0..12 {
            let near: BTreeSet<WorkerId> = places.near(id(0), WorkerId(from)).collect();
            assert_eq!(near.len(), 6, "from {from}");
            assert_eq!(places.count_near(id(0)), 6);
        }
        assert_eq!(places.near(id(0), WorkerId(4)).next(), Some(WorkerId(4)));
    }

    #[test]
    fn a_worker_with_some_faces_has_these_and_not_the_sample() {
        let (left, both) = (FaceMask::only(1), FaceMask::only(1).union(FaceMask::only(4)));
        let mut places = SampleLocations::default();
        assert!(places.reported(A, (&[id(1)], &[(id(1), left)]), (&[], &[])));
        assert_eq!((places.faces(id(1), A), places.faces(id(1), B)), (left, FaceMask::NONE));
        assert!(!places.has(id(1), A) && !places.is_held(id(1)) && places.missing(&[id(1)], A) == 1);
        // An order for more faces stands until a worker holds them.
        places.order([(id(1), both)].into_iter());
        assert_eq!(places.to_render().collect::<Vec<_>>(), [id(1)]);
        assert!(places.reported(A, (&[id(1)], &[(id(1), both)]), (&[id(1)], &[(id(1), left)])), "more faces");
        assert_eq!(places.to_render().count(), 0);
        assert_eq!(places.holders_of(id(1), left).collect::<Vec<_>>(), [A]);
        assert_eq!(places.holders_of(id(1), FaceMask::ALL).count(), 0);
        // A view that used all faces leaves the whole sample there; one that used some leaves those.
        places.begin(A, [id(1)].into_iter());
        places.begin(B, [id(1)].into_iter());
        places.end(A, &[(id(1), FaceMask::ALL)], true);
        places.end(B, &[(id(1), left)], true);
        assert!(places.has(id(1), A) && places.faces(id(1), B) == left);
        assert_eq!(places.faces_held(id(1)), FaceMask::ALL);
        places.forget(A);
        assert_eq!(places.faces_held(id(1)), left);
        places.forget(B);
        assert!(places.places.is_empty() && places.due.is_empty());
    }
}
