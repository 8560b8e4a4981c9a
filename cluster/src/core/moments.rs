//! The moment that is served, in what the rest of the core decides: whose samples are got ready, which pins can be
//! repeated, what may be forgotten.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Plan, SampleId, SampleSetInfo, View};

use super::event::WorkerId;
use super::machine::Core;
use super::time::Uptime;
use super::worker::Worker;

impl Core {
    /// A view is asked for: after a pause, it sees the scene as it is now.
    pub(super) fn wake(&mut self, now: Uptime) {
        if self.epochs.wake(now) {
            self.serve_epoch();
        }
    }

    /// Serves the next epoch once it is ready, and issues the one after it. S counts its samples.
    pub(super) fn advance(&mut self, now: Uptime) {
        if !self.epochs.moves() {
            return;
        }
        let (workers, served, generation) = (&self.workers, self.epochs.served(), self.set.generation);
        let is_there = |epoch, index| {
            let next = SampleId { epoch, generation, index };
            let last = SampleId { epoch: served, ..next };
            // Whoever composes from the last epoch's sample composes from this one's: it has been sent there.
            let waits = |w: &Worker| w.takes_views() && w.held.contains(&last) && !w.held.contains(&next);
            workers.values().any(|w| w.held.contains(&next)) && !workers.values().any(waits)
        };
        let refined: Vec<u64> = self.placement.placed().collect();
        let (changed, ordered) = self.epochs.advance(now, refined, is_there);
        self.rates.samples.count(ordered as u64);
        if changed {
            self.serve_epoch();
        }
    }

    fn serve_epoch(&mut self) {
        let epoch = self.epochs.served();
        if self.set.epoch != epoch {
            self.set = Arc::new(SampleSetInfo { epoch, ..(*self.set).clone() });
            self.directory.retire(self.kept_from());
            let needed: BTreeSet<u64> = self.views.values().filter_map(|view| view.sampled_epoch()).collect();
            self.epochs.retire(|epoch| needed.contains(&epoch));
        }
    }

    /// Samples of epochs before this one are of no use to anybody.
    pub(super) fn kept_from(&self) -> u64 {
        let in_work = self.views.values().filter_map(|view| view.sampled_epoch()).min();
        in_work.map_or(self.epochs.oldest(), |epoch| epoch.min(self.epochs.oldest()))
    }

    /// Samples that are got ready, and those that were and stay a while, each with the workers that compose from the
    /// same camera's already, or did: they shall have it before views ask for it.
    pub(super) fn prepared(&self) -> Vec<(SampleId, Vec<WorkerId>)> {
        let (served, generation) = (self.epochs.served(), self.set.generation);
        let with_readers = |(epoch, index)| {
            let id = SampleId { epoch, generation, index };
            let last = SampleId { epoch: served, ..id };
            let reads = |w: &&Worker| w.takes_views() && (w.held.contains(&id) || w.held.contains(&last));
            (id, self.workers.values().filter(reads).map(|w| w.id).collect())
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
    pub(super) fn check_epoch(&self, view: &View) -> Result<(), Fault> {
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
