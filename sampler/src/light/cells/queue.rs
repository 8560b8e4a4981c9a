//! Corners that views lacked, until they are filled: the newest first, within a bound.

use std::collections::{HashSet, VecDeque};

use super::super::lattice::CellKey;

/// Most corners that wait. Beyond, the oldest are left out: a view that needs them asks again.
const MOST: usize = 1 << 18;
/// Most corners that are passed over at once, since they are awaited.
const MOST_PASSED: usize = 1 << 14;

#[derive(Default)]
pub(super) struct Queue {
    /// The newest at the end.
    keys: VecDeque<CellKey>,
    waiting: HashSet<CellKey>,
    /// Those that were added since they were last asked for.
    fresh: Vec<CellKey>,
}

impl Queue {
    /// Adds corners that do not wait yet.
    pub(super) fn add(&mut self, corners: Vec<CellKey>) {
        for corner in corners {
            if self.waiting.insert(corner) {
                self.keys.push_back(corner);
                self.are_fresh(&[corner]);
            }
        }
        while self.keys.len() > MOST {
            if let Some(oldest) = self.keys.pop_front() {
                self.waiting.remove(&oldest);
            }
        }
    }

    /// Takes up to `most` of the newest corners that still lack, but for those that are awaited; those that no longer lack and are
    /// met on the way are dropped.
    pub(super) fn take(
        &mut self,
        most: usize,
        lacks: impl Fn(CellKey) -> bool,
        is_awaited: impl Fn(CellKey) -> bool,
    ) -> Vec<CellKey> {
        let (mut taken, mut stay) = (Vec::new(), Vec::new());
        while taken.len() < most
            && stay.len() < MOST_PASSED
            && let Some(corner) = self.keys.pop_back()
        {
            match lacks(corner) {
                true if is_awaited(corner) => stay.push(corner),
                lacks => {
                    self.waiting.remove(&corner);
                    taken.extend(lacks.then_some(corner));
                }
            }
        }
        self.keys.extend(stay.into_iter().rev());
        taken
    }

    /// The corners that wait, the newest first.
    pub(super) fn newest(&self) -> impl Iterator<Item = CellKey> {
        self.keys.iter().rev().copied()
    }

    /// Counts corners as added since. Beyond a bound they are not: they are looked at with all others.
    pub(super) fn are_fresh(&mut self, corners: &[CellKey]) {
        let room = MOST.saturating_sub(self.fresh.len());
        self.fresh.extend(corners.iter().take(room));
    }

    /// Up to `most` of those that were added since this was last asked, the newest first.
    pub(super) fn take_fresh(&mut self, most: usize) -> Vec<CellKey> {
        let rest = self.fresh.len().saturating_sub(most);
        self.fresh.drain(rest..).rev().collect()
    }

    pub(super) fn len(&self) -> usize {
        self.keys.len()
    }
}

#[cfg(test)]
mod tests {
    use glam::IVec3;

    use super::*;

    #[test]
    fn the_newest_are_taken_first_and_the_oldest_dropped_beyond_the_bound() {
        let key = |i: usize| CellKey::new(9, IVec3::new((i % 512) as i32, (i / 512) as i32, 0)).unwrap();
        let mut queue = Queue::default();
        queue.add((0..MOST + 10).map(key).collect());
        assert_eq!(queue.take_fresh(2), [key(MOST - 1), key(MOST - 2)], "no more than the bound are fresh");
        queue.add((0..3).map(|i| key(MOST + i)).collect());
        assert_eq!(queue.take_fresh(1), [key(MOST - 3)], "those that wait are not fresh again");
        assert_eq!(queue.len(), MOST);
        let nothing = |_: CellKey| false;
        assert_eq!(queue.take(2, |corner| corner != key(MOST + 8), nothing), [key(MOST + 9), key(MOST + 7)]);
        // Those that are awaited stay where they are.
        let awaited = |corner: CellKey| corner == key(MOST + 6) || corner == key(MOST + 4);
        assert_eq!(queue.take(2, |_| true, awaited), [key(MOST + 5), key(MOST + 3)]);
        assert_eq!(queue.newest().take(2).collect::<Vec<_>>(), [key(MOST + 6), key(MOST + 4)]);
        let rest = queue.take(usize::MAX, |_| true, nothing);
        assert_eq!((rest.len(), rest.last()), (MOST - 5, Some(&key(10))));
        assert_eq!(queue.len(), 0);
    }
}
