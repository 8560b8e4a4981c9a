//! A view of a session whose frame the client fetches from the worker itself.
//!
//! The core plans it and picks its worker as it does for any view; then the order goes to the client, as a ticket for the
//! worker, and what comes back is an acknowledgement with the worker's receipt instead of the frame. So a frame's
//! pixels do not pass the coordinator. A client that does not get there says so, and has that frame relayed, and those
//! of a while after.

use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::{Fault, v1};
use argus_scene::Stage;
use futures::FutureExt;
use tokio::time::Instant;
use tracing::debug;

use super::hub::{Asked, Detour, Hub};
use super::relay::{Wanted, arrived, ordered, request};
use crate::core::Order;

/// How long a session's frames are relayed after a worker could not be reached; twice as long each time that happens in a
/// row.
const FIRST_REST: Duration = Duration::from_secs(5);

/// … at most.
const LONGEST_REST: Duration = Duration::from_secs(600);

/// A client that says nothing for this long of a frame that it was sent for has that frame relayed, and the next ones, so
/// that it holds no place at a worker by doing nothing.
const UNHEARD: Duration = Duration::from_secs(120);

/// Whether a session's client may be sent elsewhere now.
#[derive(Debug, Default)]
pub(super) struct Detours {
    /// Misses in a row.
    missed: u32,
    relayed_until: Option<Instant>,
}

impl Detours {
    /// The detour of an order; `None` where its frame is to be looked at before it is delivered, where clients do not reach
    /// its worker, or where this one did not lately.
    pub(super) fn of(&self, hub: &Hub, wanted: &Wanted, order: &Order) -> Option<Detour> {
        let rests = self.relayed_until.is_some_and(|until| Instant::now() < until);
        if rests || order.judged {
            return None;
        }
        let request = within(&wanted.span, request(hub, wanted, order));
        hub.detour(order.worker, request, wanted.arrived.elapsed())
    }

    fn missed(&mut self) {
        let rest = FIRST_REST.saturating_mul(1 << self.missed.min(16)).min(LONGEST_REST);
        self.missed = self.missed.saturating_add(1);
        self.relayed_until = Some(Instant::now() + rest);
    }
}

/// What a client says of a frame that it was sent for.
#[derive(Debug)]
pub(super) enum Word {
    /// It has it.
    Arrived(Option<v1::Sealed>),
    /// It could not get it, or will not say any more.
    Missed(v1::SessionMissed),
}

impl Word {
    /// A worker is not reached, whichever ticket is out.
    fn unreachable(reason: &str) -> Self {
        Self::Missed(v1::SessionMissed { reason: reason.to_owned(), serial: 0, unreachable: true })
    }

    /// The client's side of the session is closed.
    pub(super) fn no_more() -> Self {
        Self::unreachable("the client says no more")
    }
}

/// A view that the client is sent away for.
pub(super) struct Away<'a> {
    pub(super) hub: &'a Hub,
    pub(super) detours: &'a mut Detours,
    /// Those of this view so far; the last one is the one that holds.
    pub(super) given: &'a [Detour],
    /// When the view was asked for.
    pub(super) since: Instant,
}

impl Away<'_> {
    /// Waits until the client has its frame: `None` then. Else what the core decided about the view meanwhile; about a
    /// frame that was not to be reached, that the order holds. `word` is what the client says next of this view.
    pub(super) async fn taken<W: Future<Output = Word>>(
        self,
        mut asked: Asked,
        mut order: Box<Order>,
        word: impl Fn() -> W,
    ) -> Option<(Asked, Result<Box<Order>, Fault>)> {
        let out = self.given.last().map_or(0, |detour| detour.elsewhere.serial);
        let until = Instant::now() + UNHEARD;
        loop {
            let word = tokio::select! {
                biased;
                word = word() => word,
                newer = ordered(&mut asked) => return Some((asked, newer)),
                () = self.hub.closing.cancelled() => Word::unreachable("the coordinator is shutting down"),
                () = tokio::time::sleep_until(until) => Word::unreachable("nothing is heard of the client"),
            };
            match word {
                Word::Arrived(receipt) => {
                    // It may have come by an earlier ticket, while another worker was given the view.
                    let opened = |receipt| self.given.iter().rev().find_map(|detour| detour.header(receipt));
                    let header = receipt.as_ref().and_then(opened).map(|header| self.with_the_way(header));
                    if header.is_some() {
                        *self.detours = Detours::default();
                    }
                    while let Some(Ok(newer)) = ordered(&mut asked).now_or_never() {
                        order = newer;
                    }
                    arrived(self.hub, asked, &order, header.as_ref());
                    return None;
                }
                // Of a ticket that another one has replaced since.
                Word::Missed(missed) if !(missed.serial == 0 || missed.serial == out) => {}
                Word::Missed(missed) => {
                    debug!(worker = ?order.worker, missed.reason, missed.unreachable, "a frame was not fetched");
                    if missed.unreachable {
                        self.detours.missed();
                        return Some((asked, Ok(order)));
                    }
                    asked.try_elsewhere(order.attempt);
                    let newer = ordered(&mut asked).await;
                    return Some((asked, newer));
                }
            }
        }
    }

    /// A worker's header with what passed until the client had the frame, and said so.
    fn with_the_way(&self, mut header: v1::FrameHeader) -> v1::FrameHeader {
        let age_ms = self.since.elapsed().as_secs_f64() * 1e3;
        let ms = (age_ms - header.age_ms).max(0.0);
        header.stages.push(v1::Stage { name: Stage::DETOUR.to_owned(), ms });
        header.age_ms = age_ms;
        header
    }
}
