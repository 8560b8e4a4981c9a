//! The moment that is served, in what the rest of the core decides: whose samples are got ready, which pins can be
//! repeated, what may be forgotten.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Plan, SampleId, SampleSetInfo, View};

use super::{NeededEpochs, Samples};
use crate::core::event::WorkerId;
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// Samplers that may compose are sent what others render only where that is no more than this, all epochs together.
const MOST_HELPED: usize = 64;

/// What became of the epochs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::core) struct Advanced {
    /// Another epoch is served, or got ready.
    pub(in crate::core) changed: bool,
    /// Samples that are to be rendered for the epoch that was issued.
    pub(in crate::core) ordered: usize,
}

impl Samples {
    /// Whether the scene moves at all.
    pub(in crate::core) fn scene_moves(&self) -> bool {
        self.epochs.moves()
    }

    /// A view is asked for: after a pause, it sees the scene as it is now.
    pub(in crate::core) fn wake(&mut self, now: Uptime, needed: &NeededEpochs) {
        if self.epochs.wake(now) {
            self.serve_epoch(needed);
        }
    }

    /// Serves the next epoch once it is ready, and issues the one after it.
    pub(in crate::core) fn advance(
        &mut self,
        workers: &Workers,
        needed: &NeededEpochs,
        now: Uptime,
    ) -> Advanced {
        if !self.epochs.moves() {
            return Advanced::default();
        }
        let (locations, laggards) = (&self.locations, &mut self.laggards);
        let (served, generation) = (self.epochs.served(), self.set.generation);
        let is_there = |epoch, index| {
            let next = SampleId { epoch, generation, index };
            let last = SampleId { epoch: served, ..next };
            if !locations.is_held(next) {
                return false;
            }
            // Whoever composes from the last epoch's sample composes from this one's: it has been sent there.
            let waits = |worker: &WorkerId| {
                workers.get(*worker).is_some_and(Worker::takes_views)
                    && locations.has(last, *worker)
                    && !locations.has(next, *worker)
            };
            // The one that was seen to wait the last time probably still does.
            if laggards.get(&index).is_some_and(waits) {
                return false;
            }
            let waiting = locations.holders(last).find(waits);
            waiting.map(|worker| laggards.insert(index, worker));
            waiting.is_none()
        };
        let refined: Vec<u64> = self.placement.placed().collect();
        let is_rendered = |epoch, index| locations.is_held(SampleId { epoch, generation, index });
        let (changed, ordered) = self.epochs.advance(now, refined, is_there, is_rendered);
        if changed {
            self.serve_epoch(needed);
        }
        Advanced { changed, ordered }
    }

    fn serve_epoch(&mut self, needed: &NeededEpochs) {
        let epoch = self.epochs.served();
        self.changed = true;
        if self.set.epoch != epoch {
            self.laggards.clear();
            self.set = Arc::new(SampleSetInfo { epoch, ..(*self.set).clone() });
            self.directory.retire(self.kept_from(needed));
        }
    }

    /// Samples of epochs before this one are of no use to any worker.
    pub(super) fn kept_from(&self, needed: &NeededEpochs) -> u64 {
        let oldest = self.epochs.oldest();
        needed.oldest().map_or(oldest, |epoch| epoch.min(oldest))
    }

    /// Samples that are got ready, and those that were and stay a while, each with the workers that compose from the
    /// same camera's already, or did: they shall have it before views ask for it. So shall samplers that may compose,
    /// each of which renders but a part of them.
    pub(super) fn prepared(&self, workers: &Workers) -> Vec<(SampleId, Vec<WorkerId>)> {
        let (served, generation) = (self.epochs.served(), self.set.generation);
        let few = self.epochs.prepared().take(MOST_HELPED + 1).count() <= MOST_HELPED;
        let helpers = || workers.queues().samplers().iter().map(|turn| turn.worker);
        let helpers: BTreeSet<WorkerId> =
            if self.config.samplers_composite && few { helpers().collect() } else { BTreeSet::new() };
        let with_readers = |(epoch, index)| {
            let id = SampleId { epoch, generation, index };
            let last = SampleId { epoch: served, ..id };
            let holders = self.locations.holders(id).chain(self.locations.holders(last));
            let reads = |worker: &WorkerId| workers.get(*worker).is_some_and(Worker::takes_views);
            let readers: BTreeSet<WorkerId> = holders.filter(reads).chain(helpers.iter().copied()).collect();
            (id, readers.into_iter().collect())
        };
        self.epochs.prepared().map(with_readers).collect()
    }

    /// How many refinements can be rendered anew in every epoch with a share of the samplers' time; any number
    /// where the scene stands still.
    pub(super) fn refinements_an_epoch(&self, share: f64, samplers: usize, sample_secs: f64) -> usize {
        if !self.epochs.moves() || !(sample_secs > 0.0) {
            return usize::MAX;
        }
        (share * samplers as f64 * self.config.epoch.as_secs_f64() / sample_secs) as usize
    }

    /// Whether a pinned epoch can be repeated: a view from triangles is a function of its time alone, one from
    /// samples needs those of an epoch that are still kept.
    ///
    /// # Errors
    /// [`Fault::Pin`].
    pub(in crate::core) fn check_epoch(&self, view: &View) -> Result<(), Fault> {
        let Some(pin) = &view.pin else { return Ok(()) };
        let (oldest, served) = (self.epochs.oldest(), self.epochs.served());
        let direct = self.epochs.moves() && matches!(pin.plan, Plan::Direct { .. });
        // Epochs between the two were passed over.
        if direct || [oldest, served].contains(&pin.epoch) {
            return Ok(());
        }
        let epochs = if oldest < served {
            format!("epochs {oldest} and {served} are")
        } else {
            format!("epoch {served} is")
        };
        Err(Fault::Pin(format!("epoch {} is not served here, {epochs}", pin.epoch)))
    }
}
