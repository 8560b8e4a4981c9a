//! Cells of a cubic grid, numbered along a Morton curve, and a table of those that are occupied.

use glam::{IVec3, Vec3};

/// A cube of 2^level cells on a side. Positions are metres about its centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// The lowest corner.
    pub(super) low: Vec3,
    /// Edge of a cell.
    pub(super) cell: f32,
    /// Cells on a side.
    pub(super) side: i32,
}

impl Grid {
    /// A grid around a box of this size.
    pub(super) fn around(size: Vec3, level: u32) -> Self {
        // Larger than the box, so that walls rarely lie between two cells.
        let edge = size.max_element().max(1e-6) * 1.0037;
        let side = 1 << level;
        Self { low: Vec3::splat(-0.5 * edge), cell: edge / side as f32, side }
    }

    /// The number of a cell along one axis, which may lie outside.
    fn along(&self, axis: usize, at: f32) -> i32 {
        // Saturates.
        ((at - self.low[axis]) / self.cell).floor() as i32
    }

    /// The first and last cell of an extent along an axis.
    pub(super) fn span(&self, axis: usize, [low, high]: [f32; 2]) -> std::ops::RangeInclusive<i32> {
        let last = self.side - 1;
        self.along(axis, low).clamp(0, last)..=self.along(axis, high).clamp(0, last)
    }

    /// Bounds of a cell along an axis. Those of neighbours are equal.
    pub(super) fn bounds(&self, axis: usize, number: i32) -> [f32; 2] {
        [number, number + 1].map(|number| self.low[axis] + number as f32 * self.cell)
    }

    /// The cell at a position.
    pub(super) fn at(&self, position: Vec3) -> IVec3 {
        IVec3::new(self.along(0, position.x), self.along(1, position.y), self.along(2, position.z))
    }

    /// The Morton number of a cell; `None` outside of the grid.
    pub(super) fn key(&self, cell: IVec3) -> Option<u32> {
        let inside = cell.min_element() >= 0 && cell.max_element() < self.side;
        inside.then(|| spread(cell.x as u32) | spread(cell.y as u32) << 1 | spread(cell.z as u32) << 2)
    }

    /// The cell of a Morton number.
    pub(super) fn cell(key: u32) -> IVec3 {
        IVec3::new(gather(key) as i32, gather(key >> 1) as i32, gather(key >> 2) as i32)
    }
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
        let grid = Grid::around(Vec3::new(3.0, 2.0, 1.0), 10);
        let cells = [IVec3::ZERO, IVec3::splat(1023), IVec3::new(1, 2, 3), IVec3::new(512, 77, 1000)];
        let keys = cells.map(|cell| grid.key(cell).unwrap());
        assert_eq!(keys.map(Grid::cell), cells);
        assert_eq!(grid.key(IVec3::new(0, 1024, 0)), None);
        assert_eq!(grid.key(IVec3::NEG_X), None);
        let table = Table::new(&keys);
        assert_eq!(keys.map(|key| table.get(key)), [Some(0), Some(1), Some(2), Some(3)]);
        assert_eq!(table.get(12345), None);
        assert_eq!(Table::new(&[]).get(0), None);
    }
}
