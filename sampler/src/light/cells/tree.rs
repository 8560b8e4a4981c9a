//! Finds the triangles in a box: a binary tree over triangles along a Morton curve (Lauterbach et al., "Fast BVH
//! Construction on GPUs", 2009), with groups of triangles as leaves.

use glam::Vec3;
use rayon::prelude::*;

use super::super::lattice::Lattice;

/// Triangles of a leaf.
const GROUP: usize = 4;
/// Most triangles of an answer. More are thinned out evenly along the curve, the same ones each time.
pub(super) const MOST_FOUND: usize = 512;

/// Lowest and highest corner.
type Box3 = [Vec3; 2];

/// Boxes around triangles.
///
/// An answer depends on the triangles that meet its box alone: where a triangle stands along the curve does not depend on the
/// others. So what moves elsewhere does not change it.
pub(in crate::light) struct BoxTree {
    /// Numbers of finite triangles, along the curve.
    order: Vec<u32>,
    /// Boxes by height: of groups, of pairs of groups, and so on up to one.
    heights: Vec<Vec<Box3>>,
}

impl BoxTree {
    /// A tree over the triangles of a scene with that lattice, of which those that are not finite are left out.
    pub(in crate::light) fn new(triangles: &[[Vec3; 3]], lattice: &Lattice) -> Self {
        let finite = |triangle: &[Vec3; 3]| triangle.iter().all(|corner| corner.is_finite());
        let (middle, edge) = (lattice.low + 0.5 * lattice.edge, lattice.edge.max(f32::MIN_POSITIVE));
        let code = |triangle: &[Vec3; 3]| {
            let [low, high] = box_of(triangle);
            let from_middle = ((low * 0.5 + high * 0.5) - middle) / edge;
            // Half of the curve is for the lattice's cube, the rest for all that lies beyond.
            let share = from_middle / (0.5 + from_middle.abs()) * 0.5 + 0.5;
            (0..3).fold(0u64, |code, axis| code | spread((share[axis] * 1_048_575.0) as u64) << axis)
        };
        let mut keyed: Vec<(u64, u32)> = (0..triangles.len() as u32)
            .into_par_iter()
            .filter(|&number| finite(&triangles[number as usize]))
            .map(|number| (code(&triangles[number as usize]), number))
            .collect();
        keyed.par_sort_unstable();
        let order: Vec<u32> = keyed.into_iter().map(|(_, number)| number).collect();
        let group = |group: &[u32]| {
            group.iter().fold(EMPTY, |all, &number| union(all, box_of(&triangles[number as usize])))
        };
        let mut heights: Vec<Vec<Box3>> = vec![order.par_chunks(GROUP).map(group).collect()];
        while let Some(below) = heights.last().filter(|below| below.len() > 1) {
            let above = below.par_chunks(2).map(|pair| pair.iter().copied().fold(EMPTY, union)).collect();
            heights.push(above);
        }
        Self { order, heights }
    }

    /// Numbers of the triangles whose boxes meet a box, ascending. `triangles` are those of the tree.
    pub(super) fn within(&self, around: Box3, triangles: &[[Vec3; 3]]) -> Vec<u32> {
        let mut runs = Vec::new();
        if !self.order.is_empty() {
            self.collect(self.heights.len() - 1, 0, around, &mut runs);
        }
        let is_met = |number: &u32| meets(box_of(&triangles[*number as usize]), around);
        let of_run = |(run, is_inside): (std::ops::Range<usize>, bool)| {
            run.map(|place| self.order[place]).filter(move |number| is_inside || is_met(number))
        };
        let mut found: Vec<u32> = runs.into_iter().flat_map(of_run).collect();
        let count = found.len();
        if count > MOST_FOUND {
            // Number i is kept where the i-th of evenly spaced places falls on it.
            let mut places = 0..count;
            found.retain(|_| {
                let i = places.next().unwrap_or_default();
                (i * MOST_FOUND) / count != ((i + 1) * MOST_FOUND) / count
            });
        }
        found.sort_unstable();
        found
    }

    /// Adds the runs of places below a node that may meet a box, each with whether all of it does.
    fn collect(
        &self,
        height: usize,
        node: usize,
        around: Box3,
        runs: &mut Vec<(std::ops::Range<usize>, bool)>,
    ) {
        let of_node = self.heights[height][node];
        if !meets(of_node, around) {
            return;
        }
        let is_inside = (of_node[0].cmpge(around[0]) & of_node[1].cmple(around[1])).all();
        if is_inside || height == 0 {
            let count = GROUP << height;
            runs.push((node * count..((node + 1) * count).min(self.order.len()), is_inside));
            return;
        }
        for child in [2 * node, 2 * node + 1] {
            if child < self.heights[height - 1].len() {
                self.collect(height - 1, child, around, runs);
            }
        }
    }
}

const EMPTY: Box3 = [Vec3::INFINITY, Vec3::NEG_INFINITY];

fn union(a: Box3, b: Box3) -> Box3 {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Whether two boxes have a point in common.
fn meets([low, high]: Box3, around: Box3) -> bool {
    (low.cmple(around[1]) & high.cmpge(around[0])).all()
}

fn box_of(triangle: &[Vec3; 3]) -> Box3 {
    let [a, b, c] = *triangle;
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Bit i goes to bit 3·i, for 20 bits.
fn spread(x: u64) -> u64 {
    let x = x & 0xf_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use argus_scene::light_sampling::r2;

    use super::*;

    fn scattered(count: u32) -> Vec<[Vec3; 3]> {
        let at = |i: u32| {
            let [a, b] = [r2(i), r2(i * 7 + 3)].map(|point| point.as_vec2());
            Vec3::new(a.x, a.y, b.x) * 10.0
        };
        (0..count).map(|i| [at(i), at(i) + Vec3::X * 0.1, at(i) + Vec3::Y * 0.1]).collect()
    }

    fn lattice() -> Lattice {
        Lattice { low: Vec3::splat(1.0), edge: 6.0 }
    }

    #[test]
    fn the_triangles_that_meet_a_box_are_found() {
        let mut triangles = scattered(500);
        triangles[3][1] = Vec3::NAN;
        let tree = BoxTree::new(&triangles, &lattice());
        for i in 0..50 {
            let around = triangles[i * 10 + 1][0] - 0.7;
            let around = [around, around + 1.5];
            let is_met = |number: &u32| *number != 3 && meets(box_of(&triangles[*number as usize]), around);
            let met: Vec<u32> = (0..triangles.len() as u32).filter(is_met).collect();
            assert_eq!(tree.within(around, &triangles), met);
        }
        assert!(BoxTree::new(&[], &lattice()).within([Vec3::ZERO, Vec3::ONE], &[]).is_empty());
    }

    #[test]
    fn an_answer_does_not_depend_on_triangles_elsewhere() {
        let triangles = scattered(5000);
        let around = [Vec3::splat(-1.0), Vec3::new(11.0, 11.0, 6.0)];
        let all = BoxTree::new(&triangles, &lattice()).within(around, &triangles);
        assert_eq!(all.len(), MOST_FOUND);
        let mut moved = triangles.clone();
        for (i, triangle) in moved.iter_mut().enumerate() {
            if triangle[0].z > 6.0 {
                *triangle = triangle.map(|corner| corner + Vec3::new(0.0, 3.0 * i as f32, 1.0));
            }
        }
        assert!(moved != triangles);
        assert_eq!(BoxTree::new(&moved, &lattice()).within(around, &moved), all);
    }

    #[test]
    fn an_answer_is_bounded_and_thinned_out_evenly() {
        let triangles = scattered(5000);
        let tree = BoxTree::new(&triangles, &lattice());
        let found = tree.within([Vec3::splat(-1.0), Vec3::splat(11.0)], &triangles);
        assert_eq!(found.len(), MOST_FOUND);
        let in_half = found.iter().filter(|&&number| triangles[number as usize][0].x < 5.0).count();
        assert!((in_half as f32 / MOST_FOUND as f32 - 0.5).abs() < 0.05, "{in_half}");
    }
}
