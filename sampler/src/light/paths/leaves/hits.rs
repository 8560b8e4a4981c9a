//! The leaf side that a ray hits, and what of the leaf sides the answer depends on.

use glam::{IVec3, Vec3};

use super::Leaves;
use super::changes::LeafRead;
use crate::light_rays::RayHit;

impl Leaves {
    /// The leaf side that a ray from `start` along `direction` hits.
    pub(in crate::light) fn hit(&self, start: Vec3, direction: Vec3, hit: &RayHit) -> Option<u32> {
        self.hit_reading(start, direction, hit, |_| {})
    }

    /// The leaf side that a ray from `start` along `direction` hits. `read` is given all that the answer depends on: as long as
    /// nothing of it changes, the same hit has the same answer.
    pub(in crate::light) fn hit_reading(
        &self,
        start: Vec3,
        direction: Vec3,
        hit: &RayHit,
        read: impl FnMut(LeafRead),
    ) -> Option<u32> {
        let first = *self.first_of_instance.get(hit.instance as usize)?;
        let triangle = first.checked_add(hit.primitive)?;
        if triangle as usize >= self.triangles.len() {
            return None;
        }
        let front = self.front(triangle)?;
        let is_front = front.dot(direction) < 0.0;
        let normal = if is_front { front } else { -front };
        self.at(start + direction * hit.t, normal, is_front, read)
    }

    /// The leaf side at a position of a triangle.
    fn at(
        &self,
        position: Vec3,
        normal: Vec3,
        is_front: bool,
        mut read: impl FnMut(LeafRead),
    ) -> Option<u32> {
        const LIKELY: f32 = 0.5;
        let cell = self.grid.at(position);
        let here = self.best_in(cell, normal, is_front);
        if let Some((side, cosine)) = here
            && cosine > LIKELY
        {
            read(side);
            return Some(side);
        }
        self.read_cell(cell, &mut read);
        // Rounding took the position to a neighbouring cell, or its surface has little area in this one.
        let mut best = here;
        for corner in 0..8 {
            let sign = |axis: i32| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let nudge = Vec3::new(sign(0), sign(1), sign(2)) * (0.4 * self.grid.size(cell));
            let near = self.grid.at(position + nudge);
            self.read_cell(near, &mut read);
            let there = self.best_in(near, normal, is_front);
            if there.is_some_and(|(_, cosine)| best.is_none_or(|(_, most)| cosine > most)) {
                best = there;
            }
        }
        let found = best.filter(|(_, cosine)| *cosine > 0.0).map(|(side, _)| side);
        found.inspect(|side| read(*side))
    }

    /// The leaf side of a cell that faces a normal best, and the cosine between.
    fn best_in(&self, cell: IVec3, normal: Vec3, is_front: bool) -> Option<(u32, f32)> {
        let leaf = self.table.get(self.grid.key(cell)?)?;
        let sides = self.sides_in(leaf).filter(|side| self.sides[*side as usize].is_front == is_front);
        sides
            .map(|side| (side, self.sides[side as usize].normal.dot(normal)))
            .max_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// Reads which leaf sides a cell has, if it is one of the grid.
    fn read_cell(&self, cell: IVec3, read: &mut impl FnMut(LeafRead)) {
        let Some(key) = self.grid.key(cell) else { return };
        read(self.read_of(key));
    }
}
