//! Corners that views lacked, until they are filled: the newest first, within a bound.

use std::collections::{HashSet, VecDeque};

use super::super::lattice::CellKey;

/// Most corners that wait. Beyond, the oldest are left out: a view that needs them asks again.
const MOST: usize = 1 << 18;

#[derive(Default)]
pub(super) struct Queue {
    /// The newest at the end.
    keys: VecDeque<CellKey>,
    waiting: HashSet<CellKey>,
}

impl Queue {
    /// Adds corners that do not wait yet.
    pub(super) fn add(&mut self, corners: Vec<CellKey>) {
        for corner in corners {
            if self.waiting.insert(corner) {
                self.keys.push_back(corner);
            }
        }
        while self.keys.len() > MOST {
            if let Some(oldest) = self.keys.pop_front() {
                self.waiting.remove(&oldest);
            }
        }
    }

    /// Takes up to `most` of the newest corners that still lack; all others that are met on the way are dropped.
    pub(super) fn take(&mut self, most: usize, lacks: impl Fn(CellKey) -> bool) -> Vec<CellKey> {
        let mut taken = Vec::new();
        while taken.len() < most
            && let Some(corner) = self.keys.pop_back()
        {
            self.waiting.remove(&corner);
            if lacks(corner) {
                taken.push(corner);
            }
        }
        taken
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
        queue.add((0..3).map(|i| key(MOST + i)).collect());
        assert_eq!(queue.len(), MOST);
        assert_eq!(queue.take(2, |corner| corner != key(MOST + 8)), [key(MOST + 9), key(MOST + 7)]);
        let rest = queue.take(usize::MAX, |_| true);
        assert_eq!((rest.len(), rest.last()), (MOST - 3, Some(&key(10))));
        assert_eq!(queue.len(), 0);
    }
}
