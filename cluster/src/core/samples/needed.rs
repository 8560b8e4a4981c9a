//! The versions whose samples are needed by views in flight. Versions older than all of them may be forgotten.

use std::collections::BTreeMap;

/// Numbers of needed versions, each with the number of views that need it.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct NeededVersions {
    counts: BTreeMap<u64, usize>,
}

impl NeededVersions {
    /// Counts a view that needs a version.
    pub(in crate::core) fn add(&mut self, version: u64) {
        *self.counts.entry(version).or_default() += 1;
    }

    /// Uncounts a view that needed a version.
    pub(in crate::core) fn subtract(&mut self, version: u64) {
        if let Some(count) = self.counts.get_mut(&version) {
            *count -= 1;
            if *count == 0 {
                self.counts.remove(&version);
            }
        }
    }

    /// Whether any view needs this version.
    pub(super) fn contains(&self, version: u64) -> bool {
        self.counts.contains_key(&version)
    }

    /// The oldest needed version.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.counts.keys().next().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_needed_until_its_last_view_is_over() {
        let mut needed = NeededVersions::default();
        [7, 5, 7].into_iter().for_each(|version| needed.add(version));
        assert_eq!((needed.oldest(), needed.contains(7)), (Some(5), true));
        [5, 7].into_iter().for_each(|version| needed.subtract(version));
        assert_eq!((needed.oldest(), needed.contains(5)), (Some(7), false));
        // A version that no view needs stays unneeded.
        [7, 7, 9].into_iter().for_each(|version| needed.subtract(version));
        assert_eq!(needed.oldest(), None);
    }
}
