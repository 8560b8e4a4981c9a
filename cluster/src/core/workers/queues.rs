//! Workers of each role, ordered by the length of their queues.
//!
//! A view goes to the worker that will probably answer first. There may be thousands of workers and a hundred
//! thousand views a second, so workers are kept in order, and only the first ones are examined.

use std::collections::{BTreeSet, HashMap};

use crate::core::event::WorkerId;

/// A worker's place in the order: by views in its queue, then by views that it ever got.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::core) struct QueueEntry {
    pub(in crate::core) queued: usize,
    pub(in crate::core) dispatched: u64,
    pub(in crate::core) worker: WorkerId,
}

/// The queues that a worker belongs in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct QueueMembership {
    pub(super) entry: QueueEntry,
    pub(super) ready: bool,
    pub(super) answers: bool,
    pub(super) composites: bool,
    pub(super) samples: bool,
}

/// Ordered sets of workers.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct WorkerQueues {
    known: HashMap<WorkerId, QueueMembership>,
    ready: usize,
    anyone: BTreeSet<QueueEntry>,
    compositors: BTreeSet<QueueEntry>,
    samplers: BTreeSet<QueueEntry>,
}

impl WorkerQueues {
    /// Adds or updates a worker.
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

    /// Removes a worker.
    pub(super) fn remove(&mut self, worker: WorkerId) {
        if let Some(known) = self.known.remove(&worker) {
            self.ready -= usize::from(known.ready);
            self.anyone.remove(&known.entry);
            self.compositors.remove(&known.entry);
            self.samplers.remove(&known.entry);
        }
    }

    /// Number of ready workers.
    pub(in crate::core) fn ready(&self) -> usize {
        self.ready
    }

    /// Workers that answer views that leave the way open, whatever their role.
    pub(in crate::core) fn anyone(&self) -> &BTreeSet<QueueEntry> {
        &self.anyone
    }

    /// Workers that take views to reconstruct.
    pub(in crate::core) fn compositors(&self) -> &BTreeSet<QueueEntry> {
        &self.compositors
    }

    /// Workers that take samples and direct views.
    pub(in crate::core) fn samplers(&self) -> &BTreeSet<QueueEntry> {
        &self.samplers
    }
}
