//! Second copies of samples of a still scene, so that the loss of a worker loses no sample in use.
//!
//! In a moving scene each sample is held where it is composed from, and lasts a moment. Refinements are held by all
//! compositors. There remain the rig's own samples: a compositor holds one only if one of its views needed it. Where
//! nearer refinements replace it, views no longer need it, until a worker joins that lacks those refinements.

use argus_scene::SampleId;

use super::Samples;
use crate::core::event::WorkerId;
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// Most samples with a second copy, however small they are: each is in an assignment.
const MOST_COPIED: u64 = 256;

/// Share of the memory for refinements that copies may use.
const OF_REFINEMENTS: f64 = 0.5;

impl Samples {
    /// Records that a view uses these samples.
    pub(in crate::core) fn note_use(&mut self, cameras: &[u64], now: Uptime) {
        let cameras = cameras.iter().copied();
        self.versions.used(cameras.clone(), now);
        if !self.versions.moves() {
            let rig = self.set.rig;
            self.recent.used(cameras.filter(|camera| rig.level(*camera) == Some(0)), now);
        }
    }

    /// The rig's own samples in recent use, each with the worker that holds the copy beside the owner: preferably one
    /// that composes from it. A sample that was lost is rendered again before a view needs it.
    pub(super) fn copies(&mut self, workers: &Workers, now: Uptime) -> Vec<(SampleId, Vec<WorkerId>)> {
        let bytes = OF_REFINEMENTS * self.config.refining_bytes as f64;
        let most = ((bytes / self.sample_bytes(workers).max(1) as f64) as u64).min(MOST_COPIED) as usize;
        let indices: Vec<u64> = self.recent.copied(most, now).iter().copied().collect();
        let composes =
            |worker: &Worker| worker.takes_views() && !worker.takes_samples() && !worker.is_suspected();
        let composers: Vec<WorkerId> = workers.iter().filter(|w| composes(w)).map(Worker::id).collect();
        let ids: Vec<SampleId> = indices.into_iter().map(|index| self.served(index)).collect();
        // Samples that views wait for are being rendered.
        let is_settled = |id: &SampleId| self.locations.is_held(*id) || !self.locations.is_on_its_way(*id);
        let with_reader = |(index, id): (usize, SampleId)| {
            let holder = self.locations.holders(id).find(|id| workers.get(*id).is_some_and(composes));
            let any = || composers.get(index % composers.len().max(1)).copied();
            (id, holder.or_else(any).into_iter().collect())
        };
        ids.into_iter().filter(is_settled).enumerate().map(with_reader).collect()
    }
}
