//! Recently used samples, and which of them get a second copy.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use crate::core::time::Uptime;

/// A sample is worth a second copy for this long after its last use.
const INTEREST: Duration = Duration::from_secs(60);

/// Most remembered samples: the most recently used.
const MOST_REMEMBERED: usize = 4096;

/// The last use of the rig's own samples, and which of them get a second copy.
#[derive(Debug, Clone, Default)]
pub(super) struct RecentUse {
    used: BTreeMap<u64, Uptime>,
    copied: BTreeSet<u64>,
}

impl RecentUse {
    /// Records the use of these cameras' samples.
    pub(super) fn used(&mut self, cameras: impl Iterator<Item = u64>, now: Uptime) {
        self.used.extend(cameras.map(|camera| (camera, now)));
    }

    /// The cameras whose samples were used lately.
    pub(super) fn cameras(&self) -> impl Iterator<Item = u64> {
        self.used.keys().copied()
    }

    /// Whether views asked for a camera's sample lately.
    pub(super) fn is_used(&self, camera: u64) -> bool {
        self.used.contains_key(&camera)
    }

    /// The samples that get a second copy: as many recently used ones as fit. A sample keeps its copy while it is in
    /// recent use, since bringing another one may cost more than it is worth.
    pub(super) fn copied(&mut self, most: usize, now: Uptime) -> &BTreeSet<u64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: u64) -> Uptime {
        Uptime(Duration::from_secs(secs))
    }

    fn copied(recent: &mut RecentUse, most: usize, secs: u64) -> Vec<u64> {
        recent.copied(most, at(secs)).iter().copied().collect()
    }

    #[test]
    fn a_sample_in_use_keeps_its_copy_and_other_samples_wait_for_room() {
        let mut recent = RecentUse::default();
        recent.used(0..4, at(1));
        recent.used([7, 8].into_iter(), at(2));
        assert_eq!(copied(&mut recent, 3, 3), [3, 7, 8], "the most recently used");
        recent.used([0, 1, 2, 7].into_iter(), at(30));
        assert_eq!(copied(&mut recent, 3, 31), [3, 7, 8]);
        assert_eq!(copied(&mut recent, 3, 61), [2, 7, 8]);
        assert_eq!(copied(&mut recent, 3, 62), [1, 2, 7]);
        assert_eq!(copied(&mut recent, 3, 90), [0; 0]);
    }

    #[test]
    fn the_number_of_remembered_samples_is_bounded() {
        let mut recent = RecentUse::default();
        recent.used(0..3 * MOST_REMEMBERED as u64, at(1));
        assert_eq!(copied(&mut recent, 2, 2).len(), 2);
        assert_eq!(recent.used.len(), MOST_REMEMBERED);
        assert!(recent.copied.iter().all(|camera| recent.used.contains_key(camera)));
    }
}
