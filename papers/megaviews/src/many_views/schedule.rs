//! Computes which hierarchy each step of a traversal divides.
//!
//! All leaves of both octrees are on the lowest level, so all pairs of a breadth-first queue have the same two levels.
//! The paper's choice for each pair (figure 8: the view node is never larger than the scene node) is then made once a
//! step, in advance.

/// One step: divides pairs and tests the results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Step {
    /// Whether view nodes are divided; otherwise scene nodes.
    pub(super) divides_views: bool,
    /// Level of the scene nodes of the resulting pairs.
    pub(super) scene_level: u32,
    /// Level of the view nodes of the resulting pairs.
    pub(super) view_level: u32,
    /// Whether the resulting pairs are pairs of leaves.
    pub(super) leaves: bool,
}

/// The steps from a level of the scene's octree and the root of the view octree to both lowest levels. `view_edge` is the
/// edge of the views' root cube in edges of the scene's.
pub(super) fn steps(from_level: u32, scene_depth: u32, view_depth: u32, view_edge: f64) -> Vec<Step> {
    let (mut scene_level, mut view_level) = (from_level, 0);
    let mut steps = Vec::with_capacity((scene_depth + view_depth) as usize);
    while scene_level < scene_depth || view_level < view_depth {
        let scene_is_larger = 0.5f64.powi(scene_level as i32) > view_edge * 0.5f64.powi(view_level as i32);
        let divides_views = view_level < view_depth && (scene_level == scene_depth || !scene_is_larger);
        if divides_views {
            view_level += 1;
        } else {
            scene_level += 1;
        }
        let leaves = scene_level == scene_depth && view_level == view_depth;
        steps.push(Step { divides_views, scene_level, view_level, leaves });
    }
    steps
}

/// A part of a frame that is traversed at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The subtree of a node of the view octree, `level` levels below the root. `path` has three bits a level.
    Octants { path: u32, level: u32 },
    /// A range of single views.
    Views { first: u32, count: u32 },
}

impl Part {
    /// Splits a part. Empty for a single view or a leaf of the view octree.
    pub(super) fn split(self, view_depth: u32) -> Vec<Self> {
        match self {
            Self::Octants { path, level } if level < view_depth => {
                (0..8).map(|octant| Self::Octants { path: path << 3 | octant, level: level + 1 }).collect()
            }
            Self::Views { first, count } if count > 1 => {
                let each = count.div_ceil(8);
                let part = |at| Self::Views { first: first + at, count: each.min(count - at) };
                (0..count).step_by(each as usize).map(part).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The octant of a part's path at a level.
    pub(super) fn octant(self, at: u32) -> u32 {
        match self {
            Self::Octants { path, level } if at <= level => path >> (3 * (level - at)) & 7,
            _ => 0,
        }
    }

    /// Whether this part counts the pairs of a step. Pairs above a part's node occur in several parts; the first one
    /// counts them.
    pub(super) fn counts(self, step: &Step) -> bool {
        match self {
            Self::Octants { level, .. } => (step.view_level + 1..=level).all(|at| self.octant(at) == 0),
            Self::Views { .. } => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn divided(scene_depth: u32, view_depth: u32, view_edge: f64) -> String {
        let letter = |step: &Step| if step.divides_views { 'v' } else { 's' };
        steps(0, scene_depth, view_depth, view_edge).iter().map(letter).collect()
    }

    #[test]
    fn equal_octrees_are_divided_in_turn_the_views_first() {
        assert_eq!(divided(3, 3, 1.0), "vsvsvs");
    }

    #[test]
    fn where_one_ends_the_other_goes_on() {
        assert_eq!(divided(4, 2, 1.0), "vsvsss");
        assert_eq!(divided(2, 4, 1.0), "vsvsvv");
        assert_eq!(divided(3, 0, 1.0), "sss");
    }

    #[test]
    fn views_spread_more_widely_than_the_scene_are_divided_until_they_are_not() {
        assert_eq!(divided(2, 4, 3.9), "vvsvsv");
    }

    #[test]
    fn leaves_of_the_scene_meet_the_views_level_by_level() {
        let steps = steps(4, 4, 2, 1.0);
        assert!(steps.iter().all(|step| step.divides_views && step.scene_level == 4));
        assert_eq!(steps.len(), 2);
    }

    #[test]
    fn only_the_last_step_makes_pairs_of_leaves() {
        for step in steps(0, 5, 3, 1.0).split_last().unwrap().1 {
            assert!(!step.leaves);
        }
        assert!(steps(0, 5, 3, 1.0).last().unwrap().leaves);
    }
}
