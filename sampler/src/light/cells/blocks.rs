//! Coarse blocks of a scene, and sets of them that rays cross.
//!
//! A page of cells keeps the set that its rays cross. So it is known whether a mover, by its boxes before and after, may have
//! come into the way of any of them.

use glam::Vec3;

use super::super::lattice::Lattice;

/// Blocks along an axis: [`WITHIN`] in the lattice's cube, and two on each side of it. The outer one of these has no end.
const SIDE: usize = 16;
const WITHIN: usize = SIDE - 4;
/// Planes between the blocks of an axis.
const PLANES: usize = SIDE - 1;
/// Words of a set.
pub(super) const BLOCK_WORDS: usize = SIDE * SIDE * SIDE / 64;
/// Widening of boxes, in edges of the cube and in largest coordinates: more than rays and corners are rounded by.
const SLACK: [f32; 2] = [1e-4, 4e-6];

/// A set of blocks, a bit each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BlockSet([u64; BLOCK_WORDS]);

/// The blocks of a scene. Positions are metres about the centre of its extent.
pub(super) struct Blocks {
    planes: [[f32; PLANES]; 3],
    edge: f32,
}

impl Default for BlockSet {
    fn default() -> Self {
        Self([0; BLOCK_WORDS])
    }
}

impl BlockSet {
    /// The set of these words.
    pub(super) fn from_words(words: [u64; BLOCK_WORDS]) -> Self {
        Self(words)
    }

    /// Words of 64 blocks each.
    pub(super) fn words(&self) -> &[u64; BLOCK_WORDS] {
        let Self(words) = self;
        words
    }

    /// Adds all blocks of another set.
    pub(super) fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(word, other)| *word |= other);
    }

    /// Whether both sets have a block.
    pub(super) fn meets(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).any(|(word, other)| word & other != 0)
    }

    fn insert(&mut self, at: [usize; 3]) {
        let (word, bit) = place_of(at);
        self.0[word] |= bit;
    }
}

/// The word of a block in a set, and its bit there.
fn place_of([x, y, z]: [usize; 3]) -> (usize, u64) {
    let number = x + SIDE * (y + SIDE * z);
    (number / 64, 1 << (number % 64))
}

impl Blocks {
    /// The blocks around a lattice.
    pub(super) fn new(lattice: &Lattice) -> Self {
        let place = |number: usize| match number {
            0 => -1.0,
            PLANES_LAST => 2.0,
            number => (number - 1) as f32 / WITHIN as f32,
        };
        let axis = |axis: usize| std::array::from_fn(|plane| lattice.low[axis] + place(plane) * lattice.edge);
        Self { planes: [0, 1, 2].map(axis), edge: lattice.edge }
    }

    /// Adds the blocks that a ray crosses, up to a distance in units of its direction, which may be infinite.
    pub(super) fn add_ray(&self, set: &mut BlockSet, start: Vec3, direction: Vec3, most: f32) {
        self.crossed_by(start, direction, most, |word, bit| set.0[word] |= bit);
    }

    /// The blocks that such a ray crosses, each as a word of a set and its bit there.
    pub(super) fn crossed_by(
        &self,
        start: Vec3,
        direction: Vec3,
        most: f32,
        mut each: impl FnMut(usize, u64),
    ) {
        let mut at = [0, 1, 2].map(|axis| self.block(axis, start[axis]));
        let mut next = [0, 1, 2].map(|axis| self.leaves_at(axis, at[axis], start, direction));
        loop {
            let (word, bit) = place_of(at);
            each(word, bit);
            let axis =
                if next[0] <= next[1] && next[0] <= next[2] { 0 } else { 1 + usize::from(next[2] < next[1]) };
            // Blocks at both ends have no plane to leave through, which is infinitely far.
            if !(next[axis] <= most && next[axis] < f32::INFINITY) {
                return;
            }
            if direction[axis] > 0.0 {
                at[axis] += 1
            } else {
                at[axis] -= 1
            }
            next[axis] = self.leaves_at(axis, at[axis], start, direction);
        }
    }

    /// Adds the blocks that a box meets.
    pub(super) fn add_box(&self, set: &mut BlockSet, around: [Vec3; 2]) {
        let [low, high] = self.widened(around);
        let span = |axis: usize| self.block(axis, low[axis])..=self.block(axis, high[axis]);
        for z in span(2) {
            for y in span(1) {
                span(0).for_each(|x| set.insert([x, y, z]));
            }
        }
    }

    /// A box with room for what positions are rounded by.
    pub(super) fn widened(&self, [low, high]: [Vec3; 2]) -> [Vec3; 2] {
        let reach = low.abs().max(high.abs()).max_element();
        let slack = SLACK[0] * self.edge + SLACK[1] * reach;
        [low - slack, high + slack]
    }

    /// The block at a coordinate.
    fn block(&self, axis: usize, at: f32) -> usize {
        self.planes[axis].iter().filter(|plane| **plane <= at).count()
    }

    /// How far along a ray it leaves a block along an axis.
    fn leaves_at(&self, axis: usize, block: usize, start: Vec3, direction: Vec3) -> f32 {
        let along = direction[axis];
        let plane = match along.partial_cmp(&0.0) {
            Some(std::cmp::Ordering::Greater) => self.planes[axis].get(block),
            Some(std::cmp::Ordering::Less) => block.checked_sub(1).map(|below| &self.planes[axis][below]),
            _ => None,
        };
        plane.map_or(f32::INFINITY, |plane| (plane - start[axis]) / along)
    }
}

/// The last plane.
const PLANES_LAST: usize = PLANES - 1;

#[cfg(test)]
mod tests {
    use argus_scene::light_sampling::r2;

    use super::*;

    fn blocks() -> Blocks {
        Blocks::new(&Lattice { low: Vec3::new(-6.0, -5.0, -7.0), edge: 12.0 })
    }

    /// A point of a cube of 40 metres, which holds the lattice's.
    fn point(index: u32) -> Vec3 {
        let [a, b] = [r2(index), r2(index * 5 + 2)].map(|point| point.as_vec2());
        (Vec3::new(a.x, a.y, b.x) - 0.5) * 40.0
    }

    #[test]
    fn whatever_a_ray_meets_lies_in_a_block_that_it_crosses() {
        let blocks = blocks();
        let (mut near, mut missed) = (0, 0);
        for index in 0..4000 {
            let (start, end) = (point(index), point(index + 9000));
            let (mut crossed, direction) = (BlockSet::default(), (end - start).normalize());
            let length = start.distance(end);
            blocks.add_ray(&mut crossed, start, direction, length);
            let on = start + direction * (length * r2(index).x as f32);
            let mut met = BlockSet::default();
            blocks.add_box(&mut met, [on - 1e-3, on + 1e-3]);
            assert!(crossed.meets(&met), "ray {index}");
            // A ray without an end crosses what lies beyond.
            let mut whole = BlockSet::default();
            blocks.add_ray(&mut whole, start, direction, f32::INFINITY);
            let mut beyond = BlockSet::default();
            blocks.add_box(&mut beyond, [start + direction * 1e4; 2]);
            assert!(whole.meets(&beyond) && whole.meets(&crossed), "ray {index}");
            // Sets are narrow: a box elsewhere is rarely met.
            let mut other = BlockSet::default();
            blocks.add_box(&mut other, [point(index + 77); 2]);
            near += u32::from(crossed.meets(&other));
            missed += 1;
        }
        assert!(near * 20 < missed, "{near} of {missed} rays cross the block of a point elsewhere");
    }

    #[test]
    fn rays_along_planes_and_axes_stay_in_their_blocks() {
        let blocks = blocks();
        for start in [Vec3::new(-6.0, -5.0, -7.0), Vec3::splat(-5.0), Vec3::new(6.0, 0.0, 0.0)] {
            for direction in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z, Vec3::new(1.0, -0.0, 0.0)] {
                let mut set = BlockSet::default();
                blocks.add_ray(&mut set, start, direction, f32::INFINITY);
                let count: u32 = set.words().iter().map(|word| word.count_ones()).sum();
                assert!((1..=SIDE as u32).contains(&count), "{start} {direction}: {count}");
                let mut along = BlockSet::default();
                blocks.add_box(&mut along, [start + direction * 0.5; 2]);
                assert!(set.meets(&along));
            }
        }
    }
}
