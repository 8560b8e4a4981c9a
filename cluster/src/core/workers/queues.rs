//! Queues of workers: those of each role, the ones with the fewest views first.
//!
//! A view goes to the worker that will probably answer first, and there may be thousands of them and a hundred
//! thousand views a second. So they are kept in order, and only those at the front are looked at.

use std::collections::{BTreeSet, HashMap};

use crate::core::event::WorkerId;

/// Where a worker stands: views in its queue, then views it ever had, whose entry it is among equals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::core) struct QueueEntry {
    pub(in crate::core) queued: usize,
    pub(in crate::core) dispatched: u64,
    pub(in crate::core) worker: WorkerId,
}

/// What a worker can be given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct QueueMembership {
    pub(super) entry: QueueEntry,
    pub(super) ready: bool,
    pub(super) answers: bool,
    pub(super) composites: bool,
    pub(super) samples: bool,
}

/// All workers in order.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct WorkerQueues {
    known: HashMap<WorkerId, QueueMembership>,
    ready: usize,
    anyone: BTreeSet<QueueEntry>,
    compositors: BTreeSet<QueueEntry>,
    samplers: BTreeSet<QueueEntry>,
}

impl WorkerQueues {
    /// A worker joined or changed.
    pub(super) fn update(&mut self, now: QueueMembership) {
        let entry = now.entry;
        if self.known.get(&entry.worker) == Some(&now) {
            return;
        }
        self.remove(entry.worker);
        self.known.insert(entry.worker, now);
        self.ready += usize::from(now.ready);
        if now.answers {
            self.anyone.insert(entry);
        }
        if now.composites {
            self.compositors.insert(entry);
        }
        if now.samples {
            self.samplers.insert(entry);
        }
    }

    /// A worker is gone.
    pub(super) fn remove(&mut self, worker: WorkerId) {
        if let Some(known) = self.known.remove(&worker) {
            self.ready -= usize::from(known.ready);
            self.anyone.remove(&known.entry);
            self.compositors.remove(&known.entry);
            self.samplers.remove(&known.entry);
        }
    }

    /// How many are ready.
    pub(in crate::core) fn ready(&self) -> usize {
        self.ready
    }

    /// Those who answer views whose way is open, whatever their role.
    pub(in crate::core) fn anyone(&self) -> &BTreeSet<QueueEntry> {
        &self.anyone
    }

    /// Those who take views to reconstruct.
    pub(in crate::core) fn compositors(&self) -> &BTreeSet<QueueEntry> {
        &self.compositors
    }

    /// Those who take samples and direct views.
    pub(in crate::core) fn samplers(&self) -> &BTreeSet<QueueEntry> {
        &self.samplers
    }
}
