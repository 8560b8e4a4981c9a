//! A session's client while one of its views is under way, as one that may fetch its frame from a worker itself.
//!
//! The core plans a view and picks its worker as it does for any; then the order goes to the client, as a ticket for the
//! worker, and what comes back is an acknowledgement with the worker's receipt instead of the frame. So a frame's
//! pixels do not pass the coordinator. A client that does not get there says so, and has that frame relayed, and those
//! of a while after.

use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::v1;
use argus_scene::Stage;
use tokio::time::Instant;
use tracing::debug;

use super::shared_core::SharedCore;
use super::inbox::{ClientNotice, Inbox};
use super::memory::SessionMemory;
use super::tickets::{IssuedRedirect, REDIRECT_TIMEOUT};
use super::view_path::{Event, MOST_MISSES};
use super::view_request::ViewRequest;
use crate::core::Order;

/// How long a session's frames are relayed after a worker could not be reached; twice as long each time that happens in a
/// row.
const FIRST_PAUSE: Duration = Duration::from_secs(5);

/// Longest time that a session's frames are relayed after a worker could not be reached.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);

/// Whether a session's client may be sent to workers now.
#[derive(Debug, Default)]
pub(super) struct Redirects {
    /// Of the newest one; whichever worker it leads to, so that no notice about one is taken for one about another.
    serial: u64,
    /// Misses in a row.
    missed: u32,
    /// Frames in a row that the client says it has and brings no receipt of.
    unproven: u32,
    relayed_until: Option<Instant>,
}

impl Redirects {
    /// The redirect of an order; `None` where clients do not reach its worker, where this one did not lately, or where it has
    /// as many tickets out as it may have views in work.
    fn of(&mut self, shared: &SharedCore, request: &ViewRequest, order: &Order) -> Option<IssuedRedirect> {
        if self.relayed_until.is_some_and(|until| Instant::now() < until) {
            return None;
        }
        let for_worker = within(&request.span, request.for_worker(shared.term(), order));
        let (client, age) = (&request.client, request.arrived.elapsed());
        let issued = shared.redirect(order.worker, client, for_worker, age, self.serial + 1)?;
        self.serial += 1;
        Some(issued)
    }

    /// The next frames are relayed, for longer each time.
    fn pause(&mut self) {
        let pause = FIRST_PAUSE.saturating_mul(1 << self.missed.min(16)).min(LONGEST_PAUSE);
        self.missed = self.missed.saturating_add(1);
        self.relayed_until = Some(Instant::now() + pause);
    }

    /// A frame arrived, as far as the client says. A receipt may be lost once.
    fn arrived(&mut self, proven: bool) {
        if proven {
            (self.missed, self.unproven) = (0, 0);
            return;
        }
        self.unproven += 1;
        if self.unproven >= MOST_MISSES {
            self.pause();
        }
    }
}

/// A session's client while one of its views is under way.
pub(super) struct SessionClient<'a> {
    redirects: &'a mut Redirects,
    pub(super) memory: &'a mut SessionMemory,
    inbox: &'a Inbox,
    camera_seq: u64,
    /// Whether it can fetch frames from workers at all.
    pub(super) redirectable: bool,
    /// Those of this view so far; the last one is the one that holds.
    given: Vec<IssuedRedirect>,
    /// When the last one is given up.
    until: Instant,
}

impl<'a> SessionClient<'a> {
    pub(super) fn new(
        redirects: &'a mut Redirects,
        memory: &'a mut SessionMemory,
        inbox: &'a Inbox,
        camera_seq: u64,
        redirectable: bool,
    ) -> Self {
        let until = Instant::now();
        Self { redirects, memory, inbox, camera_seq, redirectable, given: Vec::new(), until }
    }

    /// What to tell the client to have an order's frame fetched, if it can be.
    pub(super) fn ticket(&mut self, shared: &SharedCore, request: &ViewRequest, order: &Order) -> Option<v1::Redirect> {
        // One that says no more could not say that it has its frame.
        if self.inbox.is_closed() {
            return None;
        }
        let issued = self.redirects.of(shared, request, order)?;
        let redirect = issued.message.clone();
        self.given.push(issued);
        self.until = Instant::now() + REDIRECT_TIMEOUT;
        Some(redirect)
    }

    /// What the client says next of this view's frame. One that says nothing for [`REDIRECT_TIMEOUT`] does not reach the worker, so
    /// that it holds no place there by doing nothing.
    pub(super) async fn notice(&self, shared: &SharedCore) -> ClientNotice {
        tokio::select! {
            biased;
            notice = self.inbox.notice(self.camera_seq) => notice,
            () = shared.closing.cancelled() => ClientNotice::unreachable("the coordinator is shutting down"),
            () = tokio::time::sleep_until(self.until) => ClientNotice::unreachable("nothing is heard of the client"),
        }
    }

    /// A notice as what happened to the view. `newest`: the order that the core gave meanwhile.
    pub(super) fn event(
        &mut self,
        notice: ClientNotice,
        request: &ViewRequest,
        newest: Option<Box<Order>>,
    ) -> Event {
        match notice {
            ClientNotice::Arrived(receipt) => {
                // It may have come by an earlier ticket, while another worker was given the view.
                let returned = receipt.and_then(|receipt| {
                    self.given.iter_mut().rev().find_map(|issued| issued.returned(&receipt))
                });
                self.redirects.arrived(returned.is_some());
                let header = returned.map(|header| Box::new(with_the_way(header, request.age_ms())));
                Event::Fetched { header, newest }
            }
            ClientNotice::Missed(v1::SessionMissed { reason, serial, unreachable }) => {
                debug!(view = request.view_id, reason, unreachable, "a frame was not fetched");
                Event::Missed { ticket: serial, unreachable }
            }
        }
    }

    /// The session's next frames are relayed.
    pub(super) fn pause(&mut self) {
        self.redirects.pause();
    }
}

/// A worker's header with what passed until the client had the frame, `age_ms` after its request, and said so.
fn with_the_way(mut header: v1::FrameHeader, age_ms: f64) -> v1::FrameHeader {
    let ms = (age_ms - header.age_ms).max(0.0);
    header.stages.push(v1::Stage { name: Stage::DETOUR.to_owned(), ms });
    header.age_ms = age_ms;
    header
}
