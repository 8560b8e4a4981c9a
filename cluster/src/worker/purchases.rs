//! The purchases that a worker is to render, and those that it failed at.

use std::collections::VecDeque;

use parking_lot::Mutex;
use tokio::sync::watch;

use crate::core::Purchase;

/// Most purchases that are remembered as failed.
const MOST_FAILED: usize = 64;

/// The purchases of a worker.
#[derive(Debug, Default)]
pub(super) struct Purchases {
    pub(super) wanted: watch::Sender<Vec<Purchase>>,
    failed: Mutex<VecDeque<Purchase>>,
}

impl Purchases {
    /// Replaces the list.
    pub(super) fn want(&self, purchases: Vec<Purchase>) {
        self.wanted.send_if_modified(|before| {
            let is_new = *before != purchases;
            *before = purchases;
            is_new
        });
    }

    /// Remembers a purchase as failed.
    pub(super) fn fail(&self, purchase: Purchase) {
        let mut failed = self.failed.lock();
        failed.truncate(MOST_FAILED - 1);
        failed.push_front(purchase);
    }

    pub(super) fn has_failed(&self, purchase: &Purchase) -> bool {
        self.failed.lock().contains(purchase)
    }
}
