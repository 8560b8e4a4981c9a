//! Redirect tickets, and how many of them each client holds.
//!
//! A client may redeem a ticket at a time of its choosing. So an acknowledgement ends the view, but the ticket counts
//! against the client until its receipt arrives or [`REDIRECT_TIMEOUT`] passes.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Weak};
use std::time::Duration;

use argus_proto::v1;
use parking_lot::Mutex;
use tokio::time::Instant;

use crate::core::Client;
use crate::sealed::{Kind, SealKey};

/// Longest time that a client may be silent about a redirected frame. A ticket without a receipt counts for as long.
pub(super) const REDIRECT_TIMEOUT: Duration = Duration::from_secs(120);

/// A redirect that was sent to a client.
pub(super) struct IssuedRedirect {
    /// The message to the client.
    pub(super) message: v1::Redirect,
    /// The key that the coordinator and the worker share.
    pub(super) key: SealKey,
    /// The ticket's serial number at that worker.
    pub(super) serial: u64,
    pub(super) slot: TicketSlot,
    /// Counts the redirects in flight to the worker.
    pub(super) _in_flight: Arc<()>,
}

impl IssuedRedirect {
    /// The frame's header, if the receipt is genuine and belongs to this ticket. The ticket is then used up.
    pub(super) fn returned(&mut self, receipt: &v1::Sealed) -> Option<v1::FrameHeader> {
        let receipt: v1::Receipt = self.key.open(Kind::Receipt, receipt)?;
        let header = receipt.header.filter(|_| receipt.serial == self.serial)?;
        self.slot.returned = true;
        Some(header)
    }
}

/// The tickets of each client: those of views in flight, and unreturned ones.
#[derive(Debug, Default)]
pub(super) struct RedirectTickets(Arc<Mutex<TicketCounts>>);

#[derive(Debug, Default)]
struct TicketCounts {
    clients: HashMap<Client, ClientTickets>,
    swept: Option<Instant>,
}

#[derive(Debug, Default)]
struct ClientTickets {
    /// Tickets of views in flight.
    out: usize,
    /// Tickets without a receipt, each with its expiry and a handle that is alive while its worker is.
    unreturned: VecDeque<(Instant, Weak<()>)>,
}

impl ClientTickets {
    fn forget(&mut self, now: Instant) {
        self.unreturned.retain(|(until, worker)| now < *until && worker.strong_count() > 0);
    }
}

impl RedirectTickets {
    /// Counts one more ticket of a client, unless it has `most`. `worker` is alive as long as the ticket is valid.
    pub(super) fn take(&self, client: &Client, worker: &Arc<()>, most: usize) -> Option<TicketSlot> {
        let now = Instant::now();
        let mut counts = self.0.lock();
        // Clients without tickets are forgotten, whether or not they come again.
        if counts.swept.is_none_or(|swept| now.duration_since(swept) >= REDIRECT_TIMEOUT) {
            counts.swept = Some(now);
            counts.clients.retain(|_, tickets| {
                tickets.forget(now);
                tickets.out > 0 || !tickets.unreturned.is_empty()
            });
        }
        let tickets = counts.clients.entry(client.clone()).or_default();
        if tickets.out + tickets.unreturned.len() >= most {
            tickets.forget(now);
            if tickets.out + tickets.unreturned.len() >= most {
                return None;
            }
        }
        tickets.out += 1;
        let worker = Arc::downgrade(worker);
        Some(TicketSlot { counts: self.0.clone(), client: client.clone(), worker, returned: false })
    }
}

/// One counted ticket of a client.
#[derive(Debug)]
pub(super) struct TicketSlot {
    counts: Arc<Mutex<TicketCounts>>,
    client: Client,
    worker: Weak<()>,
    /// Whether the receipt arrived, so that the ticket is used up.
    pub(super) returned: bool,
}

impl Drop for TicketSlot {
    fn drop(&mut self) {
        let mut counts = self.counts.lock();
        if let Some(tickets) = counts.clients.get_mut(&self.client) {
            tickets.out -= 1;
            if !self.returned {
                let until = Instant::now() + REDIRECT_TIMEOUT;
                tickets.unreturned.push_back((until, std::mem::take(&mut self.worker)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_client_may_hold_a_limited_number_of_tickets_until_they_return_or_expire() {
        let (tickets, worker) = (RedirectTickets::default(), Arc::new(()));
        let (one, other): (Client, Client) = ("one".into(), "other".into());
        let mut first = tickets.take(&one, &worker, 2).unwrap();
        let second = tickets.take(&one, &worker, 2).unwrap();
        assert!(tickets.take(&one, &worker, 2).is_none());
        assert!(tickets.take(&other, &worker, 2).is_some());
        // Ending the view frees no slot; a receipt does.
        drop(second);
        assert!(tickets.take(&one, &worker, 2).is_none());
        first.returned = true;
        drop(first);
        drop(tickets.take(&one, &worker, 2).unwrap());
        assert!(tickets.take(&one, &worker, 2).is_none());
        tokio::time::advance(REDIRECT_TIMEOUT).await;
        let fresh = [tickets.take(&one, &worker, 2).unwrap(), tickets.take(&one, &worker, 2).unwrap()];
        drop(fresh);
        assert!(tickets.take(&one, &worker, 2).is_none());
        // Tickets of a worker that left do not count.
        drop(worker);
        assert!(tickets.take(&one, &Arc::new(()), 2).is_some());
        // A client that never comes again is forgotten.
        tokio::time::advance(REDIRECT_TIMEOUT * 2).await;
        drop(tickets.take(&other, &Arc::new(()), 2));
        assert!(!tickets.0.lock().clients.contains_key(&one));
    }
}
