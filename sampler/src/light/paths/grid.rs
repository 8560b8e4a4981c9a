//! Cells of a cubic grid, numbered along a Morton curve, and a table of those that are occupied.

use glam::{IVec3, Vec3};

/// A cubic grid. Positions are metres about its centre.
///
/// The cells of its *inner* cube, around the scene's extent, are equal: 2^level on a side. Where surfaces reach beyond, a
/// quarter as many cells follow on each side, and each is larger than the one before it by the same factor. So what is far
/// away takes few cells, and none from what is near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// The lowest corner of the inner cube.
    low: Vec3,
    /// Edge of a cell of the inner cube.
    cell: f32,
    /// Cells on a side of the inner cube.
    inner: i32,
    /// Cells before it and behind it along each axis.
    outer: i32,
    /// Ratio of the edges of two cells that follow one another outside of the inner cube, above 1.
    growth: f32,
}

/// Most cells on a side of the inner cube: with those beyond it they have Morton numbers of ten bits for each axis.
const MOST_INNER: i32 = 1 << 9;

impl Grid {
    /// A grid whose inner cube is around a box of this size, and that reaches `beyond` it, metres on each side.
    pub(super) fn around(size: Vec3, beyond: f32, level: u32) -> Self {
        // Larger than the box, so that walls rarely lie between two cells.
        let edge = size.max_element().max(1e-6) * 1.0037;
        let reaches = beyond > 0.5 * (edge - size.max_element());
        let inner = (1 << level).min(MOST_INNER);
        let outer = if reaches { (inner / 4).max(1) } else { 0 };
        let cell = edge / inner as f32;
        Self {
            low: Vec3::splat(-0.5 * edge),
            cell,
            inner,
            outer,
            growth: growth(beyond * 1.01 / cell, outer),
        }
    }

    /// The lowest corner of the inner cube, and its edge.
    pub(super) fn cube(&self) -> (Vec3, f32) {
        (self.low, self.cell * self.inner as f32)
    }

    /// The lowest corner of the inner cube, the edge of its cells, the ratio of edges beyond it, and the cells on its side and beyond
    /// it: what programs find cells by.
    pub(in crate::light::paths) fn parameters(&self) -> (Vec3, f32, f32, [i32; 2]) {
        (self.low, self.cell, self.growth, [self.inner, self.outer])
    }

    /// Cells on a side.
    fn side(&self) -> i32 {
        self.inner + 2 * self.outer
    }

    /// The number of a cell along one axis, which may lie outside.
    fn along(&self, axis: usize, at: f32) -> i32 {
        let place = (at - self.low[axis]) / self.cell;
        let beyond = (place - self.inner as f32).max(-place);
        if beyond <= 0.0 || self.outer == 0 {
            // Saturates.
            return (place.floor() as i32).saturating_add(self.outer);
        }
        // Inverse of `edge_beyond`.
        let steps = (1.0 + beyond * (self.growth - 1.0) / self.growth).ln() / self.growth.ln();
        let steps = steps.floor() as i32;
        if place < 0.0 {
            (self.outer - 1).saturating_sub(steps)
        } else {
            (self.outer + self.inner).saturating_add(steps)
        }
    }

    /// The first and last cell of an extent along an axis.
    pub(super) fn span(&self, axis: usize, [low, high]: [f32; 2]) -> std::ops::RangeInclusive<i32> {
        let last = self.side() - 1;
        self.along(axis, low).clamp(0, last)..=self.along(axis, high).clamp(0, last)
    }

    /// Bounds of a cell along an axis. Those of neighbours are equal.
    pub(super) fn bounds(&self, axis: usize, number: i32) -> [f32; 2] {
        [number, number + 1].map(|number| self.low[axis] + self.edge(number - self.outer) * self.cell)
    }

    /// The lower edge of a cell, counted from the first of the inner cube, in edges of its cells.
    fn edge(&self, number: i32) -> f32 {
        match number {
            ..0 => -self.edge_beyond(-number),
            _ if number > self.inner => self.inner as f32 + self.edge_beyond(number - self.inner),
            _ => number as f32,
        }
    }

    /// The sum of the edges of the first cells outside of the inner cube.
    fn edge_beyond(&self, cells: i32) -> f32 {
        self.growth * (self.growth.powi(cells) - 1.0) / (self.growth - 1.0)
    }

    /// The corners of a cell.
    pub(super) fn corners(&self, cell: IVec3) -> [Vec3; 2] {
        let along = [0, 1, 2].map(|axis| self.bounds(axis, cell[axis]));
        [0, 1].map(|end| Vec3::from(along.map(|bounds| bounds[end])))
    }

    /// Edge of a cell within the extent.
    pub(super) fn inner_size(&self) -> f32 {
        self.cell
    }

    /// Edge of a cube as large as a cell.
    pub(super) fn size(&self, cell: IVec3) -> f32 {
        let is_inner =
            (cell - self.outer).min_element() >= 0 && (cell - self.outer).max_element() < self.inner;
        if is_inner {
            return self.cell;
        }
        let [low, high] = self.corners(cell);
        (high - low).element_product().cbrt()
    }

    /// The cell at a position.
    pub(super) fn at(&self, position: Vec3) -> IVec3 {
        IVec3::new(self.along(0, position.x), self.along(1, position.y), self.along(2, position.z))
    }

    /// The Morton number of a cell; `None` outside of the grid.
    pub(super) fn key(&self, cell: IVec3) -> Option<u32> {
        let inside = cell.min_element() >= 0 && cell.max_element() < self.side();
        inside.then(|| spread(cell.x as u32) | spread(cell.y as u32) << 1 | spread(cell.z as u32) << 2)
    }

    /// The cell of a Morton number.
    pub(super) fn cell(key: u32) -> IVec3 {
        IVec3::new(gather(key) as i32, gather(key >> 1) as i32, gather(key >> 2) as i32)
    }
}

/// The ratio of edges with which a number of cells reach as far as `beyond` edges of the first one's neighbour; above 1.
fn growth(beyond: f32, cells: i32) -> f32 {
    let reach = |growth: f64| (1..=cells).map(|cell| growth.powi(cell)).sum::<f64>();
    let (mut least, mut most) = (1.001, 1.001);
    while reach(most) < f64::from(beyond) && most < 1e6 && cells > 0 {
        most *= 2.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (least + most);
        if reach(middle) < f64::from(beyond) { least = middle } else { most = middle }
    }
    most as f32
}

/// Bit i goes to bit 3·i, for ten bits.
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00ff;
    let x = (x | x << 8) & 0x0300_f00f;
    let x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

/// Bit 3·i goes to bit i.
fn gather(x: u32) -> u32 {
    let x = x & 0x0924_9249;
    let x = (x | x >> 2) & 0x030c_30c3;
    let x = (x | x >> 4) & 0x0300_f00f;
    let x = (x | x >> 8) & 0x0300_00ff;
    (x | x >> 16) & 0x3ff
}

/// Indices by key, with open addressing.
pub(super) struct Table {
    slots: Vec<[u32; 2]>,
}

/// Key of an unused slot. Morton numbers have 30 bits.
const UNUSED: u32 = u32::MAX;

impl Table {
    /// A table of keys that differ from one another.
    pub(super) fn new(keys: &[u32]) -> Self {
        let mut table = Self { slots: vec![[UNUSED; 2]; (keys.len() * 2).max(2).next_power_of_two()] };
        for (index, &key) in (0u32..).zip(keys) {
            let slot = table.slot(key);
            table.slots[slot] = [key, index];
        }
        table
    }

    /// The index of a key.
    pub(super) fn get(&self, key: u32) -> Option<u32> {
        let [found, index] = self.slots[self.slot(key)];
        (found == key).then_some(index)
    }

    /// The slot of a key, or the unused one where it would be.
    fn slot(&self, key: u32) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (u64::from(key).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
        while self.slots[slot][0] != key && self.slots[slot][0] != UNUSED {
            slot = (slot + 1) & mask;
        }
        slot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_bring_back_their_cells_and_tables_their_indices() {
        let grid = Grid::around(Vec3::new(3.0, 2.0, 1.0), 0.0, 9);
        let cells = [IVec3::ZERO, IVec3::splat(511), IVec3::new(1, 2, 3), IVec3::new(256, 77, 500)];
        let keys = cells.map(|cell| grid.key(cell).unwrap());
        assert_eq!(keys.map(Grid::cell), cells);
        assert_eq!(grid.key(IVec3::new(0, 512, 0)), None);
        assert_eq!(grid.key(IVec3::NEG_X), None);
        let table = Table::new(&keys);
        assert_eq!(keys.map(|key| table.get(key)), [Some(0), Some(1), Some(2), Some(3)]);
        assert_eq!(table.get(12345), None);
        assert_eq!(Table::new(&[]).get(0), None);
    }

    #[test]
    fn cells_beyond_the_extent_grow_and_leave_those_within_as_they_are() {
        let size = Vec3::new(8.0, 2.0, 8.0);
        for (level, beyond) in [(7, 496.0), (7, 2e5), (5, 40.0), (9, 1e3), (1, 1e4)] {
            let (alone, grid) = (Grid::around(size, 0.0, level), Grid::around(size, beyond, level));
            for at in [Vec3::ZERO, Vec3::new(3.9, -3.9, 0.7)] {
                let offset = IVec3::splat(grid.outer);
                assert_eq!((grid.at(at) - offset, grid.cell), (alone.at(at), alone.cell));
                assert_eq!(grid.corners(grid.at(at)), alone.corners(alone.at(at)));
            }
            // Every position is in its cell, and cells follow one another.
            for i in -100..=100 {
                let share = i as f32 / 100.0;
                let at = Vec3::splat((4.0 + beyond) * share * share * share);
                let cell = grid.at(at);
                assert!(grid.key(cell).is_some(), "{level} {beyond} {at}");
                let [low, high] = grid.corners(cell);
                let slack = 1e-4 * at.abs().max_element().max(grid.cell);
                assert!(
                    (at - low).min_element() >= -slack && (high - at).min_element() >= -slack,
                    "{at} {low} {high}"
                );
                assert!(grid.size(cell) > 0.0);
            }
            for number in 0..grid.side() - 1 {
                let [[_, end], [begin, next]] = [grid.bounds(0, number), grid.bounds(0, number + 1)];
                assert!(end == begin && next > begin, "{level} {beyond} {number}");
            }
        }
        assert_eq!(Grid::around(Vec3::ZERO, 0.0, 3).key(IVec3::splat(7)), Some((1 << 9) - 1));
    }
}
