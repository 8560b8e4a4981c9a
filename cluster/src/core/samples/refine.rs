//! Samples at refinements of the rig: ordered where views have holes, brought to where views are composed.
//!
//! `placement` decides which; here is who renders each and who fetches it from where.

use std::collections::BTreeMap;

use argus_scene::SampleId;

use super::directory::Known;
use super::placement::Budget;
use super::{NeededVersions, Samples};
use crate::core::event::{Source, WorkerId};
use crate::core::time::Uptime;
use crate::core::workers::{PrefetchLists, QueueEntry, Worker, Workers};

/// At most so many refinements, however small a sample is: every one stands in every worker's assignment.
const MOST_REFINEMENTS: u64 = 512;

/// The share of the time that is to spare which refinements may take: they have to be brought to those who compose, too,
/// and demand comes in waves.
const OF_SPARE: f64 = 0.5;

/// The part of their own share that refinements may take however busy everybody is: where all is holes, no view is worth
/// its time.
const ALWAYS: f64 = 0.1;

/// The least bytes of a texel: radiance and inverse range. What is shaded per view takes more.
const TEXEL_BYTES: u64 = 8;

/// What each worker shall have at hand.
type Lists = BTreeMap<WorkerId, Vec<Source>>;

/// The workers that read a sample beside its owner.
#[derive(Debug)]
enum Readers {
    /// These, told at once; each waits until its parent has the sample. The next version's samples are for those that compose
    /// from the last one's, and a second copy is for one worker.
    AtOnce(Vec<WorkerId>),
    /// All that compose, each told once its parent has the sample: there is no hurry with refinements.
    InTime,
}

impl Samples {
    /// Ticks have passed: places the samples that the budget allows; how many.
    pub(super) fn place(&mut self, workers: &Workers, ticks: f64) -> usize {
        let samplers = workers.queues().samplers().len();
        if samplers == 0 || !(self.config.refining_share > 0.0) {
            return 0;
        }
        let secs = workers.believed_costs().sample_secs;
        let share = self.config.refining_share * self.config.tick.as_secs_f64() * samplers as f64;
        let time = ticks * share.min((OF_SPARE * self.spare_secs(workers, samplers)).max(ALWAYS * share));
        // Until a sample's cost is known, one at a time.
        let per_tick = if secs > 0.0 { time / secs } else { 1.0 };
        let most =
            (self.config.refining_bytes / self.sample_bytes(workers).max(1)).min(MOST_REFINEMENTS) as usize;
        let most = most.min(self.refinements_an_epoch(self.config.refining_share, samplers, secs));
        self.placement.tick(Budget { per_tick, most })
    }

    /// Texel bytes of a sample, as workers report them: were they thought smaller than they are, workers would forget samples
    /// in use to make room for refinements, and render them again.
    pub(super) fn sample_bytes(&self, workers: &Workers) -> u64 {
        let reported = workers.iter().map(|worker| worker.report().sample_bytes).max().unwrap_or(0);
        reported.max(self.set.rig.sample_texels() * TEXEL_BYTES)
    }

    /// Seconds of a tick in which those who could render refinements have nothing else to do.
    fn spare_secs(&self, workers: &Workers, samplers: usize) -> f64 {
        let (demand, costs) = (workers.demand(), workers.believed_costs());
        let from_triangles = demand.direct * costs.direct_secs + demand.rays * costs.ray_secs;
        // Where samplers compose, views are everybody's.
        let (hands, busy_secs) = match self.config.samplers_composite {
            true => (workers.queues().ready(), from_triangles + demand.views * costs.view_secs),
            false => (samplers, from_triangles),
        };
        (hands as f64 * self.config.tick.as_secs_f64() - busy_secs).max(0.0)
    }

    /// What workers shall have at hand; sees what views may use, too.
    pub(in crate::core) fn refine(
        &mut self,
        workers: &Workers,
        needed: &NeededVersions,
        now: Uptime,
    ) -> PrefetchLists {
        self.changed = false;
        // The last view in a past version may have been answered since the next one was served. Whoever is told to have its samples,
        // and that none so old are of use, would drop them and render them again.
        self.versions.retire(|number| needed.contains(number));
        let wanted = self.wanted(workers, now);
        self.trees.retain(|id| wanted.contains_key(&id) || self.locations.is_on_its_way(id));
        let mut lists = Lists::new();
        let mut to_render = Vec::new();
        for (id, readers) in wanted {
            let known = Known { workers, locations: &self.locations };
            let Some(owner) = self.directory.owner(id, known, now) else { continue };
            // A new owner fetches as well, from those who have it from the old one.
            let holder = match self.locations.has(id, owner) {
                true => Some(owner),
                false => self.locations.holders(id).find(|worker| responds(*worker, workers)),
            };
            if holder.is_none() {
                to_render.push(id);
            }
            self.list(id, (owner, holder), readers, workers, &mut lists);
        }
        self.locations.order(to_render.into_iter());
        self.see_what_is_there(workers);
        let suspected = workers.iter().filter(|w| w.is_suspected());
        let suspected = suspected.map(|w| w.hello().address.clone()).collect();
        let kept_from = self.kept_from(needed);
        PrefetchLists { lists: told(lists, kept_from, workers), kept_from, suspected }
    }

    /// The samples that workers shall have at hand, each with the workers that read it beside its owner.
    fn wanted(&mut self, workers: &Workers, now: Uptime) -> BTreeMap<SampleId, Readers> {
        let copies = self.copies(workers, now);
        let at_once = self.prepared(workers).into_iter().chain(copies);
        let mut wanted: BTreeMap<SampleId, Readers> =
            at_once.map(|(id, readers)| (id, Readers::AtOnce(readers))).collect();
        wanted.extend(self.placement.placed().map(|index| (self.served(index), Readers::InTime)));
        wanted
    }

    /// Puts a sample on the lists of its owner and of its readers, each with the addresses where it finds it.
    fn list(
        &mut self,
        id: SampleId,
        (owner, holder): (WorkerId, Option<WorkerId>),
        readers: Readers,
        workers: &Workers,
        lists: &mut Lists,
    ) {
        let address = |worker: WorkerId| workers.get(worker).map(|w| w.hello().address.clone());
        let from = holder.filter(|holder| *holder != owner).and_then(address);
        let source = Source { id, addresses: from.into_iter().collect(), dispensable: false };
        lists.entry(owner).or_default().push(source);
        let root = holder.unwrap_or(owner);
        let reads = |worker: &WorkerId| *worker != owner && *worker != root;
        let (readers, hurry): (Vec<WorkerId>, bool) = match readers {
            Readers::AtOnce(readers) => (readers.into_iter().filter(reads).collect(), true),
            Readers::InTime if holder.is_some() => {
                let compose = workers.iter().filter(|w| w.takes_views()).map(Worker::id);
                (compose.filter(reads).collect(), false)
            }
            Readers::InTime => return,
        };
        let Some(root_address) = address(root) else { return };
        // Trees of different samples have different roots and leaves, so that no worker feeds others with all.
        let tree = self.trees.tree(id);
        let first = id.camera.wrapping_mul(0x9e37_79b9_7f4a_7c15) % readers.len().max(1) as u64;
        for reader in readers.iter().cycle().skip(first as usize).take(readers.len()) {
            let parent = tree.parent(*reader).filter(|p| *p != root && responds(*p, workers));
            let is_fed = parent.is_none_or(|p| hurry || self.locations.has(id, p));
            if !(is_fed || self.locations.has(id, *reader)) {
                continue;
            }
            let addresses = parent.and_then(address).into_iter().chain([root_address.clone()]).collect();
            lists.entry(*reader).or_default().push(Source { id, addresses, dispensable: false });
        }
    }

    /// Sees which refinements views may use: those that most of the workers have that compose.
    fn see_what_is_there(&mut self, workers: &Workers) {
        let (locations, queues) = (&self.locations, workers.queues());
        let version = self.set.version.number;
        // Samplers are few; all others who have a sample compose.
        let held_by = |camera| {
            let id = SampleId { version, camera };
            let only_samples = |t: &&QueueEntry| locations.has(id, t.worker) && !queues.compositors().contains(t);
            locations.count(id) - queues.samplers().iter().filter(only_samples).count()
        };
        let readers = queues.compositors().len();
        // A view that goes to one of the few who lack it fetches it like any other sample.
        self.placement
            .update(|index| readers > 0 && 2 * held_by(index) >= readers, |index| held_by(index) > 0);
    }
}

/// Whether a worker is there and not suspected.
fn responds(worker: WorkerId, workers: &Workers) -> bool {
    workers.get(worker).is_some_and(|w| !w.is_suspected())
}

/// What each worker is told. What a list leaves out is forgotten: so a worker that seems to hang is told nothing until it is
/// heard of again, and all keep what they have while no worker samples, which passes.
fn told(mut lists: Lists, kept_from: u64, workers: &Workers) -> Lists {
    let nobody_samples = workers.queues().samplers().is_empty();
    let mut list_of = |worker: &Worker| match nobody_samples {
        true => {
            let prefetch = worker.assigned().prefetch.iter();
            prefetch.filter(|source| source.id.version >= kept_from).cloned().collect()
        }
        false => lists.remove(&worker.id()).unwrap_or_default(),
    };
    workers.iter().filter(|w| w.answers()).map(|worker| (worker.id(), list_of(worker))).collect()
}
