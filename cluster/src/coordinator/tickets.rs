//! RedirectTickets with which clients fetch their frames from workers, and how many each client has out.
//!
//! A ticket is work that a client may have done at a time of its own choosing. So what a client says of its frame ends the
//! view and not the ticket: that counts as one of the client's until its receipt is here, or for [`REDIRECT_TIMEOUT`].

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Weak};
use std::time::Duration;

use argus_proto::v1;
use parking_lot::Mutex;
use tokio::time::Instant;

use crate::core::Client;
use crate::sealed::{Kind, SealKey};

/// How long a client may say nothing of a frame that it was sent for. A ticket whose receipt does not come is taken to be out
/// for as long.
pub(super) const REDIRECT_TIMEOUT: Duration = Duration::from_secs(120);

/// A worker's address for a client that shall fetch its frame there, with a ticket.
pub(super) struct IssuedRedirect {
    /// What the client is told.
    pub(super) message: v1::Redirect,
    /// The worker's.
    pub(super) key: SealKey,
    /// Of the ticket, at that worker.
    pub(super) serial: u64,
    pub(super) slot: TicketSlot,
    /// One for each client that is on its way to that worker.
    pub(super) _in_flight: Arc<()>,
}

impl IssuedRedirect {
    /// What the worker says of the frame, if the receipt is of this ticket, which is good for nothing then.
    pub(super) fn returned(&mut self, receipt: &v1::Sealed) -> Option<v1::FrameHeader> {
        let receipt: v1::Receipt = self.key.open(Kind::Receipt, receipt)?;
        let header = receipt.header.filter(|_| receipt.serial == self.serial)?;
        self.slot.returned = true;
        Some(header)
    }
}

/// The tickets that each client has out: those of views in work, and those of which nobody knows what became.
#[derive(Debug, Default)]
pub(super) struct RedirectTickets(Arc<Mutex<TicketCounts>>);

#[derive(Debug, Default)]
struct TicketCounts {
    clients: HashMap<Client, ClientTickets>,
    swept: Option<Instant>,
}

#[derive(Debug, Default)]
struct ClientTickets {
    /// Of views in work.
    out: usize,
    /// When each is forgotten that did not come back, in order. Those of a worker that left are good for nothing.
    unreturned: VecDeque<(Instant, Weak<()>)>,
}

impl ClientTickets {
    fn forget(&mut self, now: Instant) {
        self.unreturned.retain(|(until, worker)| now < *until && worker.strong_count() > 0);
    }
}

impl RedirectTickets {
    /// One more of a client's, unless it has `most`. `worker` lives as long as the ticket is good.
    pub(super) fn take(&self, client: &Client, worker: &Arc<()>, most: usize) -> Option<TicketSlot> {
        let now = Instant::now();
        let mut counts = self.0.lock();
        // Clients that never come again are forgotten with the others.
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

/// One ticket of a client's.
#[derive(Debug)]
pub(super) struct TicketSlot {
    counts: Arc<Mutex<TicketCounts>>,
    client: Client,
    worker: Weak<()>,
    /// Its receipt is here: it is good for nothing any more.
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
    async fn a_client_has_as_many_tickets_out_as_it_may_until_they_come_back_or_lapse() {
        let (tickets, worker) = (RedirectTickets::default(), Arc::new(()));
        let (one, other): (Client, Client) = ("one".into(), "other".into());
        let mut first = tickets.take(&one, &worker, 2).unwrap();
        let second = tickets.take(&one, &worker, 2).unwrap();
        assert!(tickets.take(&one, &worker, 2).is_none());
        assert!(tickets.take(&other, &worker, 2).is_some());
        // What the client says of its frame frees no slot; a receipt does.
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
        // Nobody takes the tickets of a worker that left.
        drop(worker);
        assert!(tickets.take(&one, &Arc::new(()), 2).is_some());
        // Nor is a client remembered that never comes again.
        tokio::time::advance(REDIRECT_TIMEOUT * 2).await;
        drop(tickets.take(&other, &Arc::new(()), 2));
        assert!(!tickets.0.lock().clients.contains_key(&one));
    }
}
