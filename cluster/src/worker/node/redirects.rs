//! Redirected clients: checks their tickets, and limits how many fetch frames at the same time.

use std::sync::Arc;

use argus_proto::{Fault, v1};
use argus_scene::InvalidField;
use parking_lot::Mutex;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::sealed::{Kind, RedeemedSerials, SealKey};
use crate::worker::config::RETRY;

/// Admission of redirected clients.
pub(in crate::worker) struct Redirects {
    /// `None` while no client is redirected to this worker.
    tickets: Mutex<Option<Tickets>>,
    /// Permits of clients that fetch frames.
    fetches: Arc<Semaphore>,
    most_fetches: usize,
}

/// The key that seals this worker's tickets, and the serial numbers of redeemed tickets.
struct Tickets {
    key: SealKey,
    redeemed: RedeemedSerials,
}

impl Redirects {
    /// Accepts at most half as many clients as views may be queued. Clients with many tickets then cannot displace the
    /// coordinator's orders.
    pub(super) fn new(max_queued_views: usize) -> Self {
        let most_fetches = (max_queued_views / 2).max(1);
        Self { tickets: Mutex::new(None), fetches: Arc::new(Semaphore::new(most_fetches)), most_fetches }
    }

    /// Sets the key of the newest assignment. A new key makes older tickets invalid. `None` ends redirects.
    pub(in crate::worker) fn set_key(&self, key: Option<SealKey>) {
        let mut tickets = self.tickets.lock();
        if tickets.as_ref().map(|tickets| &tickets.key) != key.as_ref() {
            *tickets = key.map(|key| Tickets { key, redeemed: RedeemedSerials::default() });
        }
    }

    /// Opens a ticket, once. Returns its contents, and the key that seals its receipt.
    ///
    /// # Errors
    /// [`InvalidField`] of `ticket` if the ticket is for another worker, from an earlier leader, or already redeemed.
    pub(in crate::worker) fn redeem(
        &self,
        sealed: &v1::Sealed,
    ) -> Result<(v1::RedirectTicket, SealKey), InvalidField> {
        let refused = |reason: &str| InvalidField::new("ticket", reason);
        let foreign = || refused("was not issued for this worker by the present leader");
        let key = self.tickets.lock().as_ref().map(|tickets| tickets.key.clone());
        let key = key.ok_or_else(|| refused("clients are not redirected to this worker"))?;
        // Anyone can send bytes, and hashing takes time, so the lock is not held meanwhile.
        let ticket: v1::RedirectTicket = key.open(Kind::RedirectTicket, sealed).ok_or_else(foreign)?;
        let mut tickets = self.tickets.lock();
        let tickets = tickets.as_mut().filter(|tickets| tickets.key == key).ok_or_else(foreign)?;
        match tickets.redeemed.first_time(ticket.serial) {
            true => Ok((ticket, key)),
            false => Err(refused("was redeemed before; each ticket can be redeemed once")),
        }
    }

    /// Whether clients are redirected to this worker.
    pub(in crate::worker) fn are_accepted(&self) -> bool {
        self.tickets.lock().is_some()
    }

    /// Begins a client's fetch of a frame. The fetch ends when the permit is dropped.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] at the limit of concurrent fetches.
    pub(in crate::worker) fn begin_fetch(&self) -> Result<OwnedSemaphorePermit, Fault> {
        self.fetches.clone().try_acquire_owned().map_err(|_| {
            let what = format!(
                "{} redirected clients fetch frames here, which is the limit (half of worker.queued_views)",
                self.most_fetches
            );
            Fault::Overloaded { what, retry_after: RETRY }
        })
    }
}
