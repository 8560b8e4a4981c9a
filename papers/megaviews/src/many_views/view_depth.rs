//! Computes the depth of the view octree.
//!
//! Views of one leaf share a map, which is rendered from their mean position. A deeper octree has more maps and more
//! pairs, and a smaller distance of views from the centre of their map. So the octree is as shallow as possible with a
//! mean distance of about a cell of the scene, which is the error of maps anyway. The depth is a deterministic function
//! of the views' positions.
//!
//! One level below the cells tells the views of a cell apart by the axis nearest to their direction (`Settings::tells_directions`). The centre of
//! views on both sides of a wall lies on neither side, and sees what none of them does. In Sponza (9 levels, 64K views of four bounces),
//! of the shadows that are hard to tell at 16² texels, 28.8% are wrong with 7 levels of cells (228 million pairs), 25.8% with 8 (304
//! million), and 23.3% with 7 and one of directions (253 million); views by themselves have 22.5% wrong.

use glam::DVec3;

use crate::hierarchy::MAX_DEPTH;

/// Largest root mean square distance of views from the centres of their leaves, in edges of the scene's cells.
const REACH: f64 = 2.0;

/// For each depth, the root mean square distance of views from the centres of their leaves, in edges of the octree's
/// root.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spread([f64; MAX_DEPTH as usize + 1]);

impl Spread {
    /// The distances of views in a unit cube.
    pub(super) fn of(places: &[DVec3]) -> Self {
        let mut sorted: Vec<(u32, DVec3)> = places.iter().map(|&place| (cell(place), place - 0.5)).collect();
        // Views of one cell in a fixed order, so that sums have the same bits in each run.
        sorted.sort_by_key(|view| view.0);
        let squares: f64 = sorted.iter().map(|view| view.1.length_squared()).sum();
        let mut nodes: Vec<Node> =
            sorted.into_iter().map(|(cell, sum)| Node { cell, views: 1.0, sum }).collect();
        let mut distances = [0.0; MAX_DEPTH as usize + 1];
        for level in (0..=MAX_DEPTH).rev() {
            nodes.dedup_by(|next, node| node.takes(next));
            // Sum of squared distances from the mean, from the sums of squares and of positions.
            let between: f64 = nodes.iter().map(|node| node.sum.length_squared() / node.views).sum();
            distances[level as usize] = ((squares - between).max(0.0) / places.len() as f64).sqrt();
            nodes.iter_mut().for_each(|node| node.cell >>= 3);
        }
        Self(distances)
    }

    /// Fewest levels of the view octree with which views lie within [`REACH`] cells of the centres of their leaves.
    /// `cell` is the edge of a cell of the scene, in edges of the views' root.
    pub(super) fn depth(&self, cell: f64) -> u32 {
        (1..MAX_DEPTH).find(|&level| self.0[level as usize] <= REACH * cell).unwrap_or(MAX_DEPTH)
    }
}

/// Views of one cell.
struct Node {
    /// Its Morton code on its level.
    cell: u32,
    views: f64,
    /// Sums over their positions.
    sum: DVec3,
}

impl Node {
    /// Merges another of the same cell. Returns whether it is the same.
    fn takes(&mut self, other: &Self) -> bool {
        let is_same = self.cell == other.cell;
        if is_same {
            self.views += other.views;
            self.sum += other.sum;
        }
        is_same
    }
}

/// Morton code of the cell of the lowest level that contains a point of the unit cube, x lowest.
fn cell(place: DVec3) -> u32 {
    let cells = 1u32 << MAX_DEPTH;
    let at = (place * f64::from(cells)).as_uvec3().min(glam::UVec3::splat(cells - 1));
    let spread = |part: u32| {
        let mut x = part;
        for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
            x = (x | x << shift) & mask;
        }
        x
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Views on a square of that edge in the cube's middle, as far apart from each other.
    fn square(edge: f64, across: u32) -> Vec<DVec3> {
        let at = |i: u32| 0.5 + edge * ((f64::from(i) + 0.5) / f64::from(across) - 0.5);
        (0..across * across).map(|i| DVec3::new(at(i % across), 0.3, at(i / across))).collect()
    }

    #[test]
    fn distances_are_those_from_the_mean_of_each_leaf() {
        let views = square(1.0, 64);
        let spread = Spread::of(&views);
        for (level, distance) in (0..6).zip(spread.0) {
            // A square of so many points a side, uniformly spread.
            let points = 64.0 / f64::from(1u32 << level);
            let expected = (1.0 / 64.0) * ((points * points - 1.0) / 6.0).sqrt();
            assert!((distance - expected).abs() < 1e-9, "{level}: {distance} {expected}");
        }
        assert_eq!(spread.0[6..], [0.0; 5], "each view in a leaf of its own");
    }

    #[test]
    fn dense_views_are_two_levels_above_the_scenes_cells_however_many_there_are() {
        for across in [200, 400, 800] {
            let spread = Spread::of(&square(0.2, across));
            assert_eq!(spread.depth(1.0 / 512.0), 7, "{across}");
            assert_eq!(spread.depth(1.0 / 128.0), 5, "{across}");
        }
    }

    #[test]
    fn few_views_far_apart_and_many_at_one_point_need_no_deep_octree() {
        assert_eq!(Spread::of(&square(1.0, 8)).depth(1.0 / 512.0), 3);
        assert_eq!(Spread::of(&vec![DVec3::new(0.9, 0.1, 1.0); 1000]).depth(1.0 / 512.0), 1);
    }

    #[test]
    fn cells_are_numbered_octant_by_octant_and_end_with_the_cube() {
        assert_eq!(cell(DVec3::ZERO), 0);
        assert_eq!(cell(DVec3::ONE), (1 << 30) - 1);
        assert_eq!(cell(DVec3::new(0.5, 0.0, 0.0)), 1 << 27);
        assert_eq!(cell(DVec3::new(0.0, 0.0, 1.0 / 1024.0)), 4);
    }
}
