//! Cameras of a session that may still be answered.

use std::collections::BTreeMap;

use argus_proto::trace::TARGET;
use argus_scene::View;
use tracing::{Span, debug_span};

/// Cameras that are remembered, so that memory is bounded while a server does not answer. Older cameras are only counted.
const MOST: usize = 256;

/// A camera that was sent.
#[derive(Debug)]
pub(crate) struct Camera {
    pub(crate) view: View,
    /// The trace span, open until this camera or a newer one is answered.
    pub(crate) span: Span,
}

/// Numbers of a session's cameras, and the newest views.
#[derive(Debug, Default)]
pub(crate) struct Unanswered {
    cameras: BTreeMap<u64, Camera>,
    /// Number of the newest camera, counted from 1.
    sent: u64,
    /// Number of the newest answered camera.
    answered: u64,
    /// How many cameras were answered.
    settled: u64,
}

impl Unanswered {
    /// Adds a camera. Returns its number and its entry.
    pub(crate) fn send(&mut self, view: View) -> (u64, &Camera) {
        self.sent += 1;
        let camera_seq = self.sent;
        if self.cameras.len() >= MOST {
            self.cameras.pop_first();
        }
        let span = debug_span!(target: TARGET, parent: None, "view", camera = camera_seq);
        (camera_seq, self.cameras.entry(camera_seq).or_insert(Camera { view, span }))
    }

    /// Removes a camera that was never sent.
    pub(crate) fn never_left(&mut self, camera_seq: u64) {
        self.cameras.remove(&camera_seq);
    }

    /// A camera's view; `None` if it was answered or is no longer remembered.
    pub(crate) fn view(&self, camera_seq: u64) -> Option<&View> {
        self.cameras.get(&camera_seq).map(|camera| &camera.view)
    }

    /// The newest camera, unless it was answered.
    pub(crate) fn newest(&self) -> Option<(u64, &Camera)> {
        self.cameras.last_key_value().map(|(camera_seq, camera)| (*camera_seq, camera))
    }

    /// Number of the newest camera that was answered by a frame or a failure; 0 if none.
    pub(crate) fn answered(&self) -> u64 {
        self.answered
    }

    /// Number of older cameras that were superseded.
    pub(crate) fn superseded(&self) -> u64 {
        self.answered - self.settled
    }

    /// Whether the newest camera has been answered.
    pub(crate) fn is_idle(&self) -> bool {
        self.answered == self.sent
    }

    /// Records an answer. `false` if a newer camera was answered before, or if the camera was never sent.
    pub(crate) fn settle(&mut self, camera_seq: u64) -> bool {
        let waits = camera_seq > self.answered && camera_seq <= self.sent;
        if waits {
            self.cameras = self.cameras.split_off(&(camera_seq + 1));
            (self.answered, self.settled) = (camera_seq, self.settled + 1);
        }
        waits
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::PlanRequest;
    use glam::DVec3;

    use super::*;

    fn view() -> View {
        let camera = argus_scene::Camera::look_at(DVec3::ONE, DVec3::ZERO);
        View::new(camera, [8, 6], PlanRequest::default())
    }

    #[test]
    fn memory_is_bounded_while_a_server_does_not_answer() {
        let mut unanswered = Unanswered::default();
        for camera_seq in 1..=10 * MOST as u64 {
            assert_eq!(unanswered.send(view()).0, camera_seq);
        }
        assert_eq!(unanswered.cameras.len(), MOST);
        // A forgotten camera can still be answered, and supersedes only those before it.
        assert!(unanswered.view(7).is_none());
        assert!(unanswered.settle(7) && !unanswered.settle(7) && !unanswered.settle(6));
        assert_eq!(unanswered.superseded(), 6);
        assert_eq!(unanswered.newest().unwrap().0, 10 * MOST as u64);
        assert!(!unanswered.is_idle());
        assert!(!unanswered.settle(10 * MOST as u64 + 1), "it was never sent");
        assert!(unanswered.settle(10 * MOST as u64) && unanswered.is_idle());
        assert!(unanswered.newest().is_none());
        assert_eq!(unanswered.superseded(), 10 * MOST as u64 - 2);
    }
}
