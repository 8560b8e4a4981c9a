//! Who has room: the workers of each role, those with the fewest views first.
//!
//! A view goes to the worker that will probably answer first, and there may be thousands of them and a hundred
//! thousand views a second. So they are kept in order, and only those at the front are looked at.

use std::collections::{BTreeSet, HashMap};

use super::event::WorkerId;
use super::worker::Worker;

/// Where a worker stands: views in its queue, then views it ever had, whose turn it is among equals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Turn {
    pub(super) queued: usize,
    pub(super) dispatched: u64,
    pub(super) worker: WorkerId,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Known {
    turn: Turn,
    ready: bool,
    answers: bool,
    composites: bool,
    samples: bool,
}

/// All workers in order.
#[derive(Debug, Clone, Default)]
pub(super) struct Lines {
    known: HashMap<WorkerId, Known>,
    ready: usize,
    anyone: BTreeSet<Turn>,
    compositors: BTreeSet<Turn>,
    samplers: BTreeSet<Turn>,
}

impl Lines {
    /// A worker joined or changed.
    pub(super) fn update(&mut self, worker: &Worker) {
        let turn = Turn { queued: worker.views.len(), dispatched: worker.dispatched, worker: worker.id };
        let now = Known {
            turn,
            ready: worker.is_ready(),
            answers: worker.answers(),
            composites: worker.takes_views(),
            samples: worker.takes_samples(),
        };
        if self.known.get(&worker.id) == Some(&now) {
            return;
        }
        self.remove(worker.id);
        self.known.insert(worker.id, now);
        self.ready += usize::from(now.ready);
        if now.answers {
            self.anyone.insert(turn);
        }
        if now.composites {
            self.compositors.insert(turn);
        }
        if now.samples {
            self.samplers.insert(turn);
        }
    }

    /// A worker is gone.
    pub(super) fn remove(&mut self, worker: WorkerId) {
        if let Some(known) = self.known.remove(&worker) {
            self.ready -= usize::from(known.ready);
            self.anyone.remove(&known.turn);
            self.compositors.remove(&known.turn);
            self.samplers.remove(&known.turn);
        }
    }

    /// How many are ready.
    pub(super) fn ready(&self) -> usize {
        self.ready
    }

    /// Those who answer views whose way is open, whatever their role.
    pub(super) fn anyone(&self) -> &BTreeSet<Turn> {
        &self.anyone
    }

    /// Those who take views to reconstruct.
    pub(super) fn compositors(&self) -> &BTreeSet<Turn> {
        &self.compositors
    }

    /// Those who take samples and direct views.
    pub(super) fn samplers(&self) -> &BTreeSet<Turn> {
        &self.samplers
    }
}
