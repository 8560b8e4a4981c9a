//! Depth of sessions' last frames, for reprojection. Keys come from the coordinator; the size is bounded.
//!
//! No frame depends on a history: without one, a search starts from the samples. So the least recently used history
//! is dropped silently, whichever session it belongs to.

use std::collections::HashMap;
use std::sync::Arc;

use argus_scene::History;
use parking_lot::Mutex;

#[derive(Debug)]
struct Entry {
    history: Arc<History>,
    used: u64,
}

#[derive(Debug, Default)]
struct State {
    entries: HashMap<String, Entry>,
    bytes: u64,
    clock: u64,
}

/// Histories by key.
#[derive(Debug)]
pub(super) struct Histories {
    limit: u64,
    state: Mutex<State>,
}

/// Longest accepted key. A coordinator's keys have 32 characters.
pub(super) const MAX_NAME: usize = 64;

impl Histories {
    /// An empty cache of `limit` bytes; 0 keeps no history.
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default() }
    }

    /// The last history under a key, if it is still cached.
    pub(super) fn get(&self, name: &str) -> Option<Arc<History>> {
        let mut state = self.state.lock();
        state.clock += 1;
        let clock = state.clock;
        let entry = state.entries.get_mut(name)?;
        entry.used = clock;
        Some(entry.history.clone())
    }

    /// Caches a history, and replaces the previous one under its key.
    pub(super) fn keep(&self, name: String, history: History) {
        let mut state = self.state.lock();
        state.remove(&name);
        if history.bytes() > self.limit {
            return;
        }
        state.clock += 1;
        state.bytes += history.bytes();
        let entry = Entry { history: Arc::new(history), used: state.clock };
        state.entries.insert(name, entry);
        while state.bytes > self.limit {
            let oldest = state.entries.iter().min_by_key(|(_, entry)| entry.used);
            let Some(name) = oldest.map(|(name, _)| name.clone()) else { break };
            state.remove(&name);
        }
    }

    /// Drops all histories.
    pub(super) fn clear(&self) {
        *self.state.lock() = State::default();
    }
}

impl State {
    fn remove(&mut self, name: &str) {
        if let Some(entry) = self.entries.remove(name) {
            self.bytes -= entry.history.bytes();
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{
        Camera, Frame, Images, Output, Plan, Provenance, SampleId, SceneHash, SceneState, Warp,
    };
    use glam::DVec3;

    use super::*;

    fn history(pixels: usize) -> History {
        let samples = vec![SampleId { version: 0, camera: 0 }];
        let frame = Frame {
            images: Images::from([
                (Output::Range, 2f32.to_le_bytes().repeat(pixels).into()),
                (Output::Source, vec![1; pixels].into()),
            ]),
            ..Frame::without_images(
                pixels as u32,
                1,
                Provenance::of_plan(
                    SceneHash([0; 32]),
                    SceneState::default(),
                    Plan::Warp(Warp { samples, ..Warp::default() }),
                ),
            )
        };
        History::of(&frame, &Camera::look_at(DVec3::ONE, DVec3::ZERO), None).unwrap()
    }

    #[test]
    fn the_least_recently_used_history_is_dropped_first_and_a_key_has_one() {
        let one = history(1000).bytes();
        let histories = Histories::new(2 * one);
        let pixels = |name| histories.get(name).map(|history| history.size()[0]);
        histories.keep("a".to_owned(), history(1000));
        histories.keep("b".to_owned(), history(1000));
        histories.keep("b".to_owned(), history(900));
        assert_eq!(
            (pixels("b"), pixels("a")),
            (Some(900), Some(1000)),
            "one history per key, and a was used last"
        );
        histories.keep("c".to_owned(), history(1000));
        assert_eq!((pixels("a"), pixels("b"), pixels("c")), (Some(1000), None, Some(1000)));
        histories.clear();
        assert_eq!((pixels("a"), pixels("c")), (None, None));
    }

    #[test]
    fn a_history_above_the_limit_is_not_kept_and_drops_its_predecessor() {
        let histories = Histories::new(history(100).bytes());
        histories.keep("a".to_owned(), history(100));
        histories.keep("a".to_owned(), history(101));
        assert!(histories.get("a").is_none(), "an older frame helps less than the samples");
        Histories::new(0).keep("a".to_owned(), history(1));
    }
}
