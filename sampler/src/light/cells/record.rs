//! What the rays of a page met, so that it is known later whether anything of it has changed.

use super::super::paths::LeafRead;
use super::blocks::{BlockSet, Blocks};
use glam::Vec3;

/// Entries that are added at least before a list is sorted again.
const SORTED_AFTER: usize = 256;
/// Share of a ray's length by which it is taken to be longer, against rounding.
pub(super) const LONGER: f32 = 1.0 + 1e-5;

/// What rays met. Values that follow from these rays are the same in another pose if no mover came into or left a block of
/// `crossed`, and if nothing of `read` changed.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Record {
    crossed: BlockSet,
    /// What was read of leaf sides; sorted and without repetition up to [`Self::sorted`].
    read: Vec<LeafRead>,
    sorted: usize,
}

impl Record {
    /// A record of these blocks and reads.
    pub(super) fn new(crossed: BlockSet, read: Vec<LeafRead>) -> Self {
        Self { crossed, read, sorted: 0 }
    }

    /// Adds a ray that hits something at that distance, in units of its direction, or nothing.
    pub(super) fn add_ray(&mut self, blocks: &Blocks, start: Vec3, direction: Vec3, hit: Option<f32>) {
        blocks.add_ray(&mut self.crossed, start, direction, hit.map_or(f32::INFINITY, |t| t * LONGER));
    }

    /// Adds something that was read of leaf sides.
    pub(super) fn add_read(&mut self, read: LeafRead) {
        self.read.push(read);
    }

    /// Adds all of another record.
    pub(super) fn join(&mut self, other: &Self) {
        self.crossed.join(&other.crossed);
        self.read.extend_from_slice(&other.read);
        if self.read.len() > 2 * self.sorted + SORTED_AFTER {
            self.sort();
        }
    }

    /// The blocks that rays crossed.
    pub(super) fn crossed(&self) -> &BlockSet {
        &self.crossed
    }

    /// What was read of leaf sides, ascending, each once.
    pub(super) fn sorted_reads(&self) -> Vec<LeafRead> {
        let mut read = self.read.clone();
        read.sort_unstable();
        read.dedup();
        read
    }

    /// Renames what was read. Returns false if any of it has no new name; then the record must not be used any more.
    pub(super) fn rename(&mut self, name: impl Fn(LeafRead) -> Option<LeafRead>) -> bool {
        self.sort();
        for read in &mut self.read {
            let Some(renamed) = name(*read) else { return false };
            *read = renamed;
        }
        self.sort();
        true
    }

    /// Bytes of the record.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.read)
    }

    fn sort(&mut self) {
        // Runs of joined records are sorted: a stable sort merges them.
        self.read.sort();
        self.read.dedup();
        self.sorted = self.read.len();
    }
}
