//! Direct frames that this worker rendered lately, as samples of other views; bounded by their bytes.
//!
//! The compositor warps them like samples of a set. They have ids of their own, and a set of their own with the backend
//! that rendered them. A view whose frames were dropped is rendered from triangles, if its order allows that. The frames
//! of a pinned view are rendered again, with equal bytes.

use std::collections::HashMap;
use std::sync::Arc;

use argus_scene::{
    Frame, FrameSource, Sample, SampleId, SampleSetInfo, SceneState, Version, ViewJob, Visibility,
};
use parking_lot::Mutex;

/// What a frame's bytes are a function of, beside the served scene and its specification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameKey {
    pub(super) source: FrameSource,
    pub(super) state: SceneState,
    pub(super) visibility: Visibility,
}

impl FrameKey {
    /// The key of a frame that is warped for a job, or of the direct frame that a job renders.
    pub(super) fn of(source: &FrameSource, job: &ViewJob) -> Self {
        Self { source: *source, state: job.state, visibility: job.visibility }
    }

    /// Id of its sample.
    fn id(&self) -> SampleId {
        let Self { source, state, visibility } = self;
        let text = format!("{} {} {} {}", source.number(), state.epoch, state.light, visibility.name());
        let hash = blake3::hash(text.as_bytes());
        let camera = hash.as_bytes()[..8].iter().fold(0, |number, byte| number << 8 | u64::from(*byte));
        SampleId { version: SampleId::FRAMES, camera }
    }
}

#[derive(Debug)]
struct Entry {
    key: FrameKey,
    sample: Arc<Sample>,
    used: u64,
}

#[derive(Debug, Default)]
struct State {
    entries: HashMap<SampleId, Entry>,
    /// The sets of the frames that are held.
    sets: Vec<Arc<SampleSetInfo>>,
    bytes: u64,
    clock: u64,
}

/// The held frames.
#[derive(Debug)]
pub(super) struct FrameStore {
    limit: u64,
    state: Mutex<State>,
}

/// Most sets that are kept: those of the light levels and epochs of views in work.
const MOST_SETS: usize = 8;

impl FrameStore {
    /// An empty store of at most `limit` bytes; 0 keeps no frame.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default() }
    }

    /// Whether a frame of this size would be kept.
    pub(super) fn has_room_for(&self, source: &FrameSource) -> bool {
        source.bytes() <= self.limit
    }

    /// A frame that is held, with its light, and its sample. A key that names no light takes the frame that was used last,
    /// whatever its light. Marks it as used.
    pub(super) fn get(&self, key: &FrameKey) -> Option<(FrameSource, Arc<Sample>)> {
        let mut state = self.state.lock();
        state.clock += 1;
        let (clock, open) = (state.clock, key.source.light.is_none());
        let is_it = |entry: &Entry| {
            let light = if open { None } else { entry.key.source.light };
            FrameKey { source: FrameSource { light, ..entry.key.source }, ..entry.key } == *key
        };
        let found = state.entries.values_mut().filter(|entry| is_it(entry)).max_by_key(|entry| entry.used);
        let entry = found?;
        entry.used = clock;
        Some((entry.key.source, entry.sample.clone()))
    }

    /// Keeps a frame, and drops the least recently used ones beyond the limit. Returns its sample; `None` if the frame
    /// lacks colour or range.
    pub(super) fn keep(&self, key: FrameKey, frame: &Frame) -> Option<Arc<Sample>> {
        let id = key.id();
        let sample = Arc::new(Sample { id, ..key.source.sample(frame)? });
        let bytes = key.source.bytes();
        let mut state = self.state.lock();
        state.remove(id);
        if bytes > self.limit {
            return Some(sample);
        }
        state.clock += 1;
        state.bytes += bytes;
        let entry = Entry { key, sample: sample.clone(), used: state.clock };
        state.entries.insert(id, entry);
        while state.bytes > self.limit {
            let oldest = state.entries.iter().min_by_key(|(_, entry)| entry.used);
            let Some(id) = oldest.map(|(id, _)| *id) else { break };
            state.remove(id);
        }
        Some(sample)
    }

    /// Number of held frames, and their bytes.
    pub(super) fn held(&self) -> (usize, u64) {
        let state = self.state.lock();
        (state.entries.len(), state.bytes)
    }

    /// Drops all frames.
    pub(super) fn clear(&self) {
        *self.state.lock() = State::default();
    }

    /// The set of frames that show a state of the served set: the same `Arc` for equal sets.
    pub(super) fn set_of(&self, info: &SampleSetInfo, visibility: Visibility) -> Arc<SampleSetInfo> {
        let set = set_of_frames(info, visibility);
        let mut state = self.state.lock();
        if let Some(same) = state.sets.iter().find(|same| ***same == set) {
            return same.clone();
        }
        let set = Arc::new(set);
        if state.sets.len() == MOST_SETS {
            state.sets.remove(0);
        }
        state.sets.push(set.clone());
        set
    }
}

impl State {
    fn remove(&mut self, id: SampleId) {
        if let Some(entry) = self.entries.remove(&id) {
            self.bytes -= entry.key.source.bytes();
        }
    }
}

/// The set of frames that show the state of a set and were rendered by a backend.
pub(super) fn set_of_frames(info: &SampleSetInfo, visibility: Visibility) -> SampleSetInfo {
    let version = Version { number: SampleId::FRAMES, ..info.version };
    SampleSetInfo { version, visibility, ..info.clone() }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Images, Output, Plan, Provenance, SceneHash};
    use glam::DVec3;

    use super::*;

    const SIZE: [u32; 2] = [8, 6];

    fn key(x: f64) -> FrameKey {
        let camera = Camera::look_at(DVec3::new(x, 0.0, 0.0), DVec3::NEG_Z);
        let [width, height] = SIZE;
        let source = FrameSource { camera, width, height, samples_per_pixel: 1, band_rows: 0, light: None };
        FrameKey { source, state: SceneState::default(), visibility: Visibility::default() }
    }

    fn frame() -> Frame {
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        Frame {
            images: Images::from([
                (Output::Color, vec![9; 3 * pixels].into()),
                (Output::Range, 2f32.to_le_bytes().repeat(pixels).into()),
            ]),
            ..Frame::without_images(
                SIZE[0],
                SIZE[1],
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::direct(1)),
            )
        }
    }

    #[test]
    fn the_least_recently_used_frame_is_dropped_first() {
        let store = FrameStore::new(2 * key(0.0).source.bytes());
        for x in [0.0, 1.0] {
            store.keep(key(x), &frame()).unwrap();
        }
        assert!(store.get(&key(0.0)).is_some());
        store.keep(key(2.0), &frame()).unwrap();
        let held = [0.0, 1.0, 2.0].map(|x| store.get(&key(x)).is_some());
        assert_eq!((held, store.held()), ([true, false, true], (2, 2 * key(0.0).source.bytes())));
        store.clear();
        assert_eq!(store.held(), (0, 0));
    }

    #[test]
    fn a_frame_beyond_the_limit_is_used_and_not_kept() {
        let store = FrameStore::new(key(0.0).source.bytes() - 1);
        assert!(!store.has_room_for(&key(0.0).source));
        assert!(store.keep(key(0.0), &frame()).is_some() && store.get(&key(0.0)).is_none());
        assert_eq!(store.held(), (0, 0));
    }

    #[test]
    fn a_frame_of_another_state_or_backend_is_another_frame() {
        let store = FrameStore::new(1 << 20);
        store.keep(key(0.0), &frame()).unwrap();
        let later = FrameKey { state: SceneState::of_epoch(1), ..key(0.0) };
        let other = Visibility::ALL.into_iter().find(|backend| *backend != Visibility::default()).unwrap();
        let otherwise = FrameKey { visibility: other, ..key(0.0) };
        assert!(store.get(&later).is_none() && store.get(&otherwise).is_none());
        assert!(later.id() != key(0.0).id() && otherwise.id() != key(0.0).id());
    }
}
