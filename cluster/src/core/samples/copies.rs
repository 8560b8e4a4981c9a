//! A second copy of what views use of a scene that stands still: whoever is lost takes no sample along that others would have
//! to wait for until it is rendered again.
//!
//! Of a scene that moves every sample is where it is composed from, and lasts a moment; refinements are wherever views are
//! composed. What is left are the rig's own samples, which a compositor has only if one of its views asked for them, and
//! which nearer refinements make all views forget about until a worker comes that has none of those yet.

use argus_scene::SampleId;

use super::Samples;
use crate::core::event::WorkerId;
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// Samples that get a second copy at most, however small they are: each stands in an assignment.
const MOST_COPIED: u64 = 256;

/// The share of the memory for refinements that copies may take.
const OF_REFINEMENTS: f64 = 0.5;

impl Samples {
    /// Remembers that a view asks for these samples.
    pub(in crate::core) fn note_use(&mut self, cameras: &[u64], now: Uptime) {
        let cameras = cameras.iter().copied();
        self.versions.used(cameras.clone(), now);
        if !self.versions.moves() {
            let rig = self.set.rig;
            self.recent.used(cameras.filter(|camera| rig.level(*camera) == Some(0)), now);
        }
    }

    /// The rig's own samples that views asked for lately, each with who shall have it beside its owner: who composes from it
    /// already, or somebody who may. One that nobody has any more is rendered again before a view asks for it.
    pub(super) fn copies(&mut self, workers: &Workers, now: Uptime) -> Vec<(SampleId, Vec<WorkerId>)> {
        let bytes = OF_REFINEMENTS * self.config.refining_bytes as f64;
        let most = ((bytes / self.sample_bytes(workers).max(1) as f64) as u64).min(MOST_COPIED) as usize;
        let indices: Vec<u64> = self.recent.copied(most, now).iter().copied().collect();
        let composes =
            |worker: &Worker| worker.takes_views() && !worker.takes_samples() && !worker.is_suspected();
        let composers: Vec<WorkerId> = workers.iter().filter(|w| composes(w)).map(Worker::id).collect();
        let ids: Vec<SampleId> = indices.into_iter().map(|index| self.served(index)).collect();
        // What views wait for is being rendered.
        let is_settled = |id: &SampleId| self.locations.is_held(*id) || !self.locations.is_on_its_way(*id);
        let with_reader = |(index, id): (usize, SampleId)| {
            let holder = self.locations.holders(id).find(|id| workers.get(*id).is_some_and(composes));
            let any = || composers.get(index % composers.len().max(1)).copied();
            (id, holder.or_else(any).into_iter().collect())
        };
        ids.into_iter().filter(is_settled).enumerate().map(with_reader).collect()
    }
}
