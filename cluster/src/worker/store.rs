//! The samples that this worker holds, bounded by their size.
//!
//! Each sample is one shared entry. Waiting views use it, and the compositor through them. The least recently used
//! entry that is not in use is dropped first. An entry in use stays, so an accepted view never loses its samples.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{FaceMask, PlaneData, Sample, SampleId, SceneState, Version};
use parking_lot::Mutex;
use tokio::sync::Semaphore;

use super::packed::{Chunks, Packed};

#[derive(Debug)]
struct Entry {
    sample: Arc<Sample>,
    bytes: u64,
    used: u64,
    /// It can be used, but is not announced to the coordinator: not yet, or not any more.
    is_quiet: bool,
    /// Its version is retired, but the next sample of its camera may begin with it.
    is_base: bool,
}

/// Versions whose states are remembered.
const MOST_VERSIONS: usize = 256;

#[derive(Debug, Default)]
struct State {
    entries: HashMap<SampleId, Entry>,
    /// What each version shows, by its number.
    shown: BTreeMap<u64, SceneState>,
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

/// Whether every plane is in host memory, as sending requires.
pub(super) fn is_on_host(sample: &Sample) -> bool {
    sample.planes.iter().all(|plane| matches!(plane.data, PlaneData::Host(_)))
}

/// Texel bytes of a sample.
fn bytes_of(sample: &Sample) -> u64 {
    let plane = |plane: &argus_scene::Plane| {
        u64::from(plane.size[0]) * u64::from(plane.size[1]) * plane.format.texel_bytes() as u64
    };
    sample.planes.iter().map(plane).sum()
}

impl Store {
    /// An empty store. It keeps at most `limit` texel bytes, beside samples in use.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default(), packed: Packed::beside(limit) }
    }

    /// A held sample. Marks it as used.
    pub(super) fn get(&self, id: SampleId) -> Option<Arc<Sample>> {
        let mut state = self.state.lock();
        state.clock += 1;
        let clock = state.clock;
        let entry = state.entries.get_mut(&id)?;
        entry.used = clock;
        Some(entry.sample.clone())
    }

    /// The held sample of the latest version of the same camera before that of an id, with what that version shows.
    pub(super) fn latest_before(&self, id: SampleId) -> Option<(Arc<Sample>, SceneState)> {
        let state = self.state.lock();
        let earlier =
            state.entries.iter().filter(|(held, _)| held.camera == id.camera && held.version < id.version);
        let (held, entry) = earlier.max_by_key(|(held, _)| held.version)?;
        Some((entry.sample.clone(), *state.shown.get(&held.version)?))
    }

    /// A held sample that has these faces.
    pub(super) fn get_with(&self, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
        self.get(id).filter(|sample| sample.faces.contains(faces))
    }

    /// The held faces of a sample. Does not mark it as used.
    pub(super) fn faces(&self, id: SampleId) -> FaceMask {
        self.state.lock().entries.get(&id).map_or(FaceMask::NONE, |entry| entry.sample.faces)
    }

    /// Texel bytes of all held samples.
    pub(super) fn bytes(&self) -> u64 {
        self.state.lock().bytes
    }

    /// Texel bytes of the largest held sample; 0: none is held.
    pub(super) fn largest(&self) -> u64 {
        self.state.lock().entries.values().map(|entry| entry.bytes).max().unwrap_or(0)
    }

    /// A held sample that has these faces in host memory.
    pub(super) fn get_on_host(&self, id: SampleId, faces: FaceMask) -> Option<Arc<Sample>> {
        self.get_with(id, faces).filter(|sample| is_on_host(sample))
    }

    /// Packs a held sample with a permit of `packing`, or returns it from the cache.
    ///
    /// # Errors
    /// [`Fault`] for a sample whose planes are not in host memory.
    pub(super) async fn packed(&self, sample: Arc<Sample>, packing: &Semaphore) -> Result<Chunks, Fault> {
        self.packed.of(sample, packing).await
    }

    /// Caches the chunks of a sample that is kept elsewhere, for forwarding.
    pub(super) fn keep_packed(&self, id: SampleId, chunks: Chunks) {
        self.packed.keep(id, chunks);
    }

    /// Inserts a sample received from another worker, and caches its chunks for forwarding.
    pub(super) fn insert_received(&self, (sample, chunks): (Sample, Chunks)) -> Arc<Sample> {
        let sample = self.insert(sample);
        self.packed.keep(sample.id, chunks);
        sample
    }

    /// Inserts a received sample like [`Self::insert_received`], but does not list it until it is announced.
    pub(super) fn insert_received_quietly(&self, (sample, chunks): (Sample, Chunks)) -> Arc<Sample> {
        let sample = self.insert_quietly(sample);
        self.packed.keep(sample.id, chunks);
        sample
    }

    /// Inserts a sample, and replaces one with the same id.
    pub(super) fn insert(&self, sample: Sample) -> Arc<Sample> {
        self.insert_as(sample, false)
    }

    /// Inserts a sample that [`Self::ids`] does not list until it is announced.
    pub(super) fn insert_quietly(&self, sample: Sample) -> Arc<Sample> {
        self.insert_as(sample, true)
    }

    /// Lists a sample from now on, if it is held.
    pub(super) fn announce(&self, id: SampleId) {
        if let Some(entry) = self.state.lock().entries.get_mut(&id) {
            entry.is_quiet = false;
        }
    }

    fn insert_as(&self, sample: Sample, is_quiet: bool) -> Arc<Sample> {
        let sample = Arc::new(sample);
        let mut state = self.state.lock();
        // A sample with more faces may have arrived meanwhile.
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
        let (bytes, used) = (bytes_of(&sample), state.clock);
        let entry = Entry { sample: sample.clone(), bytes, used, is_quiet, is_base: false };
        state.bytes += entry.bytes;
        state.entries.insert(sample.id, entry);
        state.drop_bases(|base| base.camera == sample.id.camera && base.version < sample.id.version);
        while state.bytes > self.limit {
            let unused = |(_, entry): &(&SampleId, &Entry)| Arc::strong_count(&entry.sample) == 1;
            let oldest = state.entries.iter().filter(unused).min_by_key(|(_, entry)| entry.used);
            let Some((&id, _)) = oldest else { break };
            state.remove(id);
        }
        sample
    }

    /// Drops samples, whether in use or not.
    pub(super) fn forget(&self, ids: &[SampleId]) {
        let mut state = self.state.lock();
        for id in ids {
            state.remove(*id);
            self.packed.forget(*id);
        }
    }

    /// Drops the samples that exist only on the device, because it was lost.
    pub(super) fn forget_device_planes(&self) {
        let mut state = self.state.lock();
        let lost: Vec<SampleId> =
            state.entries.iter().filter(|(_, e)| !is_on_host(&e.sample)).map(|(id, _)| *id).collect();
        for id in lost {
            state.remove(id);
        }
    }

    /// Drops samples of versions below this number, except those in use. With `keeps_bases` the latest sample of each camera that has
    /// none of a later version stays, unannounced: the next one may begin with it.
    pub(super) fn retire(&self, before_version: u64, keeps_bases: bool) {
        self.packed.retire(before_version);
        let mut state = self.state.lock();
        let mut latest: HashMap<u64, u64> = HashMap::new();
        for id in state.entries.keys() {
            let version = latest.entry(id.camera).or_default();
            *version = id.version.max(*version);
        }
        let is_base = |id: &SampleId| keeps_bases && latest.get(&id.camera) == Some(&id.version);
        state.entries.iter_mut().filter(|(id, _)| id.version < before_version && is_base(id)).for_each(
            |(_, entry)| {
                (entry.is_quiet, entry.is_base) = (true, true);
            },
        );
        let unused = |entry: &Entry| Arc::strong_count(&entry.sample) == 1;
        let old = state
            .entries
            .iter()
            .filter(|(id, entry)| id.version < before_version && !entry.is_base && unused(entry));
        for id in old.map(|(id, _)| *id).collect::<Vec<SampleId>>() {
            state.remove(id);
        }
    }

    /// Begins a version. Drops all samples that are held under its number, whether in use or not: they show what an earlier version
    /// of that number showed.
    pub(super) fn begin_version(&self, version: Version) {
        let mut state = self.state.lock();
        let of_version: Vec<SampleId> =
            state.entries.keys().copied().filter(|id| id.version == version.number).collect();
        state.shown.insert(version.number, version.state);
        while state.shown.len() > MOST_VERSIONS {
            state.shown.pop_first();
        }
        drop(state);
        self.forget(&of_version);
    }

    /// Drops all samples.
    pub(super) fn clear(&self) {
        *self.state.lock() = State::default();
        self.packed.clear();
    }

    /// Announced samples, sorted.
    pub(super) fn ids(&self) -> Vec<SampleId> {
        let state = self.state.lock();
        let listed = state.entries.iter().filter(|(_, entry)| !entry.is_quiet);
        let mut ids: Vec<SampleId> = listed.map(|(id, _)| *id).collect();
        ids.sort_unstable();
        ids
    }

    /// Announced samples that lack faces, with the faces that they have.
    pub(super) fn partial(&self) -> Vec<(SampleId, FaceMask)> {
        let state = self.state.lock();
        let listed = state.entries.iter().filter(|(_, entry)| !entry.is_quiet);
        let faces = listed.map(|(id, entry)| (*id, entry.sample.faces));
        let mut partial: Vec<_> = faces.filter(|(_, faces)| *faces != FaceMask::ALL).collect();
        partial.sort_unstable();
        partial
    }
}

impl State {
    /// Drops those of the samples that the next one of their camera could have begun with.
    fn drop_bases(&mut self, of: impl Fn(&SampleId) -> bool) {
        let bases = self.entries.iter().filter(|(id, entry)| entry.is_base && of(id));
        for id in bases.map(|(id, _)| *id).collect::<Vec<SampleId>>() {
            self.remove(id);
        }
    }

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

    /// A sample of 400 bytes.
    fn sample(index: u64, data: PlaneData) -> Sample {
        let plane =
            Plane { kind: PlaneKind::InverseRange, format: PlaneFormat::R32Float, size: [10, 10], data };
        let camera = Camera::look_at(DVec3::ONE, DVec3::ZERO);
        let camera = SampleCamera::Perspective { camera, width: 10, height: 10 };
        Sample { id: id(index), camera, faces: FaceMask::ALL, planes: vec![plane], stages: Vec::new() }
    }

    /// A version that shows a revision of its own.
    fn shown(number: u64) -> Version {
        Version { number, state: SceneState { revision: 100 + number, ..SceneState::of_epoch(0) } }
    }

    fn host(index: u64) -> Sample {
        sample(index, PlaneData::Host(Bytes::from(vec![0; 400])))
    }

    #[test]
    fn the_least_recently_used_sample_is_dropped_first_and_samples_in_use_stay() {
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
    fn a_quiet_sample_is_held_but_not_listed_until_it_is_announced() {
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
    fn samples_of_retired_versions_are_dropped_unless_they_are_in_use() {
        let store = Store::new(1 << 20);
        let at = |version, camera| Sample { id: SampleId { version, camera }, ..host(camera) };
        let in_use = store.insert(at(3, 0));
        for (version, camera) in [(3, 1), (4, 0), (5, 0)] {
            store.insert(at(version, camera));
        }
        store.retire(5, false);
        assert_eq!(store.ids(), [in_use.id, SampleId { version: 5, ..id(0) }]);
        drop(in_use);
        store.retire(5, false);
        assert_eq!(store.ids(), [SampleId { version: 5, ..id(0) }]);
    }

    #[test]
    fn the_latest_of_the_earlier_versions_of_a_camera_is_found() {
        let store = Store::new(1 << 20);
        (3..9).for_each(|number| store.begin_version(shown(number)));
        for (version, camera) in [(3, 0), (5, 0), (8, 0), (7, 1), (11, 1)] {
            store.insert(Sample { id: SampleId { version, camera }, ..host(camera) });
        }
        let before = |version| {
            let (held, state) = store.latest_before(SampleId { version, camera: 0 })?;
            assert_eq!(state.revision, 100 + held.id.version);
            Some(held.id.version)
        };
        assert_eq!([3, 5, 8, 9].map(before), [None, Some(3), Some(5), Some(8)]);
        assert!(
            store.latest_before(SampleId { version: 12, camera: 1 }).is_none(),
            "what it shows is not known"
        );
    }

    #[test]
    fn of_retired_versions_the_latest_sample_of_a_camera_stays_unannounced_until_the_next_one() {
        let store = Store::new(1 << 20);
        let at = |version, camera| SampleId { version, camera };
        (3..9).for_each(|number| store.begin_version(shown(number)));
        for (version, camera) in [(3, 0), (4, 0), (3, 1), (5, 1)] {
            store.insert(Sample { id: at(version, camera), ..host(camera) });
        }
        store.retire(5, true);
        assert_eq!(store.ids(), [at(5, 1)]);
        assert_eq!(store.latest_before(at(5, 0)).map(|(base, _)| base.id), Some(at(4, 0)));
        assert!(store.latest_before(at(5, 1)).is_none(), "a later one is held");
        store.insert(Sample { id: at(5, 0), ..host(0) });
        assert_eq!((store.ids().len(), store.bytes()), (2, 800));
        store.retire(7, true);
        assert!(store.ids().is_empty());
        store.retire(7, false);
        assert_eq!(store.latest_before(at(8, 1)).map(|(base, _)| base.id), Some(at(5, 1)), "a base stays");
    }

    #[test]
    fn a_version_begins_without_samples_under_its_number_even_if_they_are_in_use() {
        let store = Store::new(1 << 20);
        let at = |version, camera| Sample { id: SampleId { version, camera }, ..host(camera) };
        let _in_use = store.insert(at(3, 0));
        for (version, camera) in [(3, 1), (4, 0)] {
            store.insert(at(version, camera));
        }
        store.begin_version(shown(3));
        assert_eq!(store.ids(), [SampleId { version: 4, camera: 0 }]);
        for number in 0..1000 {
            store.begin_version(shown(number));
        }
        assert_eq!(store.state.lock().shown.len(), MOST_VERSIONS);
    }

    #[test]
    fn a_lost_device_drops_only_samples_without_host_planes() {
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
    fn a_sample_with_fewer_faces_does_not_replace_one_with_more() {
        let store = Store::new(u64::MAX);
        let [front, both] = [1, 0b11].map(|bits| FaceMask::new(bits, "faces").unwrap());
        let with = |faces| Sample { faces, ..host(1) };
        assert_eq!((store.faces(id(1)), store.partial()), (FaceMask::NONE, Vec::new()));
        store.insert(with(both));
        assert_eq!(store.insert(with(front)).faces, both, "the held sample has all faces of the new one");
        assert_eq!((store.faces(id(1)), store.partial()), (both, vec![(id(1), both)]));
        assert!(store.get_with(id(1), front).is_some() && store.get_with(id(1), FaceMask::ALL).is_none());
        store.insert_quietly(host(1));
        assert!(store.get_on_host(id(1), FaceMask::ALL).is_some());
        assert_eq!(store.partial(), Vec::new());
    }
}
