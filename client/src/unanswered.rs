//! Cameras of a session that may still be answered.

use std::collections::BTreeMap;

use argus_proto::trace::TARGET;
use argus_scene::View;
use tracing::{Span, debug_span};

/// Cameras that are remembered. A server that says nothing for a while makes no client of a fast camera grow: of older
/// ones it is only known that they were sent.
const MOST: usize = 256;

/// A camera that was sent.
#[derive(Debug)]
pub(crate) struct Camera {
    pub(crate) view: View,
    /// Until its answer, or that of a newer one.
    pub(crate) span: Span,
}

/// Numbers of cameras, and what was asked with the newest of them.
#[derive(Debug, Default)]
pub(crate) struct Unanswered {
    cameras: BTreeMap<u64, Camera>,
    /// The newest one, from 1.
    sent: u64,
    /// The newest one that was answered.
    answered: u64,
    /// How many were.
    settled: u64,
}

impl Unanswered {
    /// A camera is sent; its number, and the span that its answer ends.
    pub(crate) fn send(&mut self, view: View) -> (u64, &Camera) {
        self.sent += 1;
        let camera_seq = self.sent;
        if self.cameras.len() >= MOST {
            self.cameras.pop_first();
        }
        let span = debug_span!(target: TARGET, parent: None, "view", camera = camera_seq);
        (camera_seq, self.cameras.entry(camera_seq).or_insert(Camera { view, span }))
    }

    /// A camera never left: no answer to it will come.
    pub(crate) fn never_left(&mut self, camera_seq: u64) {
        self.cameras.remove(&camera_seq);
    }

    /// What was asked with a camera; `None` also of one that is no longer remembered.
    pub(crate) fn view(&self, camera_seq: u64) -> Option<&View> {
        self.cameras.get(&camera_seq).map(|camera| &camera.view)
    }

    /// The newest camera, unless it was answered.
    pub(crate) fn newest(&self) -> Option<(u64, &Camera)> {
        self.cameras.last_key_value().map(|(camera_seq, camera)| (*camera_seq, camera))
    }

    /// The newest camera that was answered, by a frame or a failure; 0 before the first.
    pub(crate) fn answered(&self) -> u64 {
        self.answered
    }

    /// How many of those before it were not, and will not be.
    pub(crate) fn superseded(&self) -> u64 {
        self.answered - self.settled
    }

    /// Whether the newest camera has been answered.
    pub(crate) fn is_idle(&self) -> bool {
        self.answered == self.sent
    }

    /// Notes the answer to a camera; `false` if a newer one has been answered or it was never sent.
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
    use argus_scene::{Outputs, PlanRequest};
    use glam::DVec3;

    use super::*;

    fn view() -> View {
        let camera = argus_scene::Camera::look_at(DVec3::ONE, DVec3::ZERO);
        View { camera, width: 8, height: 6, outputs: Outputs::COLOR, plan: PlanRequest::default(), pin: None }
    }

    #[test]
    fn a_server_that_answers_nothing_makes_no_session_grow() {
        let mut unanswered = Unanswered::default();
        for camera_seq in 1..=10 * MOST as u64 {
            assert_eq!(unanswered.send(view()).0, camera_seq);
        }
        assert_eq!(unanswered.cameras.len(), MOST);
        // One of those that are forgotten is answered all the same, and makes way for those after it alone.
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
