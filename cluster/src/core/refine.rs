//! Samples at refinements of the rig: ordered where views have holes, brought to where views are composed.
//!
//! `placement` decides which; here is who renders each and who fetches it from where.

use std::collections::{BTreeMap, BTreeSet};

use argus_scene::SampleId;

use super::directory::Known;
use super::event::{Action, Source, WorkerId};
use super::lines::Turn;
use super::machine::Core;
use super::placement::Budget;
use super::time::Uptime;
use super::worker::Worker;

/// At most so many refinements, however small a sample is: every one stands in every worker's assignment.
const MOST_REFINEMENTS: u64 = 512;

/// The share of the time that is to spare which refinements may take: they have to be brought to those who compose, too,
/// and demand comes in waves.
const OF_SPARE: f64 = 0.5;

/// … and of their own share what they may take however busy everybody is: where all is holes, no view is worth its time.
const ALWAYS: f64 = 0.1;

/// The least bytes of a texel: radiance and inverse range. What is shaded per view takes more.
const TEXEL_BYTES: u64 = 8;

impl Core {
    /// Ticks have passed: places the samples that the budget allows. S counts them.
    pub(super) fn place_samples(&mut self, ticks: f64) {
        let samplers = self.lines.samplers().len();
        if samplers == 0 || !(self.config.refining_share > 0.0) {
            return;
        }
        let secs = self.believed_costs().sample_secs;
        let share = self.config.refining_share * self.config.tick.as_secs_f64() * samplers as f64;
        let time = ticks * share.min((OF_SPARE * self.spare_secs(samplers)).max(ALWAYS * share));
        // Until a sample's cost is known, one at a time.
        let per_tick = if secs > 0.0 { time / secs } else { 1.0 };
        let most = (self.config.refining_bytes / self.sample_bytes().max(1)).min(MOST_REFINEMENTS) as usize;
        let most = most.min(self.refinements_an_epoch(self.config.refining_share, samplers, secs));
        let placed = self.placement.tick(Budget { per_tick, most });
        self.rates.samples.count(placed as u64);
    }

    /// Texel bytes of a sample, as workers report them: were they thought smaller than they are, workers would forget samples
    /// in use to make room for refinements, and render them again.
    pub(super) fn sample_bytes(&self) -> u64 {
        let reported = self.workers.values().map(|worker| worker.report.sample_bytes).max().unwrap_or(0);
        reported.max(self.set.rig.sample_texels() * TEXEL_BYTES)
    }

    /// Seconds of a tick in which those who could render refinements have nothing else to do.
    fn spare_secs(&self, samplers: usize) -> f64 {
        let (demand, costs) = (self.demand(), self.believed_costs());
        let from_triangles = demand.direct * costs.direct_secs + demand.rays * costs.ray_secs;
        // Where samplers compose, views are everybody's.
        let (workers, busy_secs) = match self.config.samplers_composite {
            true => (self.lines.ready(), from_triangles + demand.views * costs.view_secs),
            false => (samplers, from_triangles),
        };
        (workers as f64 * self.config.tick.as_secs_f64() - busy_secs).max(0.0)
    }

    /// Tells workers what to have at hand, where that is news, and sees what views may use.
    pub(super) fn refine(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        self.to_refine = false;
        // The last view in a past epoch may have been answered since the next one was served. Whoever is told to have its samples,
        // and that none so old are of use, would drop them and render them again.
        let needed: BTreeSet<u64> = self.in_flight.epochs().collect();
        self.epochs.retire(|epoch| needed.contains(&epoch));
        // Refinements are for all who compose, each told once whoever feeds it has the sample: there is no hurry. What
        // the next epoch needs is for those who compose from the last one; they are told at once, and wait. So is who gets
        // a second copy.
        let mut wanted: BTreeMap<SampleId, Option<Vec<WorkerId>>> =
            self.prepared().into_iter().map(|(id, readers)| (id, Some(readers))).collect();
        wanted.extend(self.copies(now).into_iter().map(|(id, readers)| (id, Some(readers))));
        wanted.extend(self.placement.placed().map(|index| (self.refined(index), None)));
        self.spread.retain(|id| wanted.contains_key(&id) || self.whereabouts.is_on_its_way(id));
        let mut lists: BTreeMap<WorkerId, Vec<Source>> = BTreeMap::new();
        let mut to_render = Vec::new();
        for (id, readers) in wanted {
            let known = Known { workers: &self.workers, lines: &self.lines, whereabouts: &self.whereabouts };
            let Some(owner) = self.directory.owner(id, known, now) else { continue };
            // A new owner fetches as well, from those who have it from the old one.
            let answers = |worker: &WorkerId| self.workers.get(worker).is_some_and(|w| !w.suspected);
            let holder = match self.whereabouts.has(id, owner) {
                true => Some(owner),
                false => self.whereabouts.holders(id).find(answers),
            };
            if holder.is_none() {
                to_render.push(id);
            }
            let address = |worker: WorkerId| self.workers.get(&worker).map(|w| w.hello.address.clone());
            let from = holder.filter(|holder| *holder != owner).and_then(address);
            let addresses = from.into_iter().collect();
            lists.entry(owner).or_default().push(Source { id, addresses, dispensable: false });
            let root = holder.unwrap_or(owner);
            let reads = |worker: &WorkerId| *worker != owner && *worker != root;
            let hurry = readers.is_some();
            let readers: Vec<WorkerId> = match (readers, holder) {
                (Some(readers), _) => readers.into_iter().filter(reads).collect(),
                (None, Some(_)) => {
                    let composes = |w: &&Worker| w.takes_views() && reads(&w.id);
                    self.workers.values().filter(composes).map(|w| w.id).collect()
                }
                (None, None) => Vec::new(),
            };
            let Some(root_address) = address(root) else { continue };
            // Trees of different samples have different roots and leaves, so that nobody feeds others with all.
            let tree = self.spread.tree(id);
            let turn = id.index.wrapping_mul(0x9e37_79b9_7f4a_7c15) % readers.len().max(1) as u64;
            for reader in readers.iter().cycle().skip(turn as usize).take(readers.len()) {
                let parent = tree.parent(*reader).filter(|p| *p != root && answers(p));
                let (has, fed) = (
                    self.whereabouts.has(id, *reader),
                    parent.is_none_or(|p| hurry || self.whereabouts.has(id, p)),
                );
                if !(has || fed) {
                    continue;
                }
                let mut addresses: Vec<String> = parent.and_then(address).into_iter().collect();
                addresses.push(root_address.clone());
                lists.entry(*reader).or_default().push(Source { id, addresses, dispensable: false });
            }
        }
        self.whereabouts.order(to_render.into_iter());
        let kept_from = self.kept_from();
        let suspected = self.workers.values().filter(|w| w.suspected);
        let suspected: Vec<String> = suspected.map(|w| w.hello.address.clone()).collect();
        // What a list leaves out is forgotten. So who seems to hang is told nothing until it is heard of again, and all keep
        // what they have while nobody samples: that moment passes.
        let nobody_samples = self.lines.samplers().is_empty();
        for worker in self.workers.values_mut().filter(|w| w.answers()) {
            let list = match nobody_samples {
                true => {
                    let ahead = worker.assigned().ahead.iter();
                    ahead.filter(|source| source.id.epoch >= kept_from).cloned().collect()
                }
                false => lists.remove(&worker.id).unwrap_or_default(),
            };
            if let Some(assignment) = worker.order_ahead(list, kept_from, &suspected) {
                actions.push(Action::Assign { worker: worker.id, assignment });
            }
        }
        let (lines, whereabouts, set) = (&self.lines, &self.whereabouts, &self.set);
        let refined = |index| SampleId { epoch: set.epoch, generation: set.generation, index };
        // Samplers are few; all others who have a sample compose.
        let held_by = |index| {
            let id = refined(index);
            let only_samples = |t: &&Turn| whereabouts.has(id, t.worker) && !lines.compositors().contains(t);
            whereabouts.count(id) - lines.samplers().iter().filter(only_samples).count()
        };
        let readers = lines.compositors().len();
        // A view that goes to one of the few who lack it fetches it like any other sample.
        self.placement
            .update(|index| readers > 0 && 2 * held_by(index) >= readers, |index| held_by(index) > 0);
    }

    fn refined(&self, index: u64) -> SampleId {
        SampleId { epoch: self.set.epoch, generation: self.set.generation, index }
    }
}
