//! Which sampler renders which sample, and who else has it.
//!
//! Every sample has an *owner*, the sampler that renders it where nobody holds it. Owners are chosen by
//! rendezvous hashing of (sample, worker name): each sampler gets an equal share, the choice needs no memory,
//! and a sampler that comes or goes moves only its own share. The samples of a static scene are rendered
//! once: as long as anybody holds one, it is served from there, and S does not count it again.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::SampleId;

use super::event::{Source, WorkerId};
use super::time::Uptime;
use super::worker::Worker;

/// A sample nobody asked for in this long, and nobody holds, is forgotten.
const FORGET_AFTER: Duration = Duration::from_secs(60);

/// At most this many samples are remembered; the longest unused are forgotten first.
const MOST_REMEMBERED: usize = 1 << 16;

#[derive(Debug, Clone, Copy)]
struct Entry {
    owner: WorkerId,
    used: Uptime,
}

/// The owners of the samples that were asked for lately.
#[derive(Debug, Clone, Default)]
pub(super) struct Directory {
    owners: BTreeMap<SampleId, Entry>,
}

/// Rendezvous weight: FNV-1a over the worker's name and the sample, finished by a mix that spreads it over
/// all bits. Fixed here, since owners must not depend on a process's hash seed.
fn weight(name: &str, id: SampleId) -> u64 {
    let words = id.generation.to_le_bytes().into_iter().chain(id.index.to_le_bytes());
    let hash = name.bytes().chain(words).fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    // The finaliser of MurmurHash3 (Appleby, public domain).
    let hash = (hash ^ (hash >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let hash = (hash ^ (hash >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    hash ^ (hash >> 33)
}

impl Directory {
    /// Who renders a sample, chosen now if nobody was; `None` where nobody samples.
    pub(super) fn owner(
        &mut self,
        id: SampleId,
        workers: &BTreeMap<WorkerId, Worker>,
        now: Uptime,
    ) -> Option<WorkerId> {
        let held_by = |w: &Worker| w.held.contains(&id);
        let known = self.owners.get(&id).and_then(|entry| workers.get(&entry.owner));
        let owner = match known.filter(|w| w.takes_samples()) {
            Some(owner) => owner.id,
            None => {
                let best = |w: &&Worker| (held_by(w), weight(&w.hello.name, id), w.id);
                workers.values().filter(|w| w.takes_samples()).max_by_key(best)?.id
            }
        };
        self.owners.insert(id, Entry { owner, used: now });
        Some(owner)
    }

    /// Where worker `reader` finds sample `id`, and whether it has to be rendered for this (then S counts it).
    ///
    /// Best first: the owner if it holds the sample or nobody does; others that hold it; then an owner that
    /// would have to render it. Without any sampler the reader renders it itself.
    pub(super) fn locate(
        &mut self,
        id: SampleId,
        reader: WorkerId,
        workers: &BTreeMap<WorkerId, Worker>,
        now: Uptime,
    ) -> (Source, bool) {
        let held_by = |w: &Worker| w.held.contains(&id);
        let holders = || workers.values().filter(|w| held_by(w) && w.id != reader);
        let anyone_holds = workers.values().any(held_by);
        let on_its_way = workers.values().any(|w| w.is_fetching(id));
        // An owner stays one while it has the sample, renders it right now, or would render it again.
        let known = self.owners.get(&id).and_then(|entry| workers.get(&entry.owner));
        let owner = match known.filter(|w| held_by(w) || on_its_way || w.takes_samples()) {
            Some(owner) => owner.id,
            None => {
                let best = |w: &&Worker| (held_by(w), weight(&w.hello.name, id), w.id);
                workers.values().filter(|w| w.takes_samples()).max_by_key(best).map_or(reader, |w| w.id)
            }
        };
        self.owners.insert(id, Entry { owner, used: now });
        let remote_owner = workers.get(&owner).filter(|w| w.id != reader);
        let owner_first = !anyone_holds || remote_owner.is_some_and(held_by);
        let others = holders().filter(|w| w.id != owner);
        let ranked: Vec<&Worker> = match owner_first {
            true => remote_owner.into_iter().chain(others).collect(),
            false => others.chain(remote_owner).collect(),
        };
        let addresses = ranked.into_iter().map(|w| w.hello.address.clone()).collect();
        (Source { id, addresses }, !anyone_holds && !on_its_way)
    }

    /// Whether that worker is the one who renders the sample.
    pub(super) fn is_owner(&self, worker: WorkerId, id: SampleId) -> bool {
        self.owners.get(&id).is_some_and(|entry| entry.owner == worker)
    }

    /// How many samples that worker owns: what would have to be rendered again without it, at most.
    pub(super) fn owned_by(&self, worker: WorkerId) -> usize {
        self.owners.values().filter(|entry| entry.owner == worker).count()
    }

    /// Forgets samples of epochs before this one.
    pub(super) fn retire(&mut self, before_epoch: u64) {
        self.owners.retain(|id, _| id.epoch >= before_epoch);
    }

    /// Forgets what nobody needs.
    pub(super) fn prune(&mut self, workers: &BTreeMap<WorkerId, Worker>, now: Uptime) {
        self.owners.retain(|id, entry| {
            now.since(entry.used) < FORGET_AFTER || workers.values().any(|w| w.held.contains(id))
        });
        if self.owners.len() > MOST_REMEMBERED {
            let mut ages: Vec<(Uptime, SampleId)> = self.owners.iter().map(|(id, e)| (e.used, *id)).collect();
            ages.sort_unstable();
            for (_, id) in ages.iter().take(self.owners.len() - MOST_REMEMBERED) {
                self.owners.remove(id);
            }
        }
    }
}
