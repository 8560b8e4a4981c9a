//! Samples at refinements of the rig: ordered where views have holes, brought to where views are composed.
//!
//! `placement` decides which; here is who renders each and who fetches it from where.

use std::collections::BTreeMap;

use argus_scene::SampleId;

use super::event::{Action, Source, WorkerId};
use super::machine::Core;
use super::placement::Budget;
use super::time::Uptime;
use super::worker::Worker;

/// At most so many refinements, however small a sample is: every one stands in every worker's assignment.
const MOST_REFINEMENTS: u64 = 512;

/// Bytes of a texel: radiance and inverse range.
const TEXEL_BYTES: u64 = 8;

impl Core {
    /// Ticks have passed: places the samples that the budget allows. S counts them.
    pub(super) fn place_samples(&mut self, ticks: f64) {
        let samplers = self.workers.values().filter(|w| w.takes_samples()).count();
        if samplers == 0 || !(self.config.refining_share > 0.0) {
            return;
        }
        let secs = self.believed_costs().sample_secs;
        let time = self.config.refining_share * self.config.tick.as_secs_f64() * ticks * samplers as f64;
        // Until a sample's cost is known, one at a time.
        let per_tick = if secs > 0.0 { time / secs } else { 1.0 };
        let bytes = self.set.rig.sample_texels() * TEXEL_BYTES;
        let most = (self.config.refining_bytes / bytes.max(1)).min(MOST_REFINEMENTS) as usize;
        let most = most.min(self.refinements_an_epoch(self.config.refining_share, samplers, secs));
        let placed = self.placement.tick(Budget { per_tick, most });
        self.rates.samples.count(placed as u64);
    }

    /// Tells workers what to have at hand, where that is news, and sees what views may use.
    pub(super) fn refine(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        // Refinements are for all who compose; what the next epoch needs, for those who compose from it.
        let mut wanted: BTreeMap<SampleId, Option<Vec<WorkerId>>> =
            self.prepared().into_iter().map(|(id, readers)| (id, Some(readers))).collect();
        wanted.extend(self.placement.placed().map(|index| (self.refined(index), None)));
        let mut lists: BTreeMap<WorkerId, Vec<Source>> = BTreeMap::new();
        for (id, readers) in wanted {
            let Some(owner) = self.directory.owner(id, &self.workers, now) else { continue };
            // Others fetch what is there: asked for earlier, it would be rendered before what views wait for.
            // A new owner fetches as well, from those who have it from the old one.
            let has = |w: &&Worker| w.held.contains(&id);
            let holder = self.workers.get(&owner).filter(has).or_else(|| self.workers.values().find(has));
            let from = |reader| holder.filter(|w| w.id != reader).map(|w| w.hello.address.clone());
            let source = |reader| Source { id, addresses: from(reader).into_iter().collect() };
            lists.entry(owner).or_default().push(source(owner));
            if holder.is_some() {
                let reads = |w: &&Worker| {
                    w.id != owner && w.takes_views() && readers.as_ref().is_none_or(|r| r.contains(&w.id))
                };
                for reader in self.workers.values().filter(reads) {
                    lists.entry(reader.id).or_default().push(source(reader.id));
                }
            }
        }
        let kept_from = self.kept_from();
        for worker in self.workers.values_mut().filter(|w| w.is_ready()) {
            let list = lists.remove(&worker.id).unwrap_or_default();
            if let Some(assignment) = worker.order_ahead(list, kept_from) {
                actions.push(Action::Assign { worker: worker.id, assignment });
            }
        }
        let (workers, set) = (&self.workers, &self.set);
        let refined = |index| SampleId { epoch: set.epoch, generation: set.generation, index };
        let readers: Vec<&Worker> = workers.values().filter(|w| w.takes_views()).collect();
        let held_by = |index| readers.iter().filter(|w| w.held.contains(&refined(index))).count();
        // A view that goes to one of the few who lack it fetches it like any other sample.
        self.placement.update(
            |index| !readers.is_empty() && 2 * held_by(index) >= readers.len(),
            |index| held_by(index) > 0,
        );
    }

    fn refined(&self, index: u64) -> SampleId {
        SampleId { epoch: self.set.epoch, generation: self.set.generation, index }
    }
}
