//! The samples this process holds, bounded by their size.
//!
//! One entry a sample, shared with whoever uses it: the views that wait with it, and through them the
//! compositor. The least recently used entry that nobody uses is forgotten first; what is in use stays, so
//! that a view that was admitted is never left without its samples.

use std::collections::HashMap;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{FaceMask, PlaneData, Sample, SampleId};
use parking_lot::Mutex;
use tokio::sync::Semaphore;

use super::packed::{Chunks, Packed};

#[derive(Debug)]
struct Entry {
    sample: Arc<Sample>,
    bytes: u64,
    used: u64,
    /// Whoever asks for it has it, and nobody is told that it is here.
    quiet: bool,
}

#[derive(Debug, Default)]
struct State {
    entries: HashMap<SampleId, Entry>,
    bytes: u64,
    clock: u64,
}

/// The samples, by id.
#[derive(Debug)]
pub(super) struct Store {
    limit: u64,
    state: Mutex<State>,
    packed: Packed,
}

/// Whether every plane is in host memory, so that another process can have it.
pub(super) fn is_on_host(sample: &Sample) -> bool {
    sample.planes.iter().all(|plane| matches!(plane.data, PlaneData::Host(_)))
}

/// Bytes of its texels.
fn bytes_of(sample: &Sample) -> u64 {
    let plane = |plane: &argus_scene::Plane| {
        u64::from(plane.size[0]) * u64::from(plane.size[1]) * plane.format.texel_bytes() as u64
    };
    sample.planes.iter().map(plane).sum()
}

impl Store {
    /// Empty; keeps `limit` texel bytes and what is in use.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default(), packed: Packed::beside(limit) }
    }

    /// The sample, if it is held.
    pub(super) fn get(&self, id: SampleId) -> Option<Arc<Sample>> {
        let mut state = self.state.lock();
        state.clock += 1;
        let clock = state.clock;
        let entry = state.entries.get_mut(&id)?;
        entry.used = clock;
        Some(entry.sample.clone())
    }

    /// The sample, if it is held with these faces.
    pub(super) fn get_with(&self, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
        self.get(id).filter(|sample| sample.faces.contains(faces))
    }

    /// The faces of a sample that are held; being asked is no use of it.
    pub(super) fn faces(&self, id: SampleId) -> FaceMask {
        self.state.lock().entries.get(&id).map_or(FaceMask::NONE, |entry| entry.sample.faces)
    }

    /// Texel bytes of what is held.
    pub(super) fn bytes(&self) -> u64 {
        self.state.lock().bytes
    }

    /// Texel bytes of the largest one; 0: none is held.
    pub(super) fn largest(&self) -> u64 {
        self.state.lock().entries.values().map(|entry| entry.bytes).max().unwrap_or(0)
    }

    /// The sample, if it is held with these faces in host memory.
    pub(super) fn get_on_host(&self, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
        self.get_with(id, faces).filter(|sample| is_on_host(sample))
    }

    /// A sample that is held, packed; in a turn of `packing` where it is not packed yet.
    ///
    /// # Errors
    /// [`Fault`] of a sample whose planes are not in host memory.
    pub(super) async fn packed(&self, sample: Arc<Sample>, packing: &Semaphore) -> Result<Chunks, Fault> {
        self.packed.of(sample, packing).await
    }

    /// Takes in a sample that came from another worker, to be passed on as it came.
    pub(super) fn insert_received(&self, (sample, chunks): (Sample, Chunks)) -> Arc<Sample> {
        let sample = self.insert(sample);
        self.packed.keep(sample.id, chunks);
        sample
    }

    /// The same for a sample that is to be announced later.
    pub(super) fn insert_received_quietly(&self, (sample, chunks): (Sample, Chunks)) -> Arc<Sample> {
        let sample = self.insert_quietly(sample);
        self.packed.keep(sample.id, chunks);
        sample
    }

    /// Takes a sample in, in place of one of the same id.
    pub(super) fn insert(&self, sample: Sample) -> Arc<Sample> {
        self.insert_as(sample, false)
    }

    /// Takes a sample in that [`Self::ids`] does not list until it is announced.
    pub(super) fn insert_quietly(&self, sample: Sample) -> Arc<Sample> {
        self.insert_as(sample, true)
    }

    /// Lists a sample from now on, if it is here.
    pub(super) fn announce(&self, id: SampleId) {
        if let Some(entry) = self.state.lock().entries.get_mut(&id) {
            entry.quiet = false;
        }
    }

    fn insert_as(&self, sample: Sample, quiet: bool) -> Arc<Sample> {
        let sample = Arc::new(sample);
        let mut state = self.state.lock();
        // One with more faces may have come meanwhile.
        if let Some(Entry { sample: held, .. }) = state.entries.get(&sample.id)
            && held.faces != sample.faces
            && held.faces.contains(sample.faces)
            && (is_on_host(held) || !is_on_host(&sample))
        {
            return held.clone();
        }
        self.packed.forget(sample.id);
        state.remove(sample.id);
        state.clock += 1;
        let entry = Entry { sample: sample.clone(), bytes: bytes_of(&sample), used: state.clock, quiet };
        state.bytes += entry.bytes;
        state.entries.insert(sample.id, entry);
        while state.bytes > self.limit {
            let unused = |(_, entry): &(&SampleId, &Entry)| Arc::strong_count(&entry.sample) == 1;
            let oldest = state.entries.iter().filter(unused).min_by_key(|(_, entry)| entry.used);
            let Some((&id, _)) = oldest else { break };
            state.remove(id);
        }
        sample
    }

    /// Forgets samples, used or not.
    pub(super) fn forget(&self, ids: &[SampleId]) {
        let mut state = self.state.lock();
        for id in ids {
            state.remove(*id);
            self.packed.forget(*id);
        }
    }

    /// Forgets the samples that are only on the device, because that was lost.
    pub(super) fn forget_device_planes(&self) {
        let mut state = self.state.lock();
        let lost: Vec<SampleId> =
            state.entries.iter().filter(|(_, e)| !is_on_host(&e.sample)).map(|(id, _)| *id).collect();
        for id in lost {
            state.remove(id);
        }
    }

    /// Forgets versions with a lower number, but for what is in use, which its last user lets go of.
    pub(super) fn retire(&self, before_version: u64) {
        self.packed.retire(before_version);
        let mut state = self.state.lock();
        let old: Vec<SampleId> = state
            .entries
            .iter()
            .filter(|(id, entry)| id.version < before_version && Arc::strong_count(&entry.sample) == 1)
            .map(|(id, _)| *id)
            .collect();
        for id in old {
            state.remove(id);
        }
    }

    /// Forgets all samples of a version, used or not.
    pub(super) fn forget_version(&self, number: u64) {
        let of_version: Vec<SampleId> =
            self.state.lock().entries.keys().copied().filter(|id| id.version == number).collect();
        self.forget(&of_version);
    }

    /// Forgets everything.
    pub(super) fn clear(&self) {
        *self.state.lock() = State::default();
        self.packed.clear();
    }

    /// What is held, but for what is not announced yet.
    pub(super) fn ids(&self) -> Vec<SampleId> {
        let state = self.state.lock();
        let listed = state.entries.iter().filter(|(_, entry)| !entry.quiet);
        let mut ids: Vec<SampleId> = listed.map(|(id, _)| *id).collect();
        ids.sort_unstable();
        ids
    }

    /// Samples of [`Self::ids`] that lack faces, with the faces that they have.
    pub(super) fn partial(&self) -> Vec<(SampleId, FaceMask)> {
        let state = self.state.lock();
        let listed = state.entries.iter().filter(|(_, entry)| !entry.quiet);
        let faces = listed.map(|(id, entry)| (*id, entry.sample.faces));
        let mut partial: Vec<_> = faces.filter(|(_, faces)| *faces != FaceMask::ALL).collect();
        partial.sort_unstable();
        partial
    }
}

impl State {
    fn remove(&mut self, id: SampleId) {
        if let Some(entry) = self.entries.remove(&id) {
            self.bytes -= entry.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Plane, PlaneFormat, PlaneKind, SampleCamera};
    use bytes::Bytes;
    use glam::DVec3;

    use super::*;

    fn id(index: u64) -> SampleId {
        SampleId { version: 0, camera: index }
    }

    /// 400 bytes.
    fn sample(index: u64, data: PlaneData) -> Sample {
        let plane =
            Plane { kind: PlaneKind::InverseRange, format: PlaneFormat::R32Float, size: [10, 10], data };
        let camera = Camera::look_at(DVec3::ONE, DVec3::ZERO);
        let camera = SampleCamera::Perspective { camera, width: 10, height: 10 };
        Sample { id: id(index), camera, faces: FaceMask::ALL, planes: vec![plane], stages: Vec::new() }
    }

    fn host(index: u64) -> Sample {
        sample(index, PlaneData::Host(Bytes::from(vec![0; 400])))
    }

    #[test]
    fn the_least_recently_used_goes_first_and_what_is_in_use_stays() {
        let store = Store::new(1200);
        assert_eq!(store.largest(), 0);
        let in_use = store.insert(host(0));
        assert_eq!(store.largest(), 400);
        for index in 1..3 {
            store.insert(host(index));
        }
        assert!(store.get(id(1)).is_some());
        store.insert(host(3));
        assert_eq!(store.ids(), [id(0), id(1), id(3)]);
        drop(in_use);
        store.insert(host(4));
        assert_eq!(store.ids(), [id(1), id(3), id(4)]);
    }

    #[test]
    fn what_is_taken_in_quietly_is_there_and_not_listed_until_it_is_announced() {
        let store = Store::new(1 << 20);
        store.insert_quietly(host(3));
        assert!(store.get(id(3)).is_some() && store.ids().is_empty());
        store.announce(id(3));
        store.announce(id(4));
        assert_eq!(store.ids(), [id(3)]);
    }

    #[test]
    fn samples_in_use_may_exceed_the_limit() {
        let store = Store::new(500);
        let held: Vec<_> = (0..4).map(|index| store.insert(host(index))).collect();
        assert_eq!(store.ids().len(), 4);
        drop(held);
        store.insert(host(9));
        assert_eq!(store.ids(), [id(9)]);
    }

    #[test]
    fn samples_of_past_versions_go_unless_they_are_in_use() {
        let store = Store::new(1 << 20);
        let at = |version, camera| Sample { id: SampleId { version, camera }, ..host(camera) };
        let in_use = store.insert(at(3, 0));
        for (version, camera) in [(3, 1), (4, 0), (5, 0)] {
            store.insert(at(version, camera));
        }
        store.retire(5);
        assert_eq!(store.ids(), [in_use.id, SampleId { version: 5, ..id(0) }]);
        drop(in_use);
        store.retire(5);
        assert_eq!(store.ids(), [SampleId { version: 5, ..id(0) }]);
    }

    #[test]
    fn a_number_that_stands_for_another_version_now_takes_its_samples_along() {
        let store = Store::new(1 << 20);
        let at = |version, camera| Sample { id: SampleId { version, camera }, ..host(camera) };
        let _in_use = store.insert(at(3, 0));
        for (version, camera) in [(3, 1), (4, 0)] {
            store.insert(at(version, camera));
        }
        store.forget_version(3);
        assert_eq!(store.ids(), [SampleId { version: 4, camera: 0 }]);
    }

    #[test]
    fn a_lost_device_takes_only_its_own_planes() {
        let store = Store::new(1 << 20);
        store.insert(host(0));
        store.insert(sample(1, PlaneData::Device(Arc::new(()))));
        assert!(store.get_on_host(id(1), FaceMask::ALL).is_none() && store.get(id(1)).is_some());
        store.forget_device_planes();
        assert_eq!(store.ids(), [id(0)]);
        store.insert(host(0));
        store.clear();
        assert!(store.ids().is_empty());
    }

    #[test]
    fn a_sample_is_held_with_its_faces_and_one_of_fewer_does_not_replace_it() {
        let store = Store::new(u64::MAX);
        let [front, both] = [1, 0b11].map(|bits| FaceMask::new(bits, "faces").unwrap());
        let with = |faces| Sample { faces, ..host(1) };
        assert_eq!((store.faces(id(1)), store.partial()), (FaceMask::NONE, Vec::new()));
        store.insert(with(both));
        assert_eq!(store.insert(with(front)).faces, both, "it serves who needs fewer, too");
        assert_eq!((store.faces(id(1)), store.partial()), (both, vec![(id(1), both)]));
        assert!(store.get_with(id(1), front).is_some() && store.get_with(id(1), FaceMask::ALL).is_none());
        store.insert_quietly(host(1));
        assert!(store.get_on_host(id(1), FaceMask::ALL).is_some());
        assert_eq!(store.partial(), Vec::new());
    }
}
