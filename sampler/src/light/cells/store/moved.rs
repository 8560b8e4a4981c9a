//! What becomes of pages when something moves: those that no change touches are kept, the others are *older* from then on.
//!
//! An older page shows what it held until it is filled anew, to views that ask for no certain light.

use std::collections::HashMap;
use std::sync::atomic::Ordering;

use rayon::prelude::*;

use super::super::super::lattice::{CellKey, PageKey};
use super::super::changes::Changes;
use super::{Corner, Filled, Page, Store};

/// Pages that were kept, and those that something touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::light::cells) struct Kept {
    pub(in crate::light::cells) kept: usize,
    pub(in crate::light::cells) touched: usize,
}

impl Store {
    /// Keeps the pages that no change touches. The others are older from now on.
    pub(in crate::light::cells) fn keep_untouched(&mut self, changes: &Changes) -> Kept {
        let pages: Vec<(PageKey, Page)> = std::mem::take(&mut self.pages).into_iter().collect();
        let judged = |(key, mut page): (PageKey, Page)| {
            let is_kept = !changes.are_in(key) && page.is_left_by(changes);
            (key, page, is_kept)
        };
        let judged: Vec<(PageKey, Page, bool)> = pages.into_par_iter().with_min_len(64).map(judged).collect();
        let mut count = Kept::default();
        for (key, page, is_kept) in judged {
            if is_kept {
                count.kept += 1;
                self.pages.insert(key, page);
            } else {
                count.touched += 1;
                // Of two older ones that shows which has more to show.
                let before = self.older.remove(&key);
                let shown = before.filter(|before| before.cells.len() > page.cells.len());
                self.older.insert(key, shown.unwrap_or(page));
            }
        }
        let bytes = |pages: &HashMap<PageKey, Page>| pages.values().map(Page::bytes).sum::<usize>();
        self.bytes = bytes(&self.pages) + bytes(&self.older);
        self.cells = self.pages.values().map(|page| page.cells.len()).sum();
        self.bound_older();
        count
    }

    /// Number of pages of an earlier pose.
    pub(in crate::light::cells) fn older_pages(&self) -> usize {
        self.older.len()
    }

    /// A cell that has a tier, by what it was if it is not filled anew yet.
    pub(in crate::light::cells) fn filled_or_older(&self, key: CellKey, tier: usize) -> Option<Filled<'_>> {
        let (page, place) = key.in_page();
        let Some(older) = self.older.get(&page).filter(|page| page.cell(place).is_some()) else {
            return self.filled(key, tier);
        };
        older.used.store(self.job, Ordering::Relaxed);
        older.filled(place, tier)
    }

    /// The groups of a corner's sides by what they were, if its page is not filled anew yet; `None` if they are not known.
    pub(in crate::light::cells) fn groups_or_older(&self, corner: CellKey) -> Option<&[u8]> {
        let (page, place) = corner.in_page();
        let older = self.older.get(&page).filter(|page| page.corners[place] != Corner::Unknown);
        older.map_or_else(|| self.groups(corner), |page| page.groups_at(place))
    }

    /// Drops an older page.
    pub(super) fn drop_older(&mut self, key: PageKey) {
        if let Some(page) = self.older.remove(&key) {
            self.bytes -= page.bytes();
        }
    }

    /// Drops older pages beyond the bound, those first that were not used for longest.
    pub(super) fn bound_older(&mut self) {
        if self.bytes <= self.most_bytes {
            return;
        }
        let age = |page: &Page| self.job.wrapping_sub(page.used.load(Ordering::Relaxed));
        let mut ages: Vec<(u32, PageKey)> = self.older.iter().map(|(key, page)| (age(page), *key)).collect();
        ages.sort_unstable_by_key(|(age, _)| std::cmp::Reverse(*age));
        for (_, key) in ages {
            if self.bytes <= self.most_bytes / 10 * 9 {
                break;
            }
            self.drop_older(key);
        }
    }
}

impl Page {
    /// Whether what its rays met is as it was. Then its record is renewed.
    fn is_left_by(&mut self, changes: &Changes) -> bool {
        match &mut self.record {
            _ if self.has_unrecorded => false,
            Some(record) => changes.leave(record),
            // It knows corners alone.
            None => self.cells.is_empty(),
        }
    }
}
