//! Visibility in the scene around a rig's cameras.

use std::fmt::Debug;

use glam::DVec3;

use super::greedy;
use super::survey::Target;
use crate::Camera;

/// Visibility between viewers and cameras.
///
/// A rig knows only the bounds of its scene, so some of its cameras stand inside walls or behind them. Their samples show
/// few of a viewer's surfaces. Where surfaces are single-sided, a camera in a wall sees through everything solid.
pub trait VisibilityQuery: Debug + Send + Sync {
    /// The `count` of the candidate cameras with their positions that together see most of a view, best first; fewer
    /// if there are fewer. The result depends only on the arguments. A moving scene counts at time zero.
    fn best(&self, camera: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
        greedy::best(self, camera, candidates, count)
    }

    /// Whether no surface is between two points.
    fn sees(&self, from: DVec3, to: DVec3) -> bool;

    /// The targets of rays from a viewer, one per direction, at a time of the scene in seconds.
    fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target>;

    /// Whether a sample camera at a position shows each of a view's targets, at a time of the scene in seconds.
    fn shows(&self, camera: DVec3, targets: &[Target], time_secs: f64) -> Vec<bool>;
}

/// The input for a choice of a view's cameras.
#[derive(Debug, Clone, Copy, Default)]
pub struct CandidateCameras<'a> {
    /// Refinements with samples, beside the rig's own cameras.
    pub refined: &'a [u64],
    /// Without it the nearest cameras count as best.
    pub sight: Option<&'a dyn VisibilityQuery>,
}
