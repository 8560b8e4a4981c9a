//! A second copy of what views use of a scene that stands still: whoever is lost takes no sample along that others would have
//! to wait for until it is rendered again.
//!
//! Of a scene that moves every sample is where it is composed from, and lasts a moment; refinements are wherever views are
//! composed. What is left are the rig's own samples, which a compositor has only if one of its views asked for them, and
//! which nearer refinements make all views forget about until a worker comes that has none of those yet.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use argus_scene::SampleId;

use super::event::WorkerId;
use super::machine::Core;
use super::time::Uptime;
use super::worker::Worker;

/// A sample is worth a second copy for this long after a view asked for it.
const INTEREST: Duration = Duration::from_secs(60);

/// Samples that are remembered at most: those that were asked for last.
const MOST_REMEMBERED: usize = 4096;

/// Samples that get a second copy at most, however small they are: each stands in an assignment.
const MOST_COPIED: u64 = 256;

/// … and of the memory that refinements may take what copies may.
const OF_REFINEMENTS: f64 = 0.5;

/// When views asked for which of the rig's own samples last, and which of them get a second copy.
#[derive(Debug, Clone, Default)]
pub(super) struct Lately {
    used: BTreeMap<u64, Uptime>,
    copied: BTreeSet<u64>,
}

impl Lately {
    pub(super) fn used(&mut self, cameras: impl Iterator<Item = u64>, now: Uptime) {
        self.used.extend(cameras.map(|camera| (camera, now)));
    }

    /// Those that get a second copy: as many as fit of what somebody asked for in a while. Whatever has one keeps it for that
    /// while, since to bring another one costs more than it may ever be worth.
    fn copied(&mut self, most: usize, now: Uptime) -> &BTreeSet<u64> {
        self.used.retain(|_, used| now.since(*used) < INTEREST);
        let mut newest: Vec<(Uptime, u64)> =
            self.used.iter().map(|(camera, used)| (*used, *camera)).collect();
        newest.sort_unstable_by(|a, b| b.cmp(a));
        for (_, camera) in newest.split_off(MOST_REMEMBERED.min(newest.len())) {
            self.used.remove(&camera);
        }
        self.copied.retain(|camera| self.used.contains_key(camera));
        while self.copied.len() > most {
            self.copied.pop_last();
        }
        let room = most - self.copied.len();
        let others = newest.iter().map(|(_, camera)| *camera).filter(|camera| !self.copied.contains(camera));
        let others: Vec<u64> = others.take(room).collect();
        self.copied.extend(others);
        &self.copied
    }
}

impl Core {
    /// Remembers that a view asks for these samples.
    pub(super) fn note_use(&mut self, cameras: impl Iterator<Item = u64> + Clone, now: Uptime) {
        self.epochs.used(cameras.clone(), now);
        if !self.epochs.moves() {
            let rig = self.set.rig;
            self.lately.used(cameras.filter(|camera| rig.level(*camera) == Some(0)), now);
        }
    }

    /// The rig's own samples that views asked for lately, each with who shall have it beside its owner: who composes from it
    /// already, or somebody who may. One that nobody has any more is rendered again before a view asks for it.
    pub(super) fn copies(&mut self, now: Uptime) -> Vec<(SampleId, Vec<WorkerId>)> {
        let bytes = OF_REFINEMENTS * self.config.refining_bytes as f64;
        let most = ((bytes / self.sample_bytes().max(1) as f64) as u64).min(MOST_COPIED) as usize;
        let indices: Vec<u64> = self.lately.copied(most, now).iter().copied().collect();
        let composes = |worker: &Worker| worker.takes_views() && !worker.takes_samples() && !worker.suspected;
        let composers: Vec<WorkerId> = self.workers.values().filter(|w| composes(w)).map(|w| w.id).collect();
        let (epoch, generation) = (self.set.epoch, self.set.generation);
        let ids = indices.into_iter().map(|index| SampleId { epoch, generation, index });
        // What views wait for is being rendered.
        let is_settled =
            |id: &SampleId| self.whereabouts.is_held(*id) || !self.whereabouts.is_on_its_way(*id);
        let with_reader = |(turn, id): (usize, SampleId)| {
            let holder = self.whereabouts.holders(id).find(|id| self.workers.get(id).is_some_and(composes));
            let any = || composers.get(turn % composers.len().max(1)).copied();
            (id, holder.or_else(any).into_iter().collect())
        };
        ids.filter(is_settled).enumerate().map(with_reader).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: u64) -> Uptime {
        Uptime(Duration::from_secs(secs))
    }

    fn copied(lately: &mut Lately, most: usize, secs: u64) -> Vec<u64> {
        lately.copied(most, at(secs)).iter().copied().collect()
    }

    #[test]
    fn what_has_a_copy_keeps_it_while_somebody_asks_for_it_and_others_wait_for_its_room() {
        let mut lately = Lately::default();
        lately.used(0..4, at(1));
        lately.used([7, 8].into_iter(), at(2));
        assert_eq!(copied(&mut lately, 3, 3), [3, 7, 8], "those asked for last");
        lately.used([0, 1, 2, 7].into_iter(), at(30));
        assert_eq!(copied(&mut lately, 3, 31), [3, 7, 8]);
        assert_eq!(copied(&mut lately, 3, 61), [2, 7, 8]);
        assert_eq!(copied(&mut lately, 3, 62), [1, 2, 7]);
        assert_eq!(copied(&mut lately, 3, 90), [0; 0]);
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut lately = Lately::default();
        lately.used(0..3 * MOST_REMEMBERED as u64, at(1));
        assert_eq!(copied(&mut lately, 2, 2).len(), 2);
        assert_eq!(lately.used.len(), MOST_REMEMBERED);
        assert!(lately.copied.iter().all(|camera| lately.used.contains_key(camera)));
    }
}
