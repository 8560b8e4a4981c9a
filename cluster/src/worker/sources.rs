//! Sources: direct frames as samples of other views, bounded by their bytes.
//!
//! A source was rendered for a view and kept, was bought, or came from another worker. The compositor warps it like a sample of a set.
//! Sources have ids of their own, and a set of their own with the backend that rendered them. The coordinator is told of each that is
//! added or dropped. Where a view's sources were dropped everywhere, it is rendered from triangles, if its order allows that. Those of a
//! pinned view are rendered again, with equal bytes.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use argus_scene::{
    CellSettings, Frame, FrameSource, PlaneData, PlaneKind, Sample, SampleId, SampleSetInfo, SceneState,
    SurfaceLight, Version, ViewJob, Visibility,
};
use parking_lot::Mutex;

use crate::core::{HeldSource, SourceNews};
use crate::wire::MOST_ADDED;

/// What a source's bytes are a function of, beside the served scene and its specification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SourceKey {
    pub(super) source: FrameSource,
    pub(super) state: SceneState,
    pub(super) visibility: Visibility,
}

impl SourceKey {
    /// The key of a frame that is warped for a job, or of the direct frame that a job renders.
    pub(super) fn of(source: &FrameSource, job: &ViewJob) -> Self {
        Self { source: *source, state: job.state, visibility: job.visibility }
    }

    /// Id of its sample.
    pub(super) fn id(&self) -> SampleId {
        let Self { source, state, visibility } = self;
        let SceneState { epoch, light, revision } = state;
        let text = format!("{} {epoch} {light} {revision} {}", source.number(), visibility.name());
        let hash = blake3::hash(text.as_bytes());
        let camera = hash.as_bytes()[..8].iter().fold(0, |number, byte| number << 8 | u64::from(*byte));
        SampleId { version: SampleId::FRAMES, camera }
    }

    /// The keys that it may stand for: one for each light if it names none.
    pub(super) fn with_lights(self) -> impl Iterator<Item = Self> {
        let cells = [true, false]
            .into_iter()
            .flat_map(|reflected| CellSettings::RAYS.map(|rays| SurfaceLight::Cells { rays, reflected }));
        let lights: Vec<Option<SurfaceLight>> = match self.source.light {
            None => [None, Some(SurfaceLight::Rays)].into_iter().chain(cells.map(Some)).collect(),
            light => vec![light],
        };
        lights.into_iter().map(move |light| Self { source: FrameSource { light, ..self.source }, ..self })
    }

    /// Whether a held source is meant. A key without light and bands means any.
    fn means(&self, held: &Self) -> bool {
        let mut source = held.source;
        if self.source.light.is_none() {
            source.light = None;
            source.band_rows = if self.source.band_rows == 0 { 0 } else { source.band_rows };
        }
        Self { source, ..*held } == *self
    }
}

/// Where a source came from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Origin {
    /// It was rendered for the cluster.
    pub(super) bought: bool,
    /// Milliseconds of rendering it here.
    pub(super) render_ms: f64,
}

#[derive(Debug)]
struct Entry {
    key: SourceKey,
    sample: Arc<Sample>,
    ranges: Arc<[f32]>,
    origin: Origin,
    used: u64,
}

#[derive(Debug, Default)]
struct State {
    entries: HashMap<SampleId, Entry>,
    /// The sets of the sources that are held.
    sets: Vec<Arc<SampleSetInfo>>,
    bytes: u64,
    clock: u64,
    /// What the coordinator is not told yet.
    is_whole: bool,
    added: BTreeSet<SampleId>,
    dropped: Vec<SampleId>,
}

/// The held sources.
#[derive(Debug)]
pub(super) struct SourceStore {
    limit: u64,
    state: Mutex<State>,
}

/// Most sets that are kept: those of the light levels and epochs of views in work.
const MOST_SETS: usize = 8;

impl SourceStore {
    /// An empty store of at most `limit` bytes; 0 keeps nothing.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default() }
    }

    /// Whether a frame of this size would be kept.
    pub(super) fn has_room_for(&self, source: &FrameSource) -> bool {
        source.bytes() <= self.limit
    }

    /// Whether a source is held. A key without light and bands means any.
    pub(super) fn holds(&self, key: &SourceKey) -> bool {
        self.state.lock().entries.values().any(|entry| key.means(&entry.key))
    }

    /// A source that is held, with its light and bands, and its sample. Of several that the key means, it is the one that was used last.
    /// Marks it as used.
    pub(super) fn get(&self, key: &SourceKey) -> Option<(FrameSource, Arc<Sample>)> {
        let mut state = self.state.lock();
        state.clock += 1;
        let clock = state.clock;
        let found = state.entries.values_mut().filter(|entry| key.means(&entry.key));
        let entry = found.max_by_key(|entry| entry.used)?;
        entry.used = clock;
        Some((entry.key.source, entry.sample.clone()))
    }

    /// The sample of a source. Marks it as used.
    pub(super) fn sample(&self, id: SampleId) -> Option<Arc<Sample>> {
        let mut state = self.state.lock();
        state.clock += 1;
        let clock = state.clock;
        let entry = state.entries.get_mut(&id)?;
        entry.used = clock;
        Some(entry.sample.clone())
    }

    /// Keeps a frame. Returns its sample; `None` if the frame lacks colour or range.
    pub(super) fn keep(&self, key: SourceKey, frame: &Frame, origin: Origin) -> Option<Arc<Sample>> {
        let sample = Arc::new(Sample { id: key.id(), ..key.source.sample(frame)? });
        self.keep_sample(key, sample.clone(), origin);
        Some(sample)
    }

    /// Keeps a source as its sample, and drops the least recently used ones beyond the limit.
    pub(super) fn keep_sample(&self, key: SourceKey, sample: Arc<Sample>, origin: Origin) {
        let (id, bytes) = (sample.id, key.source.bytes());
        let ranges = ranges(&key.source, &sample);
        let mut state = self.state.lock();
        state.remove(id);
        if bytes > self.limit {
            return;
        }
        state.clock += 1;
        state.bytes += bytes;
        let entry = Entry { key, sample, ranges, origin, used: state.clock };
        state.entries.insert(id, entry);
        state.dropped.retain(|dropped| *dropped != id);
        state.added.insert(id);
        while state.bytes > self.limit {
            let oldest = state.entries.iter().min_by_key(|(_, entry)| entry.used);
            let Some(id) = oldest.map(|(id, _)| *id) else { break };
            state.remove(id);
        }
    }

    /// Number of held sources, and their bytes.
    pub(super) fn held(&self) -> (usize, u64) {
        let state = self.state.lock();
        (state.entries.len(), state.bytes)
    }

    /// Drops all sources.
    pub(super) fn clear(&self) {
        let mut state = self.state.lock();
        let ids: Vec<SampleId> = state.entries.keys().copied().collect();
        ids.into_iter().for_each(|id| state.remove(id));
        state.sets.clear();
    }

    /// Has all that is held reported anew: a coordinator was joined.
    pub(super) fn report_all(&self) {
        let mut state = self.state.lock();
        state.added = state.entries.keys().copied().collect();
        (state.is_whole, state.dropped) = (true, Vec::new());
    }

    /// Takes what the coordinator is not told yet, as much as one report holds; `None` if there is none.
    pub(super) fn take_news(&self) -> Option<SourceNews> {
        let mut state = self.state.lock();
        if !(state.is_whole || state.has_news()) {
            return None;
        }
        let ids: Vec<SampleId> = state.added.iter().copied().take(MOST_ADDED).collect();
        state.added.retain(|id| ids.binary_search(id).is_err());
        Some(SourceNews {
            whole: std::mem::take(&mut state.is_whole),
            added: ids.iter().filter_map(|id| Some(state.entries.get(id)?.held(*id))).collect(),
            dropped: std::mem::take(&mut state.dropped),
        })
    }

    /// Whether the coordinator is to be told of sources at once.
    pub(super) fn has_news(&self) -> bool {
        self.state.lock().has_news()
    }

    /// The set of sources that show a state of the served set: the same `Arc` for equal sets.
    pub(super) fn set_of(&self, info: &SampleSetInfo, visibility: Visibility) -> Arc<SampleSetInfo> {
        let set = set_of_sources(info, visibility);
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
    fn has_news(&self) -> bool {
        !(self.added.is_empty() && self.dropped.is_empty())
    }

    fn remove(&mut self, id: SampleId) {
        let Some(entry) = self.entries.remove(&id) else { return };
        self.bytes -= entry.key.source.bytes();
        if !self.added.remove(&id) {
            self.dropped.push(id);
        }
    }
}

impl Entry {
    fn held(&self, id: SampleId) -> HeldSource {
        let Self { key: SourceKey { source, state, visibility }, ranges, origin, .. } = self;
        HeldSource {
            id,
            source: *source,
            state: *state,
            visibility: *visibility,
            ranges: ranges.clone(),
            bought: origin.bought,
            render_ms: origin.render_ms as f32,
        }
    }
}

/// Inverse ranges of a source at the points of [`FrameSource::GRID`], 1/m; 0 for sky.
fn ranges(source: &FrameSource, sample: &Sample) -> Arc<[f32]> {
    let [columns, rows] = FrameSource::GRID;
    let texels = match sample.plane(PlaneKind::InverseRange).map(|plane| &plane.data) {
        Some(PlaneData::Host(bytes)) => bytes.as_chunks::<4>().0,
        _ => &[],
    };
    let middle = |point: u32, points: u32, size: u32| {
        (u64::from(2 * point + 1) * u64::from(size) / u64::from(2 * points)) as usize
    };
    let range = |point: u32| {
        let x = middle(point % columns, columns, source.width);
        let y = middle(point / columns, rows, source.height);
        texels.get(y * source.width as usize + x).map_or(0.0, |bytes| f32::from_le_bytes(*bytes))
    };
    (0..columns * rows).map(range).collect()
}

/// The set of sources that show the state of a set and were rendered by a backend.
pub(super) fn set_of_sources(info: &SampleSetInfo, visibility: Visibility) -> SampleSetInfo {
    let version = Version { number: SampleId::FRAMES, ..info.version };
    SampleSetInfo { version, visibility, ..info.clone() }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Images, Output, Plan, Provenance, SceneHash};
    use glam::DVec3;

    use super::*;

    const SIZE: [u32; 2] = [8, 6];
    const KEPT: Origin = Origin { bought: false, render_ms: 7.0 };

    fn key(x: f64) -> SourceKey {
        let camera = Camera::look_at(DVec3::new(x, 0.0, 0.0), DVec3::NEG_Z);
        let [width, height] = SIZE;
        let source = FrameSource { camera, width, height, samples_per_pixel: 1, band_rows: 0, light: None };
        SourceKey { source, state: SceneState::default(), visibility: Visibility::default() }
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
        let store = SourceStore::new(2 * key(0.0).source.bytes());
        for x in [0.0, 1.0] {
            store.keep(key(x), &frame(), KEPT).unwrap();
        }
        assert!(store.get(&key(0.0)).is_some());
        store.keep(key(2.0), &frame(), KEPT).unwrap();
        let held = [0.0, 1.0, 2.0].map(|x| store.get(&key(x)).is_some());
        assert_eq!((held, store.held()), ([true, false, true], (2, 2 * key(0.0).source.bytes())));
        store.clear();
        assert_eq!(store.held(), (0, 0));
    }

    #[test]
    fn a_frame_beyond_the_limit_is_used_and_not_kept() {
        let store = SourceStore::new(key(0.0).source.bytes() - 1);
        assert!(!store.has_room_for(&key(0.0).source));
        assert!(store.keep(key(0.0), &frame(), KEPT).is_some() && store.get(&key(0.0)).is_none());
        assert_eq!(store.held(), (0, 0));
    }

    #[test]
    fn a_frame_of_another_state_or_backend_is_another_frame() {
        let store = SourceStore::new(1 << 20);
        store.keep(key(0.0), &frame(), KEPT).unwrap();
        let later = SourceKey { state: SceneState::of_epoch(1), ..key(0.0) };
        let other = Visibility::ALL.into_iter().find(|backend| *backend != Visibility::default()).unwrap();
        let otherwise = SourceKey { visibility: other, ..key(0.0) };
        assert!(store.get(&later).is_none() && store.get(&otherwise).is_none());
        assert!(later.id() != key(0.0).id() && otherwise.id() != key(0.0).id());
    }

    #[test]
    fn a_key_without_light_and_bands_means_any() {
        let store = SourceStore::new(1 << 20);
        let of = |light, band_rows| {
            let source = FrameSource { light, band_rows, ..key(0.0).source };
            SourceKey { source, ..key(0.0) }
        };
        let cells = Some(SurfaceLight::Cells { rays: 16, reflected: true });
        store.keep(of(cells, 2), &frame(), KEPT).unwrap();
        assert!(store.holds(&of(None, 0)) && store.holds(&of(None, 2)) && store.holds(&of(cells, 2)));
        assert!(!store.holds(&of(None, 3)) && !store.holds(&of(cells, 0)));
        assert!(!store.holds(&of(Some(SurfaceLight::Rays), 2)));
        assert_eq!(store.get(&of(None, 0)).unwrap().0, of(cells, 2).source);
        assert!(of(None, 2).with_lights().any(|key| key.id() == of(cells, 2).id()));
        assert_eq!(of(cells, 2).with_lights().count(), 1);
    }

    #[test]
    fn each_source_is_reported_once_when_it_comes_and_when_it_goes() {
        let store = SourceStore::new(2 * key(0.0).source.bytes());
        assert_eq!(store.take_news(), None);
        let ids = |news: &SourceNews| news.added.iter().map(|held| held.id).collect::<Vec<_>>();
        store.keep(key(0.0), &frame(), Origin { bought: true, render_ms: 9.0 }).unwrap();
        let news = store.take_news().unwrap();
        assert_eq!((ids(&news), news.whole, news.dropped.len()), (vec![key(0.0).id()], false, 0));
        let held = &news.added[0];
        assert_eq!((held.source, held.bought, held.render_ms), (key(0.0).source, true, 9.0));
        assert_eq!(held.ranges[..], [0.5; 108]);
        assert_eq!((store.take_news(), store.has_news()), (None, false));
        // Of two that come, one goes before anybody was told of it.
        for x in [1.0, 2.0, 3.0] {
            store.keep(key(x), &frame(), KEPT).unwrap();
        }
        assert!(store.has_news());
        let news = store.take_news().unwrap();
        assert_eq!((ids(&news).len(), news.dropped), (2, vec![key(0.0).id()]));
        store.clear();
        assert_eq!(store.take_news().unwrap().dropped.len(), 2);
    }

    #[test]
    fn a_worker_that_joins_again_reports_all_that_it_holds() {
        let store = SourceStore::new(u64::MAX);
        (0..1500).for_each(|x| drop(store.keep(key(f64::from(x) - 2000.0), &frame(), KEPT).unwrap()));
        while store.has_news() {
            store.take_news();
        }
        store.report_all();
        let (first, second) = (store.take_news().unwrap(), store.take_news().unwrap());
        assert_eq!((first.whole, first.added.len()), (true, MOST_ADDED));
        assert_eq!((second.whole, second.added.len()), (false, 1500 - MOST_ADDED));
        assert_eq!(store.take_news(), None);
        store.clear();
        store.report_all();
        let none = SourceNews { whole: true, ..SourceNews::default() };
        assert_eq!(store.take_news(), Some(none), "the coordinator forgets what it knew");
    }

    #[test]
    fn ranges_are_those_of_the_texels_in_the_middle_of_the_grid() {
        let source = FrameSource { width: 24, height: 18, ..key(0.0).source };
        let texels: Vec<u8> = (0..24 * 18).flat_map(|texel| (texel as f32).to_le_bytes()).collect();
        let plane = argus_scene::Plane {
            kind: PlaneKind::InverseRange,
            format: argus_scene::PlaneFormat::R32Float,
            size: [24, 18],
            data: PlaneData::Host(texels.into()),
        };
        let sample = Sample {
            id: source.id(),
            camera: source.sample_camera(),
            faces: argus_scene::FaceMask::ALL,
            planes: vec![plane],
            stages: Vec::new(),
        };
        let ranges = ranges(&source, &sample);
        assert_eq!((ranges[0], ranges[1], ranges[12]), (25.0, 27.0, 73.0));
        assert_eq!(ranges[107], (17 * 24 + 23) as f32);
    }
}
