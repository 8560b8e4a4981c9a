//! Holds cells that are filled, in pages of 8³ cells, within a bound in bytes.
//!
//! Values are pure functions of their cells, so what is evicted comes back the same.

mod hot;
mod moved;
mod packed;

use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::IVec3;

use super::super::lattice::{CellKey, PAGE_CELLS, PageKey};
use super::rays::Sums;
use super::record::Record;
use super::scene::RAYS;
use super::sides::Side;

pub(super) use moved::Kept;
pub(super) use packed::Unpacked;

/// Tiers of rays.
pub(super) const TIERS: usize = RAYS.len();

/// The filled cells of one pose and lighting, and some of earlier ones.
pub(super) struct Store {
    pages: HashMap<PageKey, Page>,
    /// Pages of an earlier pose, which show until they are filled anew.
    older: HashMap<PageKey, Page>,
    /// Bytes of all pages, about.
    bytes: usize,
    most_bytes: usize,
    cells: usize,
    /// Counts jobs: pages know the last one that used them.
    job: u32,
    /// Counts changes of pages.
    version: u64,
    /// Counts pages.
    numbers: u64,
}

struct Page {
    /// No other page of the store has it, not even one in the same place.
    number: u64,
    used: AtomicU32,
    /// The store's version when the page changed last.
    version: u64,
    /// For each cell 0 if it is not filled, or 1 + its place in `cells`.
    places: [u16; PAGE_CELLS],
    /// For each corner what is known of it.
    corners: [Corner; PAGE_CELLS],
    /// Groups of the sides of corners with a wall between them.
    groups: Vec<Box<[u8]>>,
    cells: Vec<Cell>,
    sides: Vec<Side>,
    /// Sums of each tier. Those of a tier that no cell has yet are empty.
    sums: [Vec<Sums>; TIERS],
    /// What the rays of its cells met; `None` if nothing moves.
    record: Option<Box<Record>>,
    /// Whether it has cells whose rays are not in the record.
    has_unrecorded: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Corner {
    #[default]
    Unknown,
    /// No wall stands between its sides.
    Open,
    /// Index into [`Page::groups`].
    Parted(u16),
}

struct Cell {
    first: u32,
    count: u8,
    /// The best tier that the cell has.
    tier: u8,
}

/// A filled cell, as it is looked up.
pub(super) struct Filled<'a> {
    pub(super) sides: &'a [Side],
    pub(super) sums: &'a [Sums],
}

impl Store {
    pub(super) fn new(most_bytes: usize) -> Self {
        Self {
            pages: HashMap::new(),
            older: HashMap::new(),
            bytes: 0,
            most_bytes,
            cells: 0,
            job: 0,
            version: 0,
            numbers: 0,
        }
    }

    /// Forgets all cells.
    pub(super) fn clear(&mut self) {
        *self = Self { version: self.version + 1, ..Self::new(self.most_bytes) };
    }

    /// Number of filled cells, those without surfaces included.
    pub(super) fn cells(&self) -> usize {
        self.cells
    }

    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    pub(super) fn pages(&self) -> usize {
        self.pages.len()
    }

    /// The pages held.
    #[cfg(test)]
    pub(super) fn page_keys(&self) -> impl Iterator<Item = PageKey> {
        self.pages.keys().copied()
    }

    /// A page's number; `None` if it is not held.
    pub(super) fn number_of(&self, page: PageKey) -> Option<u64> {
        self.pages.get(&page).map(|page| page.number)
    }

    /// The pages that the present job used, with their numbers.
    pub(super) fn used_pages(&self) -> impl Iterator<Item = (PageKey, u64)> {
        let is_used = |page: &Page| page.used.load(Ordering::Relaxed) == self.job;
        self.pages.iter().filter(move |(_, page)| is_used(page)).map(|(key, page)| (*key, page.number))
    }

    /// Begins another job, of which all pages that it uses are kept.
    pub(super) fn begin_job(&mut self) {
        self.job = self.job.wrapping_add(1);
    }

    /// A cell that has a tier.
    pub(super) fn filled(&self, key: CellKey, tier: usize) -> Option<Filled<'_>> {
        let (page, place) = key.in_page();
        let page = self.pages.get(&page)?;
        page.used.store(self.job, Ordering::Relaxed);
        page.filled(place, tier)
    }

    /// The best tier of a cell; `None` if it is not filled.
    pub(super) fn tier(&self, key: CellKey) -> Option<usize> {
        let (page, place) = key.in_page();
        Some(usize::from(self.pages.get(&page)?.cell(place)?.tier))
    }

    /// The cells of a corner, with their offsets from the lowest; `None` for one that lacks the tier. Most lie in one page.
    pub(super) fn around(
        &self,
        corner: CellKey,
        tier: usize,
    ) -> impl Iterator<Item = (IVec3, Option<Filled<'_>>)> {
        let mut last: Option<(PageKey, Option<&Page>)> = None;
        corner.corner().map(move |(offset, cell)| {
            let (key, place) = cell.in_page();
            let page = match last {
                Some((of, page)) if of == key => page,
                _ => {
                    let page = self.pages.get(&key);
                    page.inspect(|page| page.used.store(self.job, Ordering::Relaxed));
                    last = Some((key, page));
                    page
                }
            };
            (offset, page.and_then(|page| page.filled(place, tier)))
        })
    }

    /// The groups of a corner's sides ([`super::corner::groups`]); `None` if they are not known.
    pub(super) fn groups(&self, corner: CellKey) -> Option<&[u8]> {
        let (page, place) = corner.in_page();
        self.pages.get(&page)?.groups_at(place)
    }

    /// Whether lookups at a corner have all that they need.
    pub(super) fn is_whole(&self, corner: CellKey, tier: usize) -> bool {
        self.groups(corner).is_some() && self.around(corner, tier).all(|(_, filled)| filled.is_some())
    }

    /// Whether lookups at a corner have all that they need, by what it was where it is not filled anew yet.
    pub(super) fn is_whole_or_older(&self, corner: CellKey, tier: usize) -> bool {
        self.groups_or_older(corner).is_some()
            && corner.corner().all(|(_, key)| self.filled_or_older(key, tier).is_some())
    }

    /// The sides of a corner's cells, which are filled.
    pub(super) fn sides(&self, corner: CellKey) -> Vec<(IVec3, Side)> {
        let cells = self.around(corner, 0).filter_map(|(offset, filled)| Some((offset, filled?)));
        cells.flat_map(|(offset, cell)| cell.sides.iter().map(move |side| (offset, *side))).collect()
    }

    /// Adds a cell with the sums of its first tier.
    pub(super) fn insert(&mut self, key: CellKey, sides: &[(Side, Sums)]) {
        let (page, place) = key.in_page();
        self.change(page, |page| page.insert(place, sides));
    }

    /// Adds a further tier to a cell that has the one before it.
    pub(super) fn refine(&mut self, key: CellKey, tier: usize, sums: &[Sums]) {
        let (page, place) = key.in_page();
        self.change(page, |page| page.refine(place, tier, sums));
    }

    /// Keeps the groups of a corner's sides.
    pub(super) fn set_groups(&mut self, corner: CellKey, groups: Box<[u8]>) {
        let (page, place) = corner.in_page();
        self.change(page, |page| page.set_groups(place, groups));
    }

    /// Adds what the rays of a cell met that is added next.
    pub(super) fn record(&mut self, key: CellKey, record: &Record) {
        let (page, _) = key.in_page();
        self.change(page, |page| {
            page.record.get_or_insert_default().join(record);
            0
        });
    }

    /// Changes a page, which returns how many bytes it grew by, but for its record.
    fn change(&mut self, key: PageKey, change: impl FnOnce(&mut Page) -> usize) {
        let page = self.pages.entry(key).or_insert_with(|| {
            self.bytes += size_of::<Page>();
            self.numbers += 1;
            Page::new(self.numbers)
        });
        page.used.store(self.job, Ordering::Relaxed);
        self.version += 1;
        page.version = self.version;
        let (cells, recorded) = (page.cells.len(), page.record_bytes());
        self.bytes += change(page);
        self.bytes = self.bytes + page.record_bytes() - recorded;
        self.cells += page.cells.len() - cells;
        if self.older.get(&key).is_some_and(|older| older.cells.len() <= page.cells.len()) {
            self.drop_older(key);
        }
    }

    /// Drops the pages that were not used for longest, until a tenth of the bound is free; those of the present job stay.
    pub(super) fn keep_bound(&mut self) {
        if self.bytes <= self.most_bytes {
            return;
        }
        self.bound_older();
        let age = |page: &Page| self.job.wrapping_sub(page.used.load(Ordering::Relaxed));
        let mut ages: Vec<(u32, PageKey)> = self.pages.iter().map(|(key, page)| (age(page), *key)).collect();
        ages.sort_unstable_by_key(|(age, _)| std::cmp::Reverse(*age));
        for (_, key) in ages.into_iter().take_while(|(age, _)| *age > 0) {
            if self.bytes <= self.most_bytes / 10 * 9 {
                break;
            }
            if let Some(page) = self.pages.remove(&key) {
                self.version += 1;
                self.bytes -= page.bytes();
                self.cells -= page.cells.len();
            }
        }
    }

    /// Cells in pages that a recent job used and whose best tier is below one, those used last first; at most `most`.
    pub(super) fn below(&self, tier: usize, most: usize) -> Vec<CellKey> {
        /// Jobs that are recent.
        const RECENT: u32 = 64;
        let age = |page: &Page| self.job.wrapping_sub(page.used.load(Ordering::Relaxed));
        let mut pages: Vec<(u32, PageKey, &Page)> =
            self.pages.iter().map(|(key, page)| (age(page), *key, page)).collect();
        pages.retain(|(age, _, page)| {
            *age < RECENT && page.cells.iter().any(|cell| usize::from(cell.tier) < tier)
        });
        pages.sort_unstable_by_key(|(age, _, _)| *age);
        let cells = pages.iter().flat_map(|(_, key, page)| {
            let is_below = |place: &usize| page.cell(*place).is_some_and(|c| usize::from(c.tier) < tier);
            (0..PAGE_CELLS).filter(is_below).filter_map(|place| key.cell(place))
        });
        cells.take(most).collect()
    }
}

impl Page {
    fn new(number: u64) -> Self {
        Self {
            number,
            used: AtomicU32::new(0),
            version: 0,
            places: [0; PAGE_CELLS],
            corners: [Corner::Unknown; PAGE_CELLS],
            groups: Vec::new(),
            cells: Vec::new(),
            sides: Vec::new(),
            sums: Default::default(),
            record: None,
            has_unrecorded: false,
        }
    }

    fn insert(&mut self, place: usize, sides: &[(Side, Sums)]) -> usize {
        if self.places[place] != 0 {
            return 0;
        }
        self.cells.push(Cell { first: self.sides.len() as u32, count: sides.len() as u8, tier: 0 });
        self.places[place] = self.cells.len() as u16;
        self.sides.extend(sides.iter().map(|(side, _)| *side));
        self.sums[0].extend(sides.iter().map(|(_, sums)| *sums));
        size_of::<Cell>() + sides.len() * (size_of::<Side>() + size_of::<Sums>())
    }

    fn refine(&mut self, place: usize, tier: usize, sums: &[Sums]) -> usize {
        let at = usize::from(self.places[place]).wrapping_sub(1);
        let Some(cell) = self.cells.get_mut(at).filter(|cell| usize::from(cell.tier) + 1 == tier) else {
            return 0;
        };
        let range = cell.first as usize..cell.first as usize + usize::from(cell.count);
        if range.len() != sums.len() {
            return 0;
        }
        cell.tier = tier as u8;
        let all = &mut self.sums[tier];
        let grown = self.sides.len().saturating_sub(all.len());
        all.resize(self.sides.len().max(all.len()), Sums::default());
        all[range].copy_from_slice(sums);
        grown * size_of::<Sums>()
    }

    fn set_groups(&mut self, place: usize, groups: Box<[u8]>) -> usize {
        if self.corners[place] != Corner::Unknown {
            return 0;
        }
        if groups.is_empty() {
            self.corners[place] = Corner::Open;
            return 0;
        }
        let bytes = size_of_val(&*groups) + size_of::<Box<[u8]>>();
        self.corners[place] = Corner::Parted(self.groups.len() as u16);
        self.groups.push(groups);
        bytes
    }

    fn groups_at(&self, place: usize) -> Option<&[u8]> {
        match self.corners[place] {
            Corner::Unknown => None,
            Corner::Open => Some(&[]),
            Corner::Parted(groups) => self.groups.get(usize::from(groups)).map(|groups| &**groups),
        }
    }

    fn cell(&self, place: usize) -> Option<&Cell> {
        self.cells.get(usize::from(self.places[place]).checked_sub(1)?)
    }

    fn filled(&self, place: usize, tier: usize) -> Option<Filled<'_>> {
        let cell = self.cell(place).filter(|cell| usize::from(cell.tier) >= tier)?;
        let range = cell.first as usize..cell.first as usize + usize::from(cell.count);
        Some(Filled { sides: self.sides.get(range.clone())?, sums: self.sums[tier].get(range)? })
    }

    fn record_bytes(&self) -> usize {
        self.record.as_ref().map_or(0, |record| record.bytes())
    }

    fn bytes(&self) -> usize {
        let sums: usize = self.sums.iter().map(Vec::len).sum();
        let groups: usize = self.groups.iter().map(|groups| size_of_val(&**groups)).sum();
        size_of::<Self>()
            + groups
            + self.groups.len() * size_of::<Box<[u8]>>()
            + self.cells.len() * size_of::<Cell>()
            + self.sides.len() * size_of::<Side>()
            + sums * size_of::<Sums>()
            + self.record_bytes()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn key(x: i32) -> CellKey {
        CellKey::new(5, IVec3::new(x, 0, 0)).unwrap()
    }

    fn sums(of: f32) -> (Side, Sums) {
        let side = Side { place: Vec3::splat(0.5), normal: Vec3::Y, is_thin: false, blocked: 0 };
        (side, Sums { valid: of, ..Sums::default() })
    }

    #[test]
    fn each_tier_of_a_cell_is_kept_beside_the_one_before_it() {
        let mut store = Store::new(usize::MAX);
        store.insert(key(0), &[sums(1.0), sums(2.0)]);
        store.insert(key(1), &[]);
        store.refine(key(1), 1, &[]);
        store.refine(key(0), 1, &[sums(3.0).1, sums(4.0).1]);
        assert_eq!((store.tier(key(0)), store.tier(key(1)), store.tier(key(2))), (Some(1), Some(1), None));
        assert_eq!(store.filled(key(0), 0).unwrap().sums[1].valid, 2.0);
        assert_eq!(store.filled(key(0), 1).unwrap().sums[1].valid, 4.0);
        assert!(store.filled(key(0), 2).is_none() && store.filled(key(1), 1).unwrap().sides.is_empty());
        assert_eq!(store.below(1, 9), []);
        assert_eq!(store.below(2, 9).len(), 2);
    }

    #[test]
    fn the_pages_that_were_not_used_for_longest_are_dropped() {
        let mut store = Store::new(40 * size_of::<Page>());
        for job in 0..100 {
            store.begin_job();
            store.insert(key(job * 8), &[sums(1.0)]);
            store.set_groups(key(job * 8), Box::new([1, 2]));
            assert!(store.filled(key(0), 0).is_some());
            store.keep_bound();
            assert!(store.bytes() <= 40 * size_of::<Page>());
        }
        assert!(store.filled(key(0), 0).is_some(), "it was used in every job");
        assert!(store.filled(key(99 * 8), 0).is_some() && store.filled(key(8), 0).is_none());
        assert_eq!(store.cells(), store.pages.len());
        let bytes: usize = store.pages.values().map(Page::bytes).sum();
        assert_eq!(bytes, store.bytes());
    }
}
