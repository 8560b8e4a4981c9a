//! Points of nested lattices, packed into an index: level 0 is the rig's own; each next level halves the spacing.

use glam::IVec3;

/// Number of levels of refinements. The spacing falls to a sixteenth of that of a viewer's own level.
pub const MAX_LEVEL: u32 = 4;

/// Coordinates are stored with this offset, in 20 bits each; the level follows them.
const BIAS: i32 = 1 << 19;
const MASK: u64 = (1 << 20) - 1;

/// The finest level: four bits are left for it, and one of their values for indices that are no point's.
pub(super) const FINEST: u32 = 14;

/// Largest coordinate: the neighbours' neighbours still fit, also those of every 2¹²-th point.
pub(super) const LIMIT: f64 = (BIAS - (4 << 12)) as f64;

/// A point of a lattice. A point of two levels belongs to the coarser one, so that every point has one index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Point {
    /// 0 to [`FINEST`].
    pub(super) level: u32,
    /// In units of the level's spacing, each within ±2¹⁹.
    pub(super) at: IVec3,
}

impl Point {
    /// The same point at its coarsest level.
    pub(super) fn coarsest(mut self) -> Self {
        while self.level > 0 && (self.at & IVec3::ONE) == IVec3::ZERO {
            // Halves exactly, being even.
            self = Self { level: self.level - 1, at: self.at / 2 };
        }
        self
    }

    /// The points of its level in its aligned block of `edge` points on each side, with itself, by ascending index.
    pub(super) fn block(self, edge: u32) -> Vec<Self> {
        let edge = edge.max(1) as i32;
        let first = self.at.map(|v| v.div_euclid(edge) * edge);
        let points = (0..edge.pow(3)).map(|i| {
            let offset = IVec3::new(i % edge, i / edge % edge, i / (edge * edge));
            Self { level: self.level, at: first + offset }
        });
        points.filter(|point| point.coarsest() == *point).collect()
    }

    /// Packs it.
    pub(super) fn index(self) -> u64 {
        let pack = |v: i32| (v + BIAS) as u64 & MASK;
        let Self { level, at } = self;
        pack(at.x) | pack(at.y) << 20 | pack(at.z) << 40 | u64::from(level) << 60
    }

    /// Inverse of [`Point::index`]; `None` for an index that no point has.
    pub(super) fn from_index(index: u64) -> Option<Self> {
        let unpack = |shift: u32| ((index >> shift) & MASK) as i32 - BIAS;
        let point = Self { level: (index >> 60) as u32, at: IVec3::new(unpack(0), unpack(20), unpack(40)) };
        (point.level <= FINEST && point.coarsest() == point).then_some(point)
    }
}

/// The points of a level in the block of `edge` points on each side that begins at `first`, in units of `stride` points.
pub(super) fn block((level, stride): (u32, i32), first: IVec3, edge: i32) -> Vec<u64> {
    let offset = |i: i32| IVec3::new(i % edge, i / edge % edge, i / (edge * edge));
    (0..edge.pow(3)).map(|i| Point { level, at: (first + offset(i)) * stride }.coarsest().index()).collect()
}

/// Coordinates around some, themselves among them.
pub(super) fn neighbours(at: IVec3) -> Vec<IVec3> {
    (0..27).map(|i| at + IVec3::new(i % 3, i / 3 % 3, i / 9) - 1).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_index_gives_back_its_point_and_a_point_has_one_index(
            level in 0..=FINEST,
            at in prop::array::uniform3(-BIAS..BIAS),
        ) {
            let point = Point { level, at: IVec3::from(at) }.coarsest();
            prop_assert_eq!(Point::from_index(point.index()), Some(point));
            let place = |p: Point| p.at.as_dvec3() / f64::from(1 << p.level);
            prop_assert_eq!(place(point), place(Point { level, at: IVec3::from(at) }));
        }

        #[test]
        fn all_points_of_a_block_have_the_same_block(
            level in 0..=FINEST,
            at in prop::array::uniform3(-100..100),
            edge in prop::sample::select(vec![1, 2, 4]),
        ) {
            let point = Point { level, at: IVec3::from(at) }.coarsest();
            let block = point.block(edge);
            prop_assert!(block.contains(&point));
            prop_assert!(block.is_sorted_by_key(|point| point.index()));
            for other in &block {
                prop_assert_eq!(&other.block(edge), &block);
            }
            let refined = edge.pow(3) - (edge / 2).pow(3);
            let all = if point.level == 0 { edge.pow(3) } else if edge == 1 { 1 } else { refined };
            prop_assert_eq!(block.len() as u32, all);
        }

        #[test]
        fn any_index_is_a_point_or_refused(index: u64) {
            if let Some(point) = Point::from_index(index) {
                prop_assert_eq!(point.index(), index);
            }
        }
    }

    #[test]
    fn a_point_of_two_levels_belongs_to_the_coarser() {
        let fine = Point { level: 2, at: IVec3::new(4, -8, 0) };
        assert_eq!(fine.coarsest(), Point { level: 0, at: IVec3::new(1, -2, 0) });
        assert_eq!(Point::from_index(fine.index()), None);
        assert_eq!(Point::from_index(u64::MAX), None);
    }
}
