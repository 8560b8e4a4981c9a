//! The corners that a block of pixels looks up, each gathered once.

use super::super::lattice::CellKey;
use super::weighing::{Near, Octet, Rule};

/// Places of the table, a power of two: more than twice the corners that a block of 32² pixels can look up, three each.
const PLACES: usize = 8192;

/// What is known of a corner.
#[derive(Clone, Copy)]
pub(super) enum Known {
    /// Some of its cells are not filled.
    Missing,
    /// Its range of [`CornerCache::octets`], and how its sides count.
    Sides { first: u32, count: u32, rule: Rule },
}

/// Corners by open addressing, and their sides.
pub(super) struct CornerCache {
    known: Vec<(CellKey, Known)>,
    /// 1 + an index of `known`; 0 for none.
    places: Box<[u16; PLACES]>,
    pub(super) octets: Vec<Octet>,
    /// The corner's octets begin here, and the last of them has so many sides.
    first: usize,
    filled: usize,
}

impl Default for CornerCache {
    fn default() -> Self {
        Self { known: Vec::new(), places: Box::new([0; PLACES]), octets: Vec::new(), first: 0, filled: 0 }
    }
}

impl CornerCache {
    /// Forgets all corners.
    pub(super) fn forget(&mut self) {
        self.known.clear();
        self.places.fill(0);
        self.octets.clear();
        (self.first, self.filled) = (0, 0);
    }

    /// What is known of a corner; `None` if it was not gathered.
    #[inline(always)]
    pub(super) fn of(&self, key: CellKey) -> Option<Known> {
        match self.places[self.place(key)] {
            0 => None,
            number => Some(self.known[usize::from(number) - 1].1),
        }
    }

    /// Adds a side of the corner that is kept next.
    pub(super) fn add(&mut self, side: Near) {
        if self.filled.is_multiple_of(Octet::SIDES) {
            self.octets.push(Octet::default());
        }
        if let Some(octet) = self.octets.last_mut() {
            octet.set(self.filled % Octet::SIDES, side);
            self.filled += 1;
        }
    }

    /// Keeps a corner with the sides that were added; `None` if it lacks some.
    pub(super) fn keep(&mut self, key: CellKey, rule: Option<Rule>) -> Known {
        let (first, count) = (self.first as u32, (self.octets.len() - self.first) as u32);
        let known = rule.map_or(Known::Missing, |rule| Known::Sides { first, count, rule });
        (self.first, self.filled) = (self.octets.len(), 0);
        self.known.push((key, known));
        let place = self.place(key);
        self.places[place] = self.known.len() as u16;
        known
    }

    /// The corners that lack cells.
    pub(super) fn missing(&self) -> impl Iterator<Item = CellKey> {
        self.known.iter().filter(|(_, known)| matches!(known, Known::Missing)).map(|(key, _)| *key)
    }

    /// The place of a corner, or a free one for it.
    #[inline(always)]
    fn place(&self, key: CellKey) -> usize {
        let mut place = key.hash() as usize % PLACES;
        loop {
            match self.places[place] {
                number if number != 0 && self.known[usize::from(number) - 1].0 != key => {
                    place = (place + 1) % PLACES;
                }
                _ => return place,
            }
        }
    }
}
