//! Finds the triangles in a box: a binary tree over triangles along a Morton curve (Lauterbach et al., "Fast BVH
//! Construction on GPUs", 2009), with groups of triangles as leaves.

use glam::Vec3;
use rayon::prelude::*;

/// Triangles of a leaf.
const GROUP: usize = 4;
/// Most triangles of an answer. More are thinned out evenly along the curve, the same ones each time.
pub(super) const MOST_FOUND: usize = 512;

/// Lowest and highest corner.
type Box3 = [Vec3; 2];

/// Boxes around triangles.
pub(in crate::light) struct BoxTree {
    /// Numbers of finite triangles, along the curve.
    order: Vec<u32>,
    /// Boxes by height: of groups, of pairs of groups, and so on up to one.
    heights: Vec<Vec<Box3>>,
}

impl BoxTree {
    /// A tree over triangles, of which those that are not finite are left out.
    pub(in crate::light) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let finite = |triangle: &[Vec3; 3]| triangle.iter().all(|corner| corner.is_finite());
        let around =
            triangles.par_iter().filter(|triangle| finite(triangle)).map(box_of).reduce(|| EMPTY, union);
        let size = (around[1] - around[0]).max(Vec3::splat(f32::MIN_POSITIVE));
        let code = |triangle: &[Vec3; 3]| {
            let [low, high] = box_of(triangle);
            let share = ((low * 0.5 + high * 0.5) - around[0]) / size;
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

    /// Numbers of the triangles in a box and of some near it, ascending.
    pub(super) fn within(&self, around: Box3) -> Vec<u32> {
        let mut runs = Vec::new();
        if !self.order.is_empty() {
            self.collect(self.heights.len() - 1, 0, around, &mut runs);
        }
        let count: usize = runs.iter().map(|run: &std::ops::Range<usize>| run.len()).sum();
        let all = runs.into_iter().flatten().map(|place| self.order[place]);
        let mut found: Vec<u32> = match count <= MOST_FOUND {
            true => all.collect(),
            // Number i is kept where the i-th of evenly spaced places falls on it.
            false => all
                .enumerate()
                .filter(|(i, _)| (i * MOST_FOUND) / count != ((i + 1) * MOST_FOUND) / count)
                .map(|(_, number)| number)
                .collect(),
        };
        found.sort_unstable();
        found
    }

    fn collect(&self, height: usize, node: usize, around: Box3, runs: &mut Vec<std::ops::Range<usize>>) {
        let [low, high] = self.heights[height][node];
        if !(low.cmple(around[1]) & high.cmpge(around[0])).all() {
            return;
        }
        let is_inside = (low.cmpge(around[0]) & high.cmple(around[1])).all();
        if is_inside || height == 0 {
            let of_node = GROUP << height;
            runs.push(node * of_node..((node + 1) * of_node).min(self.order.len()));
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

    #[test]
    fn every_triangle_that_meets_a_box_is_found() {
        let mut triangles = scattered(500);
        triangles[3][1] = Vec3::NAN;
        let tree = BoxTree::new(&triangles);
        for i in 0..50 {
            let low = triangles[i * 10 + 1][0] - 0.7;
            let found = tree.within([low, low + 1.5]);
            assert!(found.is_sorted());
            for (number, triangle) in (0u32..).zip(&triangles) {
                let [least, most] = box_of(triangle);
                let meets = (least.cmple(low + 1.5) & most.cmpge(low)).all() && number != 3;
                assert!(!meets || found.contains(&number), "{number}");
            }
        }
        assert!(BoxTree::new(&[]).within([Vec3::ZERO, Vec3::ONE]).is_empty());
    }

    #[test]
    fn an_answer_is_bounded_and_thinned_out_evenly() {
        let triangles = scattered(5000);
        let tree = BoxTree::new(&triangles);
        let found = tree.within([Vec3::splat(-1.0), Vec3::splat(11.0)]);
        assert_eq!(found.len(), MOST_FOUND);
        let in_half = found.iter().filter(|&&number| triangles[number as usize][0].x < 5.0).count();
        assert!((in_half as f32 / MOST_FOUND as f32 - 0.5).abs() < 0.05, "{in_half}");
    }
}
