//! The epochs whose samples views in flight need: what is older than all of them may be forgotten.

use std::collections::BTreeMap;

/// Epochs that views in flight were planned in, each with how many need its samples.
#[derive(Debug, Clone, Default)]
pub(in crate::core) struct NeededEpochs {
    counts: BTreeMap<u64, usize>,
}

impl NeededEpochs {
    /// One more view needs the samples of an epoch.
    pub(in crate::core) fn add(&mut self, epoch: u64) {
        *self.counts.entry(epoch).or_default() += 1;
    }

    /// A view that needed the samples of an epoch is over.
    pub(in crate::core) fn subtract(&mut self, epoch: u64) {
        if let Some(count) = self.counts.get_mut(&epoch) {
            *count -= 1;
            if *count == 0 {
                self.counts.remove(&epoch);
            }
        }
    }

    /// Whether any view needs the samples of that epoch.
    pub(super) fn contains(&self, epoch: u64) -> bool {
        self.counts.contains_key(&epoch)
    }

    /// The oldest epoch that a view needs.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.counts.keys().next().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_epoch_is_needed_until_its_last_view_is_over() {
        let mut needed = NeededEpochs::default();
        [7, 5, 7].into_iter().for_each(|epoch| needed.add(epoch));
        assert_eq!((needed.oldest(), needed.contains(7)), (Some(5), true));
        [5, 7].into_iter().for_each(|epoch| needed.subtract(epoch));
        assert_eq!((needed.oldest(), needed.contains(5)), (Some(7), false));
        // One that no view needs stays so.
        [7, 7, 9].into_iter().for_each(|epoch| needed.subtract(epoch));
        assert_eq!(needed.oldest(), None);
    }
}
