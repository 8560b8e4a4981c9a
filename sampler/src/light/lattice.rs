//! Names of light cells: a level of the lattice, and three whole numbers.

use glam::{DVec3, IVec3, Vec3};

/// Bits of a cell's number along one axis.
const BITS: u32 = 19;
/// Cells on each side of the lattice's origin, along an axis.
const REACH: i32 = 1 << (BITS - 1);
/// The finest level.
pub(in crate::light) const MOST_LEVEL: u32 = 16;
/// Cells along a side of a page, as a power of two.
const PAGE_BITS: u32 = 3;
/// Cells of a page.
pub(in crate::light) const PAGE_CELLS: usize = 1 << (3 * PAGE_BITS);

/// A cell of the lattice. The order of keys has no meaning in space; it is the same in every process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(in crate::light) struct CellKey(u64);

impl CellKey {
    /// The key of a cell; `None` beyond the lattice.
    #[inline]
    pub(in crate::light) fn new(level: u32, at: IVec3) -> Option<Self> {
        let inside = at.min_element() >= -REACH && at.max_element() < REACH && level <= MOST_LEVEL;
        let number = |axis: usize| (at[axis] + REACH) as u64 & ((1 << BITS) - 1);
        inside.then(|| {
            Self(u64::from(level) << (3 * BITS) | number(2) << (2 * BITS) | number(1) << BITS | number(0))
        })
    }

    /// The cell of a number, as programs write it; `None` if no cell has it.
    pub(in crate::light) fn from_number(number: u64) -> Option<Self> {
        Some(Self(number)).filter(|key| key.level() <= MOST_LEVEL)
    }

    /// The level: the scene's edge has 2^level cells.
    pub(in crate::light) fn level(self) -> u32 {
        (self.0 >> (3 * BITS)) as u32
    }

    /// The cell's numbers along the axes.
    pub(in crate::light) fn at(self) -> IVec3 {
        let number = |axis: u32| (self.0 >> (axis * BITS) & ((1 << BITS) - 1)) as i32 - REACH;
        IVec3::new(number(0), number(1), number(2))
    }

    /// The page that holds the cell, and the cell's place in it.
    pub(in crate::light) fn in_page(self) -> (PageKey, usize) {
        let at = self.at();
        let inside = at & ((1 << PAGE_BITS) - 1);
        let place = inside.x | inside.y << PAGE_BITS | inside.z << (2 * PAGE_BITS);
        (PageKey(self.level(), at >> PAGE_BITS as i32), place as usize)
    }

    /// A number that differs between neighbours.
    pub(in crate::light) fn hash(self) -> u32 {
        (self.0 ^ self.0 >> 31).wrapping_mul(0x9e37_79b9) as u32
    }

    /// The eight cells of which this one is the lowest. Cells beyond the lattice are left out.
    pub(in crate::light) fn corner(self) -> impl Iterator<Item = (IVec3, Self)> {
        let (level, at) = (self.level(), self.at());
        OFFSETS.into_iter().filter_map(move |offset| Some((offset, Self::new(level, at + offset)?)))
    }
}

/// The cells of a corner, from its lowest.
const OFFSETS: [IVec3; 8] = [
    IVec3::new(0, 0, 0),
    IVec3::new(1, 0, 0),
    IVec3::new(0, 1, 0),
    IVec3::new(1, 1, 0),
    IVec3::new(0, 0, 1),
    IVec3::new(1, 0, 1),
    IVec3::new(0, 1, 1),
    IVec3::new(1, 1, 1),
];

/// A cube of 8³ cells of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::light) struct PageKey(u32, IVec3);

impl PageKey {
    /// A number of its own, the same in every process.
    pub(in crate::light) fn number(self) -> u64 {
        self.cell(0).map_or(u64::MAX, |CellKey(number)| number)
    }

    /// The page of a number; `None` if no page has it.
    pub(in crate::light) fn from_number(number: u64) -> Option<Self> {
        let (page, place) = Some(CellKey(number)).filter(|key| key.level() <= MOST_LEVEL)?.in_page();
        (place == 0).then_some(page)
    }

    /// The cell at a place of the page.
    pub(in crate::light) fn cell(self, place: usize) -> Option<CellKey> {
        let Self(level, page) = self;
        let number = |axis: u32| (place >> (axis * PAGE_BITS) & ((1 << PAGE_BITS) - 1)) as i32;
        let inside = IVec3::new(number(0), number(1), number(2));
        CellKey::new(level, (page << PAGE_BITS as i32) + inside)
    }
}

/// The lattice of cells. Positions are metres about the centre of the scene's extent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::light) struct Lattice {
    /// Corner of the cell 0, 0, 0 of every level.
    pub(in crate::light) low: Vec3,
    /// Edge of the cell of level 0: about the scene's size.
    pub(in crate::light) edge: f32,
}

impl Lattice {
    /// Edge of a cell of a level, metres.
    #[inline]
    pub(in crate::light) fn spacing(&self, level: u32) -> f32 {
        // Exact.
        self.edge / (1u32 << level) as f32
    }

    /// Lowest and highest corner of a cell.
    pub(in crate::light) fn corners(&self, key: CellKey) -> [Vec3; 2] {
        let spacing = f64::from(self.spacing(key.level()));
        [0, 1].map(|end| (self.low.as_dvec3() + (key.at() + end).as_dvec3() * spacing).as_vec3())
    }

    /// The cell of each level that a position is in, and the place within it in edges of the cell. Positions of
    /// pixels are added to the place, so that they keep their accuracy near the eye.
    pub(in crate::light) fn about(&self, position: DVec3) -> Vec<Option<(IVec3, Vec3)>> {
        let place = |level: u32| {
            let cells = (position - self.low.as_dvec3()) / f64::from(self.spacing(level));
            let cell = cells.floor();
            let is_inside = cell.is_finite() && cell.abs().max_element() < f64::from(REACH);
            is_inside.then(|| (cell.as_ivec3(), (cells - cell).as_vec3()))
        };
        (0..=MOST_LEVEL).map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_bring_back_their_cells_and_pages_hold_each_once() {
        for (level, at) in
            [(0, IVec3::ZERO), (16, IVec3::new(-REACH, REACH - 1, 5)), (7, IVec3::new(-1, -9, 8))]
        {
            let key = CellKey::new(level, at).unwrap();
            assert_eq!((key.level(), key.at()), (level, at));
        }
        assert_eq!(CellKey::new(3, IVec3::new(REACH, 0, 0)), None);
        assert_eq!(CellKey::new(MOST_LEVEL + 1, IVec3::ZERO), None);
        assert!(
            [1, u64::MAX, u64::from(MOST_LEVEL + 1) << 57]
                .into_iter()
                .all(|n| PageKey::from_number(n).is_none())
        );
        let mut seen = [false; PAGE_CELLS];
        let (page, _) = CellKey::new(4, IVec3::splat(-8)).unwrap().in_page();
        for i in 0..PAGE_CELLS as i32 {
            let at = IVec3::new(i % 8, i / 8 % 8, i / 64) - 8;
            let (of, place) = CellKey::new(4, at).unwrap().in_page();
            assert_eq!(of.cell(place), CellKey::new(4, at));
            assert_eq!(PageKey::from_number(of.number()), Some(of));
            assert!(of == page && !std::mem::replace(&mut seen[place], true));
        }
    }

    #[test]
    fn positions_are_within_their_cells() {
        let lattice = Lattice { low: Vec3::splat(-5.0), edge: 10.0 };
        let position = DVec3::new(1.2345, -3.2, 7.7);
        for (level, found) in (0..).zip(lattice.about(position)) {
            let (cell, place) = found.unwrap();
            let [low, high] = lattice.corners(CellKey::new(level, cell).unwrap());
            let at = position.as_vec3();
            assert!((at - low).min_element() >= -1e-4 && (high - at).min_element() >= -1e-4);
            assert!((low + place * lattice.spacing(level) - at).abs().max_element() < 1e-5);
        }
        assert!(lattice.about(DVec3::splat(f64::NAN)).iter().all(Option::is_none));
    }
}
