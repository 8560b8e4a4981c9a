//! A view of a session whose frame the client fetches from the worker itself.
//!
//! The core plans it and picks its worker as it does for any view; then the order goes to the client, as a ticket for the
//! worker, and what comes back is an acknowledgement with the worker's receipt instead of the frame. So a frame's
//! pixels do not pass the coordinator. A client that does not get there says so, and has that frame relayed, and those
//! of a while after.
//!
//! A ticket is work that a client may have done at a time of its own choosing. So what a client says of its frame ends the
//! view and not the ticket: that counts as one of the client's (`Tickets`) until its receipt is here, or for [`UNHEARD`].

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Weak};
use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::{Fault, v1};
use argus_scene::Stage;
use futures::FutureExt;
use parking_lot::Mutex;
use tokio::time::Instant;
use tracing::debug;

use super::hub::{Asked, Detour, Hub};
use super::relay::{Wanted, arrived, ordered, rendering_ms, request, uncovered};
use crate::core::{Client, Order};

/// How long a session's frames are relayed after a worker could not be reached; twice as long each time that happens in a
/// row.
const FIRST_REST: Duration = Duration::from_secs(5);

/// … at most.
const LONGEST_REST: Duration = Duration::from_secs(600);

/// A client that says nothing for this long of a frame that it was sent for has that frame relayed, and the next ones, so
/// that it holds no place at a worker by doing nothing. A ticket whose receipt does not come is taken to be out for as long.
const UNHEARD: Duration = Duration::from_secs(120);

/// A frame that was missed so often is relayed: each miss may be a frame that was rendered.
pub(super) const MOST_MISSES: u32 = 2;

/// Whether a session's client may be sent elsewhere now.
#[derive(Debug, Default)]
pub(super) struct Detours {
    /// Of the newest one; whichever worker it leads to, so that no word about one is taken for one about another.
    serial: u64,
    /// Misses in a row.
    missed: u32,
    /// Frames in a row that the client says it has and brings no receipt of.
    unproven: u32,
    relayed_until: Option<Instant>,
}

impl Detours {
    /// The detour of an order; `None` where its frame is to be looked at before it is delivered, where clients do not reach
    /// its worker, where this one did not lately, or where it has as many tickets out as it may have views in work.
    pub(super) fn of(&mut self, hub: &Hub, wanted: &Wanted, order: &Order) -> Option<Detour> {
        let rests = self.relayed_until.is_some_and(|until| Instant::now() < until);
        if rests || order.judged {
            return None;
        }
        let request = within(&wanted.span, request(hub, wanted, order));
        let detour =
            hub.detour(order.worker, &wanted.client, request, wanted.arrived.elapsed(), self.serial + 1)?;
        self.serial += 1;
        Some(detour)
    }

    fn missed(&mut self) {
        let rest = FIRST_REST.saturating_mul(1 << self.missed.min(16)).min(LONGEST_REST);
        self.missed = self.missed.saturating_add(1);
        self.relayed_until = Some(Instant::now() + rest);
    }

    /// A frame arrived, as far as the client says: a receipt may be lost once.
    fn unproven(&mut self) {
        self.unproven += 1;
        if self.unproven >= MOST_MISSES {
            self.missed();
        }
    }
}

/// The tickets that each client has out: those of views in work, and those of which nobody knows what became.
#[derive(Debug, Default)]
pub(super) struct Tickets(Arc<Mutex<Accounts>>);

#[derive(Debug, Default)]
struct Accounts {
    clients: HashMap<Client, Account>,
    swept: Option<Instant>,
}

#[derive(Debug, Default)]
struct Account {
    /// Of views in work.
    out: usize,
    /// When each is forgotten that did not come back, in order. Those of a worker that left are good for nothing.
    astray: VecDeque<(Instant, Weak<()>)>,
}

impl Account {
    fn forget(&mut self, now: Instant) {
        self.astray.retain(|(until, worker)| now < *until && worker.strong_count() > 0);
    }
}

impl Tickets {
    /// One more of a client's, unless it has `most`. `worker` lives as long as the ticket is good.
    pub(super) fn take(&self, client: &Client, worker: &Arc<()>, most: usize) -> Option<Place> {
        let now = Instant::now();
        let mut accounts = self.0.lock();
        // Clients that never come again are forgotten with the others.
        if accounts.swept.is_none_or(|swept| now.duration_since(swept) >= UNHEARD) {
            accounts.swept = Some(now);
            accounts.clients.retain(|_, account| {
                account.forget(now);
                account.out > 0 || !account.astray.is_empty()
            });
        }
        let account = accounts.clients.entry(client.clone()).or_default();
        if account.out + account.astray.len() >= most {
            account.forget(now);
            if account.out + account.astray.len() >= most {
                return None;
            }
        }
        account.out += 1;
        let worker = Arc::downgrade(worker);
        Some(Place { accounts: self.0.clone(), client: client.clone(), worker, returned: false })
    }
}

/// One ticket of a client's.
#[derive(Debug)]
pub(super) struct Place {
    accounts: Arc<Mutex<Accounts>>,
    client: Client,
    worker: Weak<()>,
    /// Its receipt is here: it is good for nothing any more.
    pub(super) returned: bool,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut accounts = self.accounts.lock();
        if let Some(account) = accounts.clients.get_mut(&self.client) {
            account.out -= 1;
            if !self.returned {
                account.astray.push_back((Instant::now() + UNHEARD, std::mem::take(&mut self.worker)));
            }
        }
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

/// What a coordinator learns of a frame that it did not see, for fuzzing: pixels that no sample saw, and milliseconds.
pub(crate) fn learn(header: &v1::FrameHeader) -> (u64, f64) {
    let frames = super::watch::Frames::default();
    frames.arrived(header);
    frames.registry();
    (uncovered(header), rendering_ms(header))
}

/// A view that the client is sent away for.
pub(super) struct Away<'a> {
    pub(super) hub: &'a Hub,
    pub(super) detours: &'a mut Detours,
    /// Those of this view so far; the last one is the one that holds.
    pub(super) given: &'a mut [Detour],
    /// How often this view's frame was missed.
    pub(super) missed: &'a mut u32,
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
                    let opened = receipt.and_then(|receipt| {
                        self.given.iter_mut().rev().find_map(|detour| detour.returned(&receipt))
                    });
                    let header = opened.map(|header| self.with_the_way(header));
                    match header {
                        Some(_) => (self.detours.missed, self.detours.unproven) = (0, 0),
                        None => self.detours.unproven(),
                    }
                    while let Some(Ok(newer)) = ordered(&mut asked).now_or_never() {
                        order = newer;
                    }
                    self.hub.frames.fetched();
                    arrived(self.hub, asked, &order, header.as_ref());
                    return None;
                }
                // Of a ticket that another one has replaced since.
                Word::Missed(missed) if !(missed.serial == 0 || missed.serial == out) => {}
                Word::Missed(missed) => {
                    debug!(worker = ?order.worker, missed.reason, missed.unreachable, "a frame was not fetched");
                    *self.missed += 1;
                    if missed.unreachable || *self.missed >= MOST_MISSES {
                        self.detours.missed();
                    }
                    if missed.unreachable {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_client_has_as_many_tickets_out_as_it_may_until_they_come_back_or_lapse() {
        let (tickets, worker) = (Tickets::default(), Arc::new(()));
        let (one, other): (Client, Client) = ("one".into(), "other".into());
        let mut first = tickets.take(&one, &worker, 2).unwrap();
        let second = tickets.take(&one, &worker, 2).unwrap();
        assert!(tickets.take(&one, &worker, 2).is_none());
        assert!(tickets.take(&other, &worker, 2).is_some());
        // What the client says of its frame frees no place; a receipt does.
        drop(second);
        assert!(tickets.take(&one, &worker, 2).is_none());
        first.returned = true;
        drop(first);
        drop(tickets.take(&one, &worker, 2).unwrap());
        assert!(tickets.take(&one, &worker, 2).is_none());
        tokio::time::advance(UNHEARD).await;
        let fresh = [tickets.take(&one, &worker, 2).unwrap(), tickets.take(&one, &worker, 2).unwrap()];
        drop(fresh);
        assert!(tickets.take(&one, &worker, 2).is_none());
        // Nobody takes the tickets of a worker that left.
        drop(worker);
        assert!(tickets.take(&one, &Arc::new(()), 2).is_some());
        // Nor is a client remembered that never comes again.
        tokio::time::advance(UNHEARD * 2).await;
        drop(tickets.take(&other, &Arc::new(()), 2));
        assert!(!tickets.0.lock().clients.contains_key(&one));
    }
}
