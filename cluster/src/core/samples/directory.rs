//! The owner of each sample, and where other workers fetch it.
//!
//! Every sample has an *owner*, the sampler that renders it if no worker holds it. It is the sampler that would first
//! have rendered its share of the version, by how many samples it owns and how long one takes. Ties are broken by
//! rendezvous hashing of (sample, worker name). Hashing alone would often give one of two samplers three of four
//! samples, and the stage is as slow as its busiest worker. An owner stays one, so a sampler that joins or leaves
//! moves only its own share. Samples of a static scene are rendered once: as long as any worker holds one, it is
//! served from there, and S does not count it again.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use argus_scene::{FaceMask, SampleId};

use super::distribution::DistributionTrees;
use super::locations::SampleLocations;
use crate::core::event::{Source, WorkerId};
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// A sample that no worker holds is forgotten this long after its last use.
const FORGET_AFTER: Duration = Duration::from_secs(60);

/// Most remembered samples; the longest unused are forgotten first.
const MOST_REMEMBERED: usize = 1 << 16;

#[derive(Debug, Clone, Copy)]
struct Entry {
    owner: WorkerId,
    used: Uptime,
}

/// The owners of recently used samples.
#[derive(Debug, Clone, Default)]
pub(super) struct Directory {
    owners: BTreeMap<SampleId, Entry>,
    /// Number of samples of a version that each sampler owns.
    shares: HashMap<(u64, WorkerId), usize>,
}

/// Rendezvous weight: FNV-1a over the worker's name and the sample, with a finaliser that mixes all bits. Fixed here,
/// since owners must not depend on a process's hash seed.
fn weight(name: &str, id: SampleId) -> u64 {
    let words = id.camera.to_le_bytes().into_iter();
    let hash = name.bytes().chain(words).fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    // The finaliser of MurmurHash3 (Appleby, public domain).
    let hash = (hash ^ (hash >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let hash = (hash ^ (hash >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    hash ^ (hash >> 33)
}

/// Most holders of a sample in an order, beside its owner: more only make orders long.
const MOST_NAMED: usize = 3;

/// Inputs of the directory: the workers, and who holds which samples.
#[derive(Clone, Copy)]
pub(super) struct Inputs<'a> {
    pub(super) workers: &'a Workers,
    pub(super) locations: &'a SampleLocations,
}

impl Directory {
    /// The owner of a sample, chosen now if it has none; `None` without samplers.
    pub(super) fn owner(&mut self, id: SampleId, inputs: Inputs<'_>, now: Uptime) -> Option<WorkerId> {
        let before = self.owners.get(&id).and_then(|entry| inputs.workers.get(entry.owner));
        let owner = match before.filter(|w| w.takes_samples()) {
            Some(owner) => owner.id(),
            None => self.best_owner(id, inputs)?,
        };
        self.set(id, Entry { owner, used: now });
        Some(owner)
    }

    /// The best owner of a sample: a sampler that holds it, or else the one that would have it first.
    fn best_owner(&self, id: SampleId, inputs: Inputs<'_>) -> Option<WorkerId> {
        let samplers =
            inputs.workers.queues().samplers().iter().filter_map(|entry| inputs.workers.get(entry.worker));
        let done_ms = |w: &Worker| {
            let share = self.shares.get(&(id.version, w.id())).copied().unwrap_or(0);
            (share + 1) as f64 * w.report().sample_ms.or(w.report().direct_ms).unwrap_or(1.0)
        };
        samplers
            .map(|w| {
                (
                    inputs.locations.faces(id, w.id()).is_empty(),
                    done_ms(w),
                    std::cmp::Reverse(weight(&w.hello().name, id)),
                    w.id(),
                )
            })
            .min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))))
            .map(|best| best.3)
    }

    fn set(&mut self, id: SampleId, entry: Entry) {
        let before = self.owners.insert(id, entry).map(|before| before.owner);
        if before != Some(entry.owner) {
            before.into_iter().for_each(|owner| self.unshare(id, owner));
            *self.shares.entry((id.version, entry.owner)).or_default() += 1;
        }
    }

    fn unshare(&mut self, id: SampleId, owner: WorkerId) {
        if let Some(share) = self.shares.get_mut(&(id.version, owner)) {
            *share -= 1;
            if *share == 0 {
                self.shares.remove(&(id.version, owner));
            }
        }
    }

    /// Keeps some samples, and forgets the other ones.
    fn retain(&mut self, mut stays: impl FnMut(&SampleId, &Entry) -> bool) {
        let mut gone = Vec::new();
        self.owners.retain(|id, entry| {
            let stays = stays(id, entry);
            if !stays {
                gone.push((*id, entry.owner));
            }
            stays
        });
        gone.into_iter().for_each(|(id, owner)| self.unshare(id, owner));
    }

    /// Where worker `reader` finds sample `id`, and whether it must be rendered for this, in which case S counts it.
    ///
    /// Best first: its parent in the tree, if other workers wait for the sample as well ([`super::distribution`]);
    /// the owner, if it holds the sample or no worker does; other holders; then an owner that would have to render
    /// it. Without samplers, the reader renders it itself.
    pub(super) fn locate(
        &mut self,
        id: SampleId,
        reader: WorkerId,
        inputs: Inputs<'_>,
        trees: &mut DistributionTrees,
        now: Uptime,
    ) -> (Source, bool) {
        let Inputs { workers, locations, .. } = inputs;
        let anyone_holds = locations.is_held(id);
        let on_its_way = locations.is_on_its_way(id);
        // An owner stays one while it holds the sample, renders it, or would render it again.
        let before =
            self.owners.get(&id).and_then(|entry| workers.get(entry.owner)).filter(|w| !w.is_suspected());
        let owner = match before.filter(|w| locations.has(id, w.id()) || on_its_way || w.takes_samples()) {
            Some(owner) => owner.id(),
            None => self.best_owner(id, inputs).unwrap_or(reader),
        };
        self.set(id, Entry { owner, used: now });
        let to_render = !anyone_holds && !on_its_way;
        let remote_owner = workers.get(owner).filter(|w| w.id() != reader);
        let owner_first = !anyone_holds || remote_owner.is_some_and(|w| locations.has(id, w.id()));
        // Only workers that lack the sample have a place in the tree. Others would fetch it only if they lost it.
        let parent = match locations.has(id, reader) || owner == reader {
            true => None,
            false => trees.tree(id).parent(reader).filter(|parent| *parent != owner),
        };
        // A worker that dropped the sample cannot pass it on.
        let parent = parent.filter(|parent| locations.is_near(id, *parent));
        let awake = |worker: WorkerId| workers.get(worker).filter(|w| !w.is_suspected());
        let parent = parent.and_then(awake);
        // Each reader starts at another holder, to spread the load.
        let near =
            locations.near(id, reader).filter(|w| locations.has(id, *w) && *w != reader && *w != owner);
        let others = near.filter_map(awake).take(MOST_NAMED);
        let mut ranked: Vec<&Worker> = parent.into_iter().collect();
        match owner_first {
            true => ranked.extend(remote_owner.into_iter().chain(others)),
            false => ranked.extend(others.chain(remote_owner)),
        }
        let mut addresses: Vec<String> = Vec::with_capacity(ranked.len());
        for worker in ranked {
            if !addresses.contains(&worker.hello().address) {
                addresses.push(worker.hello().address.clone());
            }
        }
        (Source { id, faces: FaceMask::ALL, addresses, dispensable: false }, to_render)
    }

    /// Where worker `reader` finds a dispensable sample: only at workers that hold it.
    pub(super) fn among_holders(id: SampleId, reader: WorkerId, inputs: Inputs<'_>) -> Source {
        let Inputs { workers, locations, .. } = inputs;
        let holds = |worker: &WorkerId| *worker != reader && locations.has(id, *worker);
        let holders = locations.near(id, reader).filter(holds).filter_map(|worker| workers.get(worker));
        let holders = holders.filter(|worker| !worker.is_suspected()).take(MOST_NAMED);
        let addresses = holders.map(|worker| worker.hello().address.clone()).collect();
        Source { id, faces: FaceMask::ALL, addresses, dispensable: true }
    }

    /// Whether a worker is the owner of a sample.
    pub(super) fn is_owner(&self, worker: WorkerId, id: SampleId) -> bool {
        self.owners.get(&id).is_some_and(|entry| entry.owner == worker)
    }

    /// Number of samples that each worker owns: at most so many must be rendered again without it.
    pub(super) fn owned(&self) -> HashMap<WorkerId, usize> {
        let mut owned = HashMap::new();
        self.owners.values().for_each(|entry| *owned.entry(entry.owner).or_default() += 1);
        owned
    }

    /// Forgets samples of versions below this number.
    pub(super) fn retire(&mut self, before_version: u64) {
        self.retain(|id, _| id.version >= before_version);
    }

    /// Forgets unused samples.
    pub(super) fn prune(&mut self, locations: &SampleLocations, now: Uptime) {
        self.retain(|id, entry| {
            now.since(entry.used) < FORGET_AFTER || !locations.faces_held(*id).is_empty()
        });
        if self.owners.len() > MOST_REMEMBERED {
            let mut ages: Vec<(Uptime, SampleId)> = self.owners.iter().map(|(id, e)| (e.used, *id)).collect();
            ages.sort_unstable();
            let most = self.owners.len() - MOST_REMEMBERED;
            for (_, id) in ages.into_iter().take(most) {
                if let Some(entry) = self.owners.remove(&id) {
                    self.unshare(id, entry.owner);
                }
            }
        }
    }
}
