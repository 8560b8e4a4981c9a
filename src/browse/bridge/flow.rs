//! Flow control of a bridge: which camera to request next and which image to send next, without I/O.

use std::collections::VecDeque;

use argus_scene::{InvalidField, View};
use tokio::time::Instant;

use super::super::messages::Form;

/// Largest number of unacknowledged images in flight to a page: one arrives while the next is sent.
pub(super) const WINDOW: usize = 2;

/// Largest number of cameras that wait for an answer. Newer ones have superseded nearly all of them.
const MAX_ASKED: usize = 4096;

/// An encoded image message.
pub(super) struct Image {
    /// The page's number of the camera.
    pub(super) number: u64,
    /// The message's bytes.
    pub(super) message: Vec<u8>,
}

/// The camera of a page.
struct Camera {
    number: u64,
    view: View,
    form: Form,
    /// When the page sent it.
    since: Instant,
}

/// A camera that was requested from the service.
struct Request {
    camera_seq: u64,
    asked: Asked,
}

/// What is known of a camera when its answer comes.
#[derive(Clone, Copy)]
pub(super) struct Asked {
    /// The page's number of it.
    pub(super) number: u64,
    /// When the page sent it.
    pub(super) since: Instant,
    /// Its pose.
    pub(super) camera: argus_scene::Camera,
    /// How its image is to be encoded.
    pub(super) form: Form,
    /// Whether its image has a deadline.
    soon: bool,
}

/// State of a page's cameras and images.
#[derive(Default)]
pub(super) struct Flow {
    /// The page's newest camera.
    newest: Option<Camera>,
    /// Whether the newest camera was not requested yet.
    unasked: bool,
    /// Cameras without an answer, oldest first.
    asked: VecDeque<Request>,
    /// Images that the page has not acknowledged, oldest first.
    unshown: VecDeque<u64>,
    /// An image that waits until the page has capacity.
    made: Option<Image>,
}

impl Flow {
    /// Sets the page's newest camera.
    ///
    /// # Errors
    /// The number is not above that of the previous camera.
    pub(super) fn wants(
        &mut self,
        number: u64,
        view: View,
        form: Form,
        since: Instant,
    ) -> Result<(), InvalidField> {
        if let Some(newest) = self.newest.as_ref().filter(|newest| number <= newest.number) {
            let reason = format!("numbers must ascend: {number} came after {}", newest.number);
            return Err(InvalidField::new("camera", reason));
        }
        self.newest = Some(Camera { number, view, form, since });
        self.unasked = true;
        Ok(())
    }

    /// The view to request now, if any: the newest one, and only if the page will have capacity for its image. While
    /// no image is in flight, the session may hold two views: one in work and one that waits and may be replaced.
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

    /// Whether the newest camera is in a hurry, and one that is not is in work before it: a viewer who rested moves again.
    pub(super) fn is_held_up(&self) -> bool {
        let newest = self.newest.as_ref().filter(|_| self.unasked);
        newest.is_some_and(|camera| is_soon(&camera.view))
            && self.asked.iter().any(|request| !request.asked.soon)
    }

    /// Records that the newest camera was requested, under this number of the session.
    pub(super) fn asked(&mut self, camera_seq: u64) {
        if let Some(Camera { number, view, form, since }) = &self.newest {
            let asked = Asked {
                number: *number,
                since: *since,
                camera: view.camera,
                form: *form,
                soon: is_soon(view),
            };
            self.asked.push_back(Request { camera_seq, asked });
        }
        self.unasked = false;
    }

    /// Whether an answer is due from the service.
    pub(super) fn is_waiting(&self) -> bool {
        !self.asked.is_empty()
    }

    /// Records an answer; earlier cameras will not be answered. Returns what was asked.
    pub(super) fn answered(&mut self, camera_seq: u64) -> Option<Asked> {
        let end = self.asked.iter().take_while(|asked| asked.camera_seq <= camera_seq).count();
        let last = self.asked.drain(..end).next_back()?;
        (last.camera_seq == camera_seq).then_some(last.asked)
    }

    /// Records the loss of the session. The newest camera is requested again unless it was answered.
    pub(super) fn ask_again(&mut self) {
        self.unasked |= !self.asked.is_empty();
        self.asked.clear();
    }

    /// Stores an encoded image.
    pub(super) fn made(&mut self, image: Image) {
        self.made = Some(image);
    }

    /// The image to send now, if there is one and the page has capacity. It then counts as in flight.
    pub(super) fn next_to_send(&mut self) -> Option<Vec<u8>> {
        if self.unshown.len() >= WINDOW {
            return None;
        }
        let image = self.made.take()?;
        self.unshown.push_back(image.number);
        Some(image.message)
    }

    /// Records that the page has shown this image and needs no earlier one. A waiting image is dropped if the page
    /// has a newer camera.
    pub(super) fn shown(&mut self, number: u64) {
        self.unshown.retain(|unshown| *unshown > number);
        let unasked = self.unasked;
        self.made.take_if(|_| unasked);
    }
}

fn is_soon(view: &View) -> bool {
    view.plan.deadline_ms.is_some()
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera as Pose, PlanRequest};
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    fn view() -> View {
        let camera = Pose::look_at(DVec3::ONE, DVec3::ZERO);
        View::new(camera, [8, 6], PlanRequest::default())
    }

    /// A flow and a simulated service with one view in work and one that waits, as in a session.
    #[derive(Default)]
    struct SimulatedService {
        flow: Flow,
        sent: u64,
        in_work: Option<u64>,
        waits: Option<u64>,
        on_their_way: Vec<Vec<u8>>,
        last_shown: u64,
    }

    impl SimulatedService {
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
            self.flow.wants(number, view(), Form::default(), Instant::now()).unwrap();
            self.settle();
        }

        /// Finishes the view in work. Returns the page's number of it.
        fn finishes(&mut self) -> Option<u64> {
            let camera_seq = self.in_work.take()?;
            let number = self.flow.answered(camera_seq).unwrap().number;
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
        let mut service = SimulatedService::default();
        (1..=5).for_each(|number| service.wants(number));
        assert_eq!(service.finishes(), Some(1));
        assert_eq!(service.finishes(), Some(5));
        assert_eq!(service.finishes(), None);
    }

    #[test]
    fn a_page_that_shows_nothing_gets_two_images_and_no_third_request() {
        let mut service = SimulatedService::default();
        for number in 1..=20 {
            service.wants(number);
            service.finishes();
        }
        assert_eq!(service.on_their_way.len(), WINDOW);
        assert!(service.in_work.is_none() && service.waits.is_none());
        assert_eq!(service.sent, WINDOW as u64);
        // After showing one image, it gets one of its newest camera.
        service.shows();
        assert_eq!(service.finishes(), Some(20));
    }

    #[test]
    fn numbers_that_do_not_ascend_are_rejected() {
        let mut flow = Flow::default();
        flow.wants(7, view(), Form::default(), Instant::now()).unwrap();
        for number in [7, 6, 0] {
            assert_eq!(
                flow.wants(number, view(), Form::default(), Instant::now()).unwrap_err().field,
                "camera"
            );
        }
    }

    #[test]
    fn a_lost_session_requests_the_newest_camera_again_only_if_it_is_unanswered() {
        let mut service = SimulatedService::default();
        service.wants(1);
        service.wants(2);
        service.flow.ask_again();
        assert!(service.flow.to_ask().is_some() && !service.flow.is_waiting());
        let mut answered = SimulatedService::default();
        answered.wants(1);
        answered.finishes();
        answered.flow.ask_again();
        assert!(answered.flow.to_ask().is_none());
        // An answer from the previous session is ignored.
        assert!(answered.flow.answered(1).is_none());
    }

    #[test]
    fn a_camera_with_a_deadline_is_held_up_by_one_without() {
        let soon = View { plan: PlanRequest { deadline_ms: Some(80.0), ..PlanRequest::default() }, ..view() };
        let mut flow = Flow::default();
        let wants = |flow: &mut Flow, number, view: &View| {
            flow.wants(number, view.clone(), Form::default(), Instant::now()).unwrap();
            let held_up = flow.is_held_up();
            flow.asked(number);
            held_up
        };
        assert!(!wants(&mut flow, 1, &soon));
        assert!(!wants(&mut flow, 2, &soon));
        assert!(!wants(&mut flow, 3, &view()));
        assert!(wants(&mut flow, 4, &soon));
        flow.ask_again();
        flow.asked(5);
        assert!(!wants(&mut flow, 6, &soon));
    }

    #[test]
    fn memory_is_bounded_while_the_service_does_not_answer() {
        let mut flow = Flow::default();
        for number in 1..=10 * MAX_ASKED as u64 {
            flow.wants(number, view(), Form::default(), Instant::now()).unwrap();
            if flow.to_ask().is_some() {
                flow.asked(number);
            }
        }
        assert_eq!(flow.asked.len(), MAX_ASKED);
    }

    proptest! {
        /// In any order of events, at most two images are in flight, and the newest camera is shown at the end.
        #[test]
        fn the_newest_camera_is_shown_in_the_end(steps in prop::collection::vec(0_u8..3, 0..200)) {
            let mut service = SimulatedService::default();
            let mut newest = 0;
            for step in steps {
                match step {
                    0 => { newest += 1; service.wants(newest); }
                    1 => { service.finishes(); }
                    _ => service.shows(),
                }
            }
            for _ in 0..4 {
                service.finishes();
                service.shows();
            }
            prop_assert_eq!(service.last_shown, newest);
            prop_assert!(service.flow.to_ask().is_none() && !service.flow.is_waiting());
            prop_assert!(service.flow.made.is_none() && service.on_their_way.is_empty());
        }
    }
}
