//! Redirects a session's client to the worker that renders its frame.
//!
//! The core plans the view and picks the worker as usual. Then the client gets the order in a sealed ticket for the
//! worker, fetches the frame there, and acknowledges it with the worker's receipt. So the pixels do not pass the
//! coordinator. A client that cannot reach the worker says so. That frame is relayed, and so are those of a pause
//! after it.

use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::v1;
use argus_scene::Stage;
use tokio::time::Instant;
use tracing::debug;

use super::inbox::{ClientNotice, Inbox};
use super::memory::SessionMemory;
use super::shared_core::SharedCore;
use super::tickets::{IssuedRedirect, REDIRECT_TIMEOUT};
use super::view_path::{Event, MOST_MISSES};
use super::view_request::ViewRequest;
use crate::core::Order;

/// First pause of a session's redirects after a worker could not be reached. It doubles with each failure in a row.
const FIRST_PAUSE: Duration = Duration::from_secs(5);

/// Longest pause of a session's redirects.
const LONGEST_PAUSE: Duration = Duration::from_secs(600);

/// The redirects of one session, and their failures.
#[derive(Debug, Default)]
pub(super) struct Redirects {
    /// Number of the newest redirect. It counts all workers, so that a notice identifies its redirect.
    serial: u64,
    /// Failed redirects in a row.
    missed: u32,
    /// Frames in a row that the client acknowledged without a receipt.
    unproven: u32,
    relayed_until: Option<Instant>,
}

impl Redirects {
    /// Issues the redirect of an order. `None` during a pause, if clients cannot reach the worker, or if the client
    /// has too many tickets.
    fn of(&mut self, shared: &SharedCore, request: &ViewRequest, order: &Order) -> Option<IssuedRedirect> {
        if self.relayed_until.is_some_and(|until| Instant::now() < until) {
            return None;
        }
        let scene = shared.service.scene.hash;
        let for_worker = within(&request.span, request.for_worker(shared.term(), scene, order));
        let (client, age) = (&request.client, request.arrived.elapsed());
        let issued = shared.redirect(order.worker, client, for_worker, age, self.serial + 1)?;
        self.serial += 1;
        Some(issued)
    }

    /// Pauses redirects, for twice as long each time.
    fn pause(&mut self) {
        let pause = FIRST_PAUSE.saturating_mul(1 << self.missed.min(16)).min(LONGEST_PAUSE);
        self.missed = self.missed.saturating_add(1);
        self.relayed_until = Some(Instant::now() + pause);
    }

    /// Records an acknowledged frame. One missing receipt is tolerated.
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

/// The client of a session during one view.
pub(super) struct SessionClient<'a> {
    redirects: &'a mut Redirects,
    pub(super) memory: &'a mut SessionMemory,
    inbox: &'a Inbox,
    camera_seq: u64,
    /// Whether the client supports redirects.
    pub(super) redirectable: bool,
    /// The redirects of this view so far; the last one is valid.
    given: Vec<IssuedRedirect>,
    /// When the last redirect times out.
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

    /// Issues a redirect for an order, if possible.
    pub(super) fn ticket(
        &mut self,
        shared: &SharedCore,
        request: &ViewRequest,
        order: &Order,
    ) -> Option<v1::Redirect> {
        // A client that closed its side cannot acknowledge the frame.
        if self.inbox.is_closed() {
            return None;
        }
        let issued = self.redirects.of(shared, request, order)?;
        let redirect = issued.message.clone();
        self.given.push(issued);
        self.until = Instant::now() + REDIRECT_TIMEOUT;
        Some(redirect)
    }

    /// Waits for the client's notice about this view's frame. After [`REDIRECT_TIMEOUT`] without one, the worker
    /// counts as unreachable, so that a silent client holds no place there.
    pub(super) async fn notice(&self, shared: &SharedCore) -> ClientNotice {
        tokio::select! {
            biased;
            notice = self.inbox.notice(self.camera_seq) => notice,
            () = shared.closing.cancelled() => ClientNotice::unreachable("the coordinator is shutting down"),
            () = tokio::time::sleep_until(self.until) => ClientNotice::unreachable("the client did not answer in time"),
        }
    }

    /// Converts a notice to an event of the view. `newest` is an order that the core gave meanwhile.
    pub(super) fn event(
        &mut self,
        notice: ClientNotice,
        request: &ViewRequest,
        newest: Option<Box<Order>>,
    ) -> Event {
        match notice {
            ClientNotice::Arrived(receipt) => {
                // The receipt may belong to an earlier ticket, if the core then chose another worker.
                let returned = receipt.and_then(|receipt| {
                    self.given.iter_mut().rev().find_map(|issued| issued.returned(&receipt))
                });
                self.redirects.arrived(returned.is_some());
                let header = returned.map(|header| Box::new(with_fetch_stage(header, request.age_ms())));
                Event::Fetched { header, newest }
            }
            ClientNotice::Missed(v1::SessionMissed { reason, serial, unreachable }) => {
                debug!(view = request.view_id, reason, unreachable, "a frame was not fetched");
                Event::Missed { ticket: serial, unreachable }
            }
        }
    }

    /// Pauses the session's redirects.
    pub(super) fn pause(&mut self) {
        self.redirects.pause();
    }
}

/// Adds the stage from the worker's header to the client's acknowledgement. `age_ms` is the time since the request.
fn with_fetch_stage(mut header: v1::FrameHeader, age_ms: f64) -> v1::FrameHeader {
    let ms = (age_ms - header.age_ms).max(0.0);
    header.stages.push(v1::Stage { name: Stage::DETOUR.to_owned(), ms });
    header.age_ms = age_ms;
    header
}
