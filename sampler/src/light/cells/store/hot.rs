//! Pages in the layout of programs: what lookups read of a page, and no more. `shaders/shared/light_cells.wgsl` reads it.

use super::super::super::lattice::{PAGE_CELLS, PageKey};
use super::super::rays::Sums;
use super::super::sides::Side;
use super::{Corner, Page, Store};
use crate::resident::octahedral;

/// Words of a vector, and vectors of a side.
const VECTOR: usize = 4;
/// What stands for a corner whose groups are not known, and for one without groups.
const UNKNOWN: u32 = 0;
const OPEN: u32 = 1;

impl Store {
    /// Counts changes: equal if nothing changed.
    pub(in crate::light::cells) fn version(&self) -> u64 {
        self.version
    }

    /// The pages, each with the version at which it changed last.
    pub(in crate::light::cells) fn versions(&self) -> impl Iterator<Item = (PageKey, u64)> {
        self.pages.iter().map(|(key, page)| (*key, page.version))
    }

    /// A page's block; `None` if it is not held.
    pub(in crate::light::cells) fn hot(&self, page: PageKey) -> Option<Vec<[u32; VECTOR]>> {
        self.pages.get(&page).map(Page::hot)
    }

    /// Says that the present job uses a page.
    pub(in crate::light::cells) fn touch(&self, page: PageKey) {
        if let Some(page) = self.pages.get(&page) {
            page.used.store(self.job, std::sync::atomic::Ordering::Relaxed);
        }
    }
}

impl Page {
    fn hot(&self) -> Vec<[u32; VECTOR]> {
        let mut block = vec![[0u32; VECTOR]; PAGE_CELLS * 2 / VECTOR];
        for place in 0..PAGE_CELLS {
            let words = [self.hot_cell(place, &mut block), self.hot_corner(place, &mut block)];
            let pair = &mut block[place / 2];
            pair[place % 2 * 2..][..2].copy_from_slice(&words);
        }
        block
    }

    /// Appends the sides of a cell, tier by tier. Returns its word: its first side, the numbers of its sides and of its tiers.
    fn hot_cell(&self, place: usize, block: &mut Vec<[u32; VECTOR]>) -> u32 {
        let Some(cell) = self.cell(place) else { return 0 };
        let (first, tiers) = (block.len() as u32, u32::from(cell.tier) + 1);
        let range = cell.first as usize..cell.first as usize + usize::from(cell.count);
        for sums in self.sums.iter().take(tiers as usize).filter_map(|sums| sums.get(range.clone())) {
            let sides = self.sides[range.clone()].iter().zip(sums);
            block.extend(sides.flat_map(|(side, sums)| hot_side(side, sums)));
        }
        first << 5 | u32::from(cell.count) << 2 | tiers
    }

    /// Appends the groups of a corner, a byte each. Returns its word.
    fn hot_corner(&self, place: usize, block: &mut Vec<[u32; VECTOR]>) -> u32 {
        let groups = match self.corners[place] {
            Corner::Unknown => return UNKNOWN,
            Corner::Open => return OPEN,
            Corner::Parted(groups) => &self.groups[usize::from(groups)],
        };
        let first = block.len() as u32;
        for groups in groups.chunks(VECTOR * 4) {
            let mut words = [0; VECTOR];
            for (at, group) in groups.iter().enumerate() {
                words[at / 4] |= u32::from(*group) << (at % 4 * 8);
            }
            block.push(words);
        }
        first
    }
}

/// A side with the means of its rays, 48 bytes: its place as three numbers of 16 bits, marks (9 bits of rays that count, 4 bits of
/// blocked ways, a bit for thin ones), its normal, and radiance of the sky that is seen, of the whole sky, and of surfaces.
fn hot_side(side: &Side, sums: &Sums) -> [[u32; VECTOR]; 3] {
    let [x, y, z] = side.place.to_array().map(|at| (at.clamp(0.0, 1.0) * 65535.0).round() as u32);
    let marks = sums.valid as u32 & 511 | u32::from(side.blocked) << 9 | u32::from(side.is_thin) << 13;
    let each = if sums.valid > 0.0 { 1.0 / sums.valid } else { 0.0 };
    let [seen, whole, reflected] =
        [sums.seen, sums.whole, sums.reflected].map(|sum| (sum * each).to_array().map(f32::to_bits));
    [
        [x | y << 16, z | marks << 16, octahedral(side.normal), seen[0]],
        [seen[1], seen[2], whole[0], whole[1]],
        [whole[2], reflected[0], reflected[1], reflected[2]],
    ]
}
