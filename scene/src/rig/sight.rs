//! What a rig asks about the scene that its cameras stand in.

use std::fmt::Debug;

use glam::DVec3;

use super::greedy;
use super::survey::Target;
use crate::Camera;

/// Who knows what stands between viewers and cameras.
///
/// A rig knows nothing of the scene that it is placed in: some of its cameras come to stand in walls, others behind them. Their
/// samples show little of what a viewer sees, and where surfaces are single-sided, one in a wall sees past all that is solid.
pub trait Sight: Debug + Send + Sync {
    /// The `count` cameras, of these at these places, that together see most of what a view shows, the best first; fewer where
    /// there are fewer. A function of its arguments alone; of scenes that move, at time zero.
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        greedy::best(self, camera, candidates, count)
    }

    /// Whether no surface is between two points.
    fn sees(&self, from: DVec3, to: DVec3) -> bool;

    /// What rays from a viewer meet in some directions, one target each, at a time of the scene in seconds.
    fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target>;

    /// Which of a view's targets a sample camera at a place shows, one answer each, at a time of the scene in seconds.
    fn shows(&self, camera: DVec3, targets: &[Target], time_secs: f64) -> Vec<bool>;
}

/// What a view's cameras are chosen by.
#[derive(Debug, Clone, Copy, Default)]
pub struct Among<'a> {
    /// Refinements that there are samples of, beside the rig's own cameras.
    pub refined: &'a [u64],
    /// Without it the nearest ones are the best.
    pub sight: Option<&'a dyn Sight>,
}
