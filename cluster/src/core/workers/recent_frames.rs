//! Direct frames that a worker rendered lately and keeps, from which it can warp other views.
//!
//! The core orders every frame, so it knows them without a report. A worker may have dropped one for lack of memory. It
//! then answers from triangles, and the core forgets the frame.

use std::collections::VecDeque;

use argus_scene::{FrameSource, SceneState};

/// Most frames of a worker that are remembered. A viewer needs the last few; each further one serves another viewer.
const MOST: usize = 32;

/// A direct frame that a worker keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::core) struct RecentFrame {
    /// The frame.
    pub(in crate::core) source: FrameSource,
    /// The state of the scene that it shows.
    pub(in crate::core) state: SceneState,
}

/// The frames of one worker, least recently used first.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct RecentFrames(VecDeque<RecentFrame>);

impl RecentFrames {
    /// Adds a frame. Frames of another state show no view of the scene as it is now, and are forgotten.
    pub(super) fn keep(&mut self, frame: RecentFrame) {
        self.0.retain(|other| other.state == frame.state && other.source != frame.source);
        self.0.push_back(frame);
        if self.0.len() > MOST {
            self.0.pop_front();
        }
    }

    /// Marks frames as used.
    pub(super) fn used(&mut self, sources: &[FrameSource]) {
        let (used, mut others): (VecDeque<_>, VecDeque<_>) =
            self.0.iter().partition(|frame| sources.contains(&frame.source));
        others.extend(used);
        self.0 = others;
    }

    /// Forgets frames.
    pub(super) fn forget(&mut self, sources: &[FrameSource]) {
        self.0.retain(|frame| !sources.contains(&frame.source));
    }

    /// The frames that show a state, most recently used first.
    pub(in crate::core) fn showing(&self, state: SceneState) -> impl Iterator<Item = &FrameSource> {
        self.0.iter().rev().filter(move |frame| frame.state == state).map(|frame| &frame.source)
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::Camera;
    use glam::DVec3;

    use super::*;

    fn source(x: usize) -> FrameSource {
        let camera = Camera::look_at(DVec3::new(x as f64, 0.0, 0.0), DVec3::NEG_Z);
        FrameSource { camera, width: 4, height: 3, samples_per_pixel: 1, band_rows: 0, light: None }
    }

    fn frame(x: usize) -> RecentFrame {
        RecentFrame { source: source(x), state: SceneState::of_epoch(0) }
    }

    fn seen(frames: &RecentFrames, epoch: u64) -> Vec<FrameSource> {
        frames.showing(SceneState::of_epoch(epoch)).copied().collect()
    }

    #[test]
    fn the_least_recently_used_frame_is_forgotten_first() {
        let mut frames = RecentFrames::default();
        (0..MOST).for_each(|x| frames.keep(frame(x)));
        frames.used(&[source(0)]);
        frames.keep(frame(MOST));
        let left = seen(&frames, 0);
        assert_eq!((left.len(), left[0], left[1]), (MOST, source(MOST), source(0)));
        assert!(!left.contains(&source(1)));
    }

    #[test]
    fn a_frame_is_kept_once_and_forgotten_on_demand() {
        let mut frames = RecentFrames::default();
        frames.keep(frame(1));
        frames.keep(frame(2));
        frames.keep(frame(1));
        assert_eq!(seen(&frames, 0), [source(1), source(2)]);
        frames.forget(&[source(1)]);
        assert_eq!(seen(&frames, 0), [source(2)]);
    }

    #[test]
    fn frames_of_another_epoch_show_nothing_of_this_one() {
        let mut frames = RecentFrames::default();
        frames.keep(frame(1));
        assert_eq!(seen(&frames, 1), []);
        frames.keep(RecentFrame { state: SceneState::of_epoch(1), ..frame(2) });
        assert_eq!((seen(&frames, 0), seen(&frames, 1)), (vec![], vec![source(2)]));
    }
}
