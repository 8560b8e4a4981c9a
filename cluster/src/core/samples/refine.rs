//! Prefetch lists: refinements where views have holes, samples of prepared versions, and second copies.
//!
//! `placement` decides which refinements exist. This module decides which worker renders each sample, and which ones
//! fetch it from where.

use std::collections::BTreeMap;

use argus_scene::{FaceMask, SampleId};

use super::directory::Inputs;
use super::placement::Budget;
use super::{NeededVersions, Samples};
use crate::core::event::{Source, WorkerId};
use crate::core::time::Uptime;
use crate::core::workers::{PrefetchLists, QueueEntry, Worker, Workers};

/// Most refinements, however small a sample is: each is in every worker's assignment.
const MOST_REFINEMENTS: u64 = 512;

/// Share of the spare time that refinements may take: they must also be distributed, and demand fluctuates.
const OF_SPARE: f64 = 0.5;

/// Part of their share that refinements may always take, however busy the workers are: where holes dominate, views
/// are not worth their time.
const ALWAYS: f64 = 0.1;

/// Least bytes of a texel: radiance and inverse range. What is shaded per view takes more.
const TEXEL_BYTES: u64 = 8;

/// The prefetch list of each worker.
type Lists = BTreeMap<WorkerId, Vec<Source>>;

/// A sample that workers shall have at hand.
#[derive(Debug)]
struct Wanted {
    /// Its faces.
    faces: FaceMask,
    readers: Readers,
}

/// The workers that fetch a sample from its owner.
#[derive(Debug)]
enum Readers {
    /// These workers at once; each waits until its parent has the sample. For the next version's samples, they
    /// are the workers that compose from the last one's. For a second copy, it is one worker.
    AtOnce(Vec<WorkerId>),
    /// All compositors, each once its parent has the sample: refinements are not urgent.
    InTime,
}

impl Samples {
    /// Closes a tick: places samples within the budget. Returns their number.
    pub(super) fn place(&mut self, workers: &Workers, ticks: f64) -> usize {
        let samplers = workers.queues().samplers().len();
        if samplers == 0 || !(self.config.refining_share > 0.0) {
            return 0;
        }
        let secs = workers.believed_costs().sample_secs;
        let share = self.config.refining_share * self.config.tick.as_secs_f64() * samplers as f64;
        let time = ticks * share.min((OF_SPARE * self.spare_secs(workers, samplers)).max(ALWAYS * share));
        // Until the cost of a sample is known, one is placed at a time.
        let per_tick = if secs > 0.0 { time / secs } else { 1.0 };
        let most =
            (self.config.refining_bytes / self.sample_bytes(workers).max(1)).min(MOST_REFINEMENTS) as usize;
        let most = most.min(self.refinements_an_epoch(self.config.refining_share, samplers, secs));
        self.placement.tick(Budget { per_tick, most })
    }

    /// Texel bytes of a sample, as workers report them. If they were underestimated, workers would drop samples in
    /// use to make room for refinements, and render them again.
    pub(super) fn sample_bytes(&self, workers: &Workers) -> u64 {
        let reported = workers.iter().map(|worker| worker.report().sample_bytes).max().unwrap_or(0);
        reported.max(self.set.rig.sample_texels() * TEXEL_BYTES)
    }

    /// Spare seconds per tick of the workers that can render refinements.
    fn spare_secs(&self, workers: &Workers, samplers: usize) -> f64 {
        let (demand, costs) = (workers.demand(), workers.believed_costs());
        let from_triangles = demand.direct * costs.direct_secs + demand.rays * costs.ray_secs;
        // If samplers compose, all workers answer views.
        let (hands, busy_secs) = match self.config.samplers_composite {
            true => (workers.queues().ready(), from_triangles + demand.views * costs.view_secs),
            false => (samplers, from_triangles),
        };
        (hands as f64 * self.config.tick.as_secs_f64() - busy_secs).max(0.0)
    }

    /// Makes the prefetch lists, and updates which refinements views may use.
    pub(in crate::core) fn refine(
        &mut self,
        workers: &Workers,
        needed: &NeededVersions,
        now: Uptime,
    ) -> PrefetchLists {
        self.changed = false;
        // The last view of an older version may have been answered since the next version was served. A worker that
        // must hold its samples and drop such old versions would drop them and render them again.
        self.versions.retire(|number| needed.contains(number));
        let wanted = self.wanted(workers, now);
        self.trees.retain(|id| wanted.contains_key(&id) || self.locations.is_on_its_way(id));
        let mut lists = Lists::new();
        let mut to_render = Vec::new();
        for (id, wanted) in wanted {
            let faces = wanted.faces;
            let inputs = Inputs { workers, locations: &self.locations };
            let Some(owner) = self.directory.owner(id, inputs, now) else { continue };
            // A new owner also fetches it, from workers that got it from the old one.
            let holder = match self.locations.faces(id, owner).contains(faces) {
                true => Some(owner),
                false => self.locations.holders_of(id, faces).find(|worker| responds(*worker, workers)),
            };
            if holder.is_none() {
                to_render.push((id, faces));
            }
            self.list(id, (owner, holder), wanted, workers, &mut lists);
        }
        self.locations.order(to_render.into_iter());
        self.see_what_is_there(workers);
        let suspected = workers.iter().filter(|w| w.is_suspected());
        let suspected = suspected.map(|w| w.hello().address.clone()).collect();
        let kept_from = self.kept_from(needed);
        PrefetchLists { lists: sent_lists(lists, kept_from, workers), kept_from, suspected }
    }

    /// The samples to prefetch, each with the workers that fetch it from its owner.
    fn wanted(&mut self, workers: &Workers, now: Uptime) -> BTreeMap<SampleId, Wanted> {
        let copies = self.copies(workers, now);
        let at_once = self.prepared(workers).into_iter().chain(copies);
        let at_once = at_once.map(|(id, readers)| (id, Readers::AtOnce(readers)));
        let placed: Vec<u64> = self.placement.placed().collect();
        // A view from any of them looks up the reflection probes, too.
        let probes = self.set.reflections.filter(|_| !placed.is_empty()).map(|_| SampleId::REFLECTION_PROBES);
        let in_time = placed.into_iter().chain(probes).map(|index| (self.served(index), Readers::InTime));
        let with_faces = |(id, readers): (SampleId, Readers)| {
            (id, Wanted { faces: self.faces_prepared(id.camera), readers })
        };
        at_once.chain(in_time).map(with_faces).collect()
    }

    /// The faces of a camera's sample that workers shall have at hand: all of one that plans named whose request asks for
    /// samples, and else those that it was placed for.
    pub(super) fn faces_prepared(&self, camera: u64) -> FaceMask {
        let is_named = self.versions.is_used(camera) || self.recent.is_used(camera);
        let placed = self.placement.faces(camera).filter(|_| !is_named);
        placed.unwrap_or(FaceMask::ALL)
    }

    /// Adds a sample to the lists of its owner and of its readers, each with the addresses where it finds it.
    fn list(
        &mut self,
        id: SampleId,
        (owner, holder): (WorkerId, Option<WorkerId>),
        Wanted { faces, readers }: Wanted,
        workers: &Workers,
        lists: &mut Lists,
    ) {
        let address = |worker: WorkerId| workers.get(worker).map(|w| w.hello().address.clone());
        let from = holder.filter(|holder| *holder != owner).and_then(address);
        let source = Source { id, faces, addresses: from.into_iter().collect(), dispensable: false };
        lists.entry(owner).or_default().push(source);
        let root = holder.unwrap_or(owner);
        let reads = |worker: &WorkerId| *worker != owner && *worker != root;
        let (readers, hurry): (Vec<WorkerId>, bool) = match readers {
            Readers::AtOnce(readers) => (readers.into_iter().filter(reads).collect(), true),
            Readers::InTime => {
                let compose = workers.iter().filter(|w| w.takes_views()).map(Worker::id);
                (compose.filter(reads).collect(), false)
            }
        };
        let Some(root_address) = address(root) else { return };
        // Trees of different samples have different roots and leaves, so that no worker sends all samples.
        let tree = self.trees.tree(id);
        let first = id.camera.wrapping_mul(0x9e37_79b9_7f4a_7c15) % readers.len().max(1) as u64;
        for reader in readers.iter().cycle().skip(first as usize).take(readers.len()) {
            let parent = tree.parent(*reader).filter(|p| *p != root && responds(*p, workers));
            let has = |worker| self.locations.faces(id, worker).contains(faces);
            let is_fed = hurry || (holder.is_some() && parent.is_none_or(has));
            // Until the missing faces are where it gets them from, a reader keeps those that it has.
            let faces = if is_fed { faces } else { self.locations.faces(id, *reader) };
            if faces.is_empty() {
                continue;
            }
            let addresses = parent.and_then(address).into_iter().chain([root_address.clone()]).collect();
            lists.entry(*reader).or_default().push(Source { id, faces, addresses, dispensable: false });
        }
    }

    /// Updates which refinements views may use: those that most compositors hold.
    fn see_what_is_there(&mut self, workers: &Workers) {
        let (locations, queues) = (&self.locations, workers.queues());
        let version = self.set.version.number;
        // Samplers are few; all other holders are compositors.
        let held_by = |camera, faces| {
            let id = SampleId { version, camera };
            let has = |worker| locations.faces(id, worker).contains(faces);
            let only_samples = |t: &&QueueEntry| has(t.worker) && !queues.compositors().contains(t);
            locations.holders_of(id, faces).count() - queues.samplers().iter().filter(only_samples).count()
        };
        let readers = queues.compositors().len();
        // A view at one of the few compositors that lack it fetches it like any other sample.
        let by_most = |index, faces| readers > 0 && 2 * held_by(index, faces) >= readers;
        self.placement.update(by_most, |index, faces| held_by(index, faces) > 0);
    }
}

/// Whether a worker is joined and not suspected.
fn responds(worker: WorkerId, workers: &Workers) -> bool {
    workers.get(worker).is_some_and(|w| !w.is_suspected())
}

/// The lists that are sent. A worker drops what its list omits, so a suspected worker gets no list until it is heard
/// again. All workers keep their samples while there is no sampler, which is temporary.
fn sent_lists(mut lists: Lists, kept_from: u64, workers: &Workers) -> Lists {
    let no_worker_samples = workers.queues().samplers().is_empty();
    let mut list_of = |worker: &Worker| match no_worker_samples {
        true => {
            let prefetch = worker.assigned().prefetch.iter();
            prefetch.filter(|source| source.id.version >= kept_from).cloned().collect()
        }
        false => lists.remove(&worker.id()).unwrap_or_default(),
    };
    workers.iter().filter(|w| w.answers()).map(|worker| (worker.id(), list_of(worker))).collect()
}
