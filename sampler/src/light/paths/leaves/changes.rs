//! What changed on leaf sides from one pose or lighting to the next.

use std::cmp::Ordering;

use glam::Vec3;

use super::{Leaves, Side};

/// Something that was read of leaf sides: a leaf side's number, which stands for its radiance and for which leaf sides its cell has;
/// or [`EMPTY`] with a cell's Morton number of 30 bits, for a cell without leaf sides.
pub(in crate::light) type LeafRead = u32;

/// Bit of a cell without leaf sides.
const EMPTY: LeafRead = 1 << 31;
/// Stands for a leaf side that is not as it was.
const CHANGED: u32 = u32::MAX;

/// Changes of leaf sides.
pub(in crate::light) struct LeafChanges {
    /// For each leaf side of before its number now, or [`CHANGED`].
    now: Vec<u32>,
    /// Cells that had no leaf sides and have some now, ascending.
    new: Vec<u32>,
}

impl LeafChanges {
    /// What was read before, as it is named now; `None` if it changed.
    pub(in crate::light) fn now(&self, read: LeafRead) -> Option<LeafRead> {
        match read & EMPTY {
            0 => self.now.get(read as usize).copied().filter(|now| *now != CHANGED),
            _ => self.new.binary_search(&(read & !EMPTY)).is_err().then_some(read),
        }
    }
}

impl Leaves {
    /// The changes since these were of another pose or had other light. `radiance` is what leaf sides reflected before, and reflect
    /// now. `None` if cells are elsewhere now.
    pub(in crate::light) fn changes_from(
        &self,
        before: &Self,
        radiance: [&[Vec3]; 2],
    ) -> Option<LeafChanges> {
        if (self.center, self.grid) != (before.center, before.grid) {
            return None;
        }
        let mut changes = LeafChanges { now: vec![CHANGED; before.sides.len()], new: Vec::new() };
        let (mut old, mut new) = (0, 0);
        while new < self.keys.len() {
            let key = self.keys[new];
            match before.keys.get(old).map_or(Ordering::Greater, |old| old.cmp(&key)) {
                Ordering::Less => old += 1,
                Ordering::Greater => {
                    changes.new.push(key);
                    new += 1;
                }
                Ordering::Equal => {
                    let sides = [before.sides_in(old as u32), self.sides_in(new as u32)];
                    let [was, is] = [&before.sides, &self.sides];
                    let pairs = || sides[0].clone().zip(sides[1].clone());
                    let alike =
                        |(was_at, is_at): (u32, u32)| looks_alike(&was[was_at as usize], &is[is_at as usize]);
                    if sides[0].len() == sides[1].len() && pairs().all(alike) {
                        let [was_lit, is_lit] = radiance;
                        let is_same = |(was_at, is_at): &(u32, u32)| {
                            bits(was_lit.get(*was_at as usize)) == bits(is_lit.get(*is_at as usize))
                        };
                        pairs()
                            .filter(is_same)
                            .for_each(|(was_at, is_at)| changes.now[was_at as usize] = is_at);
                    }
                    (old, new) = (old + 1, new + 1);
                }
            }
        }
        Some(changes)
    }

    /// What reading the leaf sides of a cell depends on, by its Morton number.
    pub(super) fn read_of(&self, key: u32) -> LeafRead {
        self.table.get(key).map_or(key | EMPTY, |leaf| self.first[leaf as usize])
    }
}

/// Whether hits tell two leaf sides apart from others in the same way.
fn looks_alike(one: &Side, other: &Side) -> bool {
    one.is_front == other.is_front && bits(Some(&one.normal)) == bits(Some(&other.normal))
}

fn bits(vector: Option<&Vec3>) -> Option<[u32; 3]> {
    vector.map(|vector| vector.to_array().map(f32::to_bits))
}
