//! Fills cells and refines them, and learns what that costs.

use std::time::Instant;

use rayon::prelude::*;

use super::super::lattice::CellKey;
use super::corner;
use super::rays::{self, Sums};
use super::record::Record;
use super::scene::CellScene;
use super::sides::{self, Side};
use super::state::State;
use super::store::Store;

/// Corners that are filled between two looks at the clock.
const CORNERS_AT_ONCE: usize = 48;
/// Cells that are refined between two looks at the clock.
const REFINED_AT_ONCE: usize = 48;
/// Cells that a search for cells to refine returns at most.
const REFINED: usize = 1 << 14;

/// A cell that was filled: its sides, and their sums at each new tier.
struct NewCell {
    key: CellKey,
    sides: Vec<Side>,
    tiers: Vec<(usize, Vec<Sums>)>,
    /// What its new rays met; `None` if nothing moves.
    record: Option<Record>,
}

impl State {
    /// Fills the cells of corners up to a tier, and finds out which of their sides see one another.
    pub(super) fn fill_corners(&mut self, scene: &CellScene<'_>, corners: &[CellKey], tier: usize) {
        let begin = Instant::now();
        let lacks = |key: &CellKey| self.store.tier(*key).is_none_or(|has| has < tier);
        let around = corners.iter().flat_map(|corner| corner.corner().map(|(_, key)| key));
        let mut cells: Vec<CellKey> = around.filter(lacks).collect();
        cells.sort_unstable();
        cells.dedup();
        self.fill(scene, &cells, tier);
        let unknown: Vec<CellKey> =
            corners.iter().copied().filter(|corner| self.store.groups(*corner).is_none()).collect();
        let store = &self.store;
        let groups = |corner: &CellKey| corner::groups(scene, *corner, &store.sides(*corner));
        let found: Vec<Box<[u8]>> = unknown.par_iter().with_min_len(8).map(groups).collect();
        unknown.iter().zip(found).for_each(|(corner, groups)| self.store.set_groups(*corner, groups));
        self.took(begin, corners.len(), tier);
    }

    /// Fills some of the corners that wait, but for those that are awaited from other samplers. Returns whether there were any.
    pub(super) fn fill_some(&mut self, scene: &CellScene<'_>) -> bool {
        let (Self { queue, store, asked, .. }, now) = (&mut *self, Instant::now());
        let lacks = |key: CellKey| !store.is_whole(key, 0);
        let corners = queue.take(CORNERS_AT_ONCE, lacks, |key| asked.awaits(key, now));
        if corners.is_empty() {
            return false;
        }
        self.fill_corners(scene, &corners, 0);
        self.may_refine = true;
        self.store.keep_bound();
        true
    }

    /// Fills what waits for the time that the present job has for it.
    pub(super) fn fill_waiting(&mut self, scene: &CellScene<'_>) {
        let (begin, time) = (Instant::now(), self.time_for_waiting());
        while begin.elapsed() < time && self.fill_some(scene) {}
    }

    /// Refines some cells that were used lately. Returns whether there were any.
    pub(super) fn refine(&mut self, scene: &CellScene<'_>, most_tier: usize) -> bool {
        if self.refined.is_empty() && self.may_refine {
            let below = (1..=most_tier).map(|tier| self.store.below(tier, REFINED));
            self.refined = below.into_iter().find(|cells| !cells.is_empty()).unwrap_or_default();
            // Those used last are at the end.
            self.refined.reverse();
        }
        let rest = self.refined.len().saturating_sub(REFINED_AT_ONCE);
        let cells = self.refined.split_off(rest);
        self.may_refine = !cells.is_empty();
        let of_tier = |key: &CellKey| self.store.tier(*key);
        let Some(tier) = cells.iter().filter_map(of_tier).min() else { return self.may_refine };
        let tier = (tier + 1).min(most_tier);
        let begin = Instant::now();
        self.fill(scene, &cells, tier);
        self.took(begin, cells.len(), tier);
        true
    }

    /// Fills cells up to a tier.
    fn fill(&mut self, scene: &CellScene<'_>, cells: &[CellKey], tier: usize) {
        let store = &self.store;
        let filled = |key: &CellKey| new_cell(scene, store, *key, tier);
        let filled: Vec<NewCell> = cells.par_iter().with_min_len(4).map(filled).collect();
        self.filled += filled.len() as u64;
        for NewCell { key, sides, tiers, record } in filled {
            if let Some(record) = record {
                self.store.record(key, &record);
            }
            for (tier, sums) in tiers {
                match tier {
                    0 => {
                        let sides: Vec<(Side, Sums)> = sides.iter().copied().zip(sums).collect();
                        self.store.insert(key, &sides);
                    }
                    _ => self.store.refine(key, tier, &sums),
                }
            }
        }
    }

    /// Learns what filling costs.
    fn took(&mut self, begin: Instant, count: usize, tier: usize) {
        /// Share of the newest measurement.
        const NEW: f64 = 0.1;
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        self.fill_ms += ms;
        self.costs[tier] += (ms / count.max(1) as f64 - self.costs[tier]) * NEW;
    }
}

/// Casts the rays that a cell lacks up to a tier.
fn new_cell(scene: &CellScene<'_>, store: &Store, key: CellKey, tier: usize) -> NewCell {
    let shapes = sides::shapes_of(scene, key);
    let has = store.tier(key);
    let before = has.and_then(|has| store.filled(key, has));
    let mut sums = before.map_or_else(|| vec![Sums::default(); shapes.len()], |cell| cell.sums.to_vec());
    let (mut tiers, mut record) = (Vec::new(), Record::default());
    for tier in has.map_or(0, |has| has + 1)..=tier {
        for (shape, sums) in shapes.iter().zip(&mut sums) {
            rays::add_tier(scene, key, shape, tier, sums, &mut record);
        }
        tiers.push((tier, sums.clone()));
    }
    let (sides, record) =
        (shapes.into_iter().map(|shape| shape.side).collect(), scene.blocks.is_some().then_some(record));
    NewCell { key, sides, tiers, record }
}
