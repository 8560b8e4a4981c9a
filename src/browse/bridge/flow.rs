//! Which camera is asked for next, and which image is sent next: the bridge's rules, without its sockets.

use std::collections::VecDeque;

use argus_scene::{InvalidField, View};
use tokio::time::Instant;

/// Images that are on their way to a page, sent and not acknowledged: one arrives while the next one leaves.
pub(super) const WINDOW: usize = 2;

/// Cameras that may wait for the service's answer. Nearly all of them were replaced by newer ones in the session.
const MAX_ASKED: usize = 4096;

/// The message of an image.
pub(super) struct Image {
    /// The page's number of the camera.
    pub(super) number: u64,
    /// As it is sent.
    pub(super) message: Vec<u8>,
}

/// A page's camera.
struct Camera {
    number: u64,
    view: View,
    /// When the page sent it.
    since: Instant,
}

/// A camera that the service was asked for.
struct Asked {
    camera_seq: u64,
    number: u64,
    since: Instant,
}

/// What a page wants, waits for and has got.
#[derive(Default)]
pub(super) struct Flow {
    /// The page's newest camera.
    newest: Option<Camera>,
    /// Whether the service has not been asked for the newest camera.
    unasked: bool,
    /// Cameras that the service has not answered, oldest first.
    asked: VecDeque<Asked>,
    /// Images that the page has not acknowledged, oldest first.
    unshown: VecDeque<u64>,
    /// An image that waits until the page has room for it.
    made: Option<Image>,
}

impl Flow {
    /// The page's camera moves.
    ///
    /// # Errors
    /// If the number is not above that of the camera before.
    pub(super) fn wants(&mut self, number: u64, view: View, since: Instant) -> Result<(), InvalidField> {
        if let Some(newest) = self.newest.as_ref().filter(|newest| number <= newest.number) {
            let reason = format!("numbers must ascend: {number} came after {}", newest.number);
            return Err(InvalidField::new("camera", reason));
        }
        self.newest = Some(Camera { number, view, since });
        self.unasked = true;
        Ok(())
    }

    /// The view that the service is to be asked for now, if there is one: the newest, and only if the page will have
    /// room for its image. While no image is on its way to the page the session may hold two views, one in work and
    /// one that waits; the one that waits is replaced.
    pub(super) fn to_ask(&self) -> Option<&View> {
        let room = match self.unshown.len() {
            _ if self.made.is_some() => false,
            0 => self.asked.len() < MAX_ASKED,
            1 => self.asked.is_empty(),
            _ => false,
        };
        let newest = self.newest.as_ref().filter(|_| self.unasked && room);
        newest.map(|camera| &camera.view)
    }

    /// The service was asked for the newest camera, under this number of the session.
    pub(super) fn asked(&mut self, camera_seq: u64) {
        if let Some(Camera { number, since, .. }) = self.newest {
            self.asked.push_back(Asked { camera_seq, number, since });
        }
        self.unasked = false;
    }

    /// Whether the service owes an answer.
    pub(super) fn is_waiting(&self) -> bool {
        !self.asked.is_empty()
    }

    /// The service answered a camera, and none before it will be: the page's number of it, and when the page sent it.
    pub(super) fn answered(&mut self, camera_seq: u64) -> Option<(u64, Instant)> {
        let end = self.asked.iter().take_while(|asked| asked.camera_seq <= camera_seq).count();
        let last = self.asked.drain(..end).next_back()?;
        (last.camera_seq == camera_seq).then_some((last.number, last.since))
    }

    /// The session is lost with all that was asked: the newest camera is asked for again, unless it was answered.
    pub(super) fn ask_again(&mut self) {
        self.unasked |= !self.asked.is_empty();
        self.asked.clear();
    }

    /// An image is ready to be sent.
    pub(super) fn made(&mut self, image: Image) {
        self.made = Some(image);
    }

    /// The image that is to be sent now, if there is one and the page has room. It counts as on its way from now on.
    pub(super) fn next_to_send(&mut self) -> Option<Vec<u8>> {
        if self.unshown.len() >= WINDOW {
            return None;
        }
        let image = self.made.take()?;
        self.unshown.push_back(image.number);
        Some(image.message)
    }

    /// The page has shown this image, and needs none of those before it. An image that waited for that is dropped if
    /// the page has a newer camera by now.
    pub(super) fn shown(&mut self, number: u64) {
        self.unshown.retain(|unshown| *unshown > number);
        let unasked = self.unasked;
        self.made.take_if(|_| unasked);
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera as Pose, Outputs, PlanRequest};
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    fn view() -> View {
        let camera = Pose::look_at(DVec3::ONE, DVec3::ZERO);
        View { camera, width: 8, height: 6, outputs: Outputs::COLOR, plan: PlanRequest::default(), pin: None }
    }

    /// A flow with a service that answers when it is told to, as a session does: one view in work, one that waits.
    #[derive(Default)]
    struct Played {
        flow: Flow,
        sent: u64,
        in_work: Option<u64>,
        waits: Option<u64>,
        on_their_way: Vec<Vec<u8>>,
        last_shown: u64,
    }

    impl Played {
        fn settle(&mut self) {
            if self.flow.to_ask().is_some() {
                self.sent += 1;
                self.flow.asked(self.sent);
                self.waits = Some(self.sent);
            }
            self.in_work = self.in_work.or_else(|| self.waits.take());
            self.on_their_way.extend(self.flow.next_to_send());
            assert!(self.on_their_way.len() <= WINDOW, "more images are on their way than fit");
        }

        fn wants(&mut self, number: u64) {
            self.flow.wants(number, view(), Instant::now()).unwrap();
            self.settle();
        }

        /// The service finishes what is in work; the page's number of it.
        fn finishes(&mut self) -> Option<u64> {
            let camera_seq = self.in_work.take()?;
            let (number, _) = self.flow.answered(camera_seq).unwrap();
            self.flow.made(Image { number, message: number.to_le_bytes().to_vec() });
            self.settle();
            Some(number)
        }

        fn shows(&mut self) {
            if !self.on_their_way.is_empty() {
                let image = self.on_their_way.remove(0);
                self.last_shown = u64::from_le_bytes(image.try_into().unwrap());
                self.flow.shown(self.last_shown);
                self.settle();
            }
        }
    }

    #[test]
    fn the_newest_camera_replaces_the_one_that_waits() {
        let mut played = Played::default();
        (1..=5).for_each(|number| played.wants(number));
        assert_eq!(played.finishes(), Some(1));
        assert_eq!(played.finishes(), Some(5));
        assert_eq!(played.finishes(), None);
    }

    #[test]
    fn a_page_that_shows_nothing_is_sent_two_images_and_asks_for_no_third() {
        let mut played = Played::default();
        for number in 1..=20 {
            played.wants(number);
            played.finishes();
        }
        assert_eq!(played.on_their_way.len(), WINDOW);
        assert!(played.in_work.is_none() && played.waits.is_none());
        assert_eq!(played.sent, WINDOW as u64);
        // What it gets once it has shown one is of its newest camera.
        played.shows();
        assert_eq!(played.finishes(), Some(20));
    }

    #[test]
    fn numbers_that_do_not_ascend_are_refused() {
        let mut flow = Flow::default();
        flow.wants(7, view(), Instant::now()).unwrap();
        for number in [7, 6, 0] {
            assert_eq!(flow.wants(number, view(), Instant::now()).unwrap_err().field, "camera");
        }
    }

    #[test]
    fn a_lost_session_asks_for_the_newest_camera_again_and_only_if_it_is_unanswered() {
        let mut played = Played::default();
        played.wants(1);
        played.wants(2);
        played.flow.ask_again();
        assert!(played.flow.to_ask().is_some() && !played.flow.is_waiting());
        let mut answered = Played::default();
        answered.wants(1);
        answered.finishes();
        answered.flow.ask_again();
        assert!(answered.flow.to_ask().is_none());
        // An answer to a camera of the session before means nothing.
        assert!(answered.flow.answered(1).is_none());
    }

    #[test]
    fn a_service_that_answers_nothing_makes_no_bridge_grow() {
        let mut flow = Flow::default();
        for number in 1..=10 * MAX_ASKED as u64 {
            flow.wants(number, view(), Instant::now()).unwrap();
            if flow.to_ask().is_some() {
                flow.asked(number);
            }
        }
        assert_eq!(flow.asked.len(), MAX_ASKED);
    }

    proptest! {
        /// Whatever the order of events, no more than two images are on their way, and the newest camera is shown in
        /// the end.
        #[test]
        fn the_newest_camera_is_shown_in_the_end(steps in prop::collection::vec(0_u8..3, 0..200)) {
            let mut played = Played::default();
            let mut newest = 0;
            for step in steps {
                match step {
                    0 => { newest += 1; played.wants(newest); }
                    1 => { played.finishes(); }
                    _ => played.shows(),
                }
            }
            for _ in 0..4 {
                played.finishes();
                played.shows();
            }
            prop_assert_eq!(played.last_shown, newest);
            prop_assert!(played.flow.to_ask().is_none() && !played.flow.is_waiting());
            prop_assert!(played.flow.made.is_none() && played.on_their_way.is_empty());
        }
    }
}
