//! What the light of a face was found by, written down while it is found.

use std::array;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::Vec3;

use super::super::lattice::PageKey;
use super::super::paths::LeafRead;
use super::blocks::{BLOCK_WORDS, BlockSet, Blocks};
use super::record::{LONGER, Record};
use crate::ray_watch::RayWatch;

/// The blocks that rays cross, and what was read of leaf sides and light cells. Threads share it.
pub(crate) struct Trail {
    blocks: Blocks,
    /// The rays' eye about the centre of the leaves.
    from_eye: Vec3,
    /// How often the pose or lighting of cells had changed when it began.
    poses: u64,
    crossed: [AtomicU64; BLOCK_WORDS],
    read: Mutex<Vec<LeafRead>>,
    pages: Mutex<HashMap<PageKey, u64>>,
}

impl Trail {
    /// An empty trail of rays about an eye. `poses`: how often the pose or lighting of cells has changed.
    pub(super) fn new(blocks: Blocks, from_eye: Vec3, poses: u64) -> Self {
        let crossed = array::from_fn(|_| AtomicU64::new(0));
        Self { blocks, from_eye, poses, crossed, read: Mutex::default(), pages: Mutex::default() }
    }

    /// How often the pose or lighting of cells had changed when it began.
    pub(super) fn poses(&self) -> u64 {
        self.poses
    }

    /// Adds what was read of leaf sides.
    pub(super) fn add_reads(&self, read: &[LeafRead]) {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(read);
    }

    /// Adds pages of cells that were looked up, by their number.
    pub(super) fn add_pages(&self, pages: impl Iterator<Item = (PageKey, u64)>) {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner).extend(pages);
    }

    /// All that it has: a record, and pages of cells by their number.
    pub(super) fn into_parts(self) -> (Record, HashMap<PageKey, u64>) {
        let crossed = BlockSet::from_words(self.crossed.map(AtomicU64::into_inner));
        let read = self.read.into_inner().unwrap_or_else(PoisonError::into_inner);
        let pages = self.pages.into_inner().unwrap_or_else(PoisonError::into_inner);
        (Record::new(crossed, read), pages)
    }
}

impl RayWatch for Trail {
    fn cast(&self, start: Vec3, direction: Vec3, most: f32) {
        self.blocks.crossed_by(start + self.from_eye, direction, most * LONGER, |word, bit| {
            // Nearly all are known: they are not written again, which other threads would wait for.
            if self.crossed[word].load(Ordering::Relaxed) & bit == 0 {
                self.crossed[word].fetch_or(bit, Ordering::Relaxed);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::lattice::Lattice;
    use super::*;

    #[test]
    fn a_trail_of_many_threads_has_the_blocks_of_all_rays_about_their_eye() {
        use rayon::prelude::*;

        let lattice = Lattice { low: Vec3::splat(-6.0), edge: 12.0 };
        let eye = Vec3::new(1.0, -2.0, 3.0);
        let trail = Trail::new(Blocks::new(&lattice), eye, 0);
        let rays: Vec<(Vec3, Vec3, f32)> = (0..500)
            .map(|at| {
                let turn = at as f32;
                (Vec3::new(turn.sin(), 0.1, -0.4), Vec3::new(turn.cos(), (turn * 0.7).sin(), 0.3), 2.0)
            })
            .collect();
        rays.par_iter().for_each(|&(start, direction, most)| trail.cast(start, direction, most));
        trail.cast(Vec3::ZERO, Vec3::Y, f32::MAX);
        let (blocks, mut all) = (Blocks::new(&lattice), Record::default());
        for (start, direction, most) in rays {
            all.add_ray(&blocks, start + eye, direction, Some(most));
        }
        all.add_ray(&blocks, eye, Vec3::Y, None);
        let (record, pages) = trail.into_parts();
        assert!(record == all && pages.is_empty());
    }
}
