//! What light cells are of: a posed and lit scene.

use std::sync::Arc;

use argus_scene::Lighting;
use glam::Vec3;

use super::super::paths::Leaves;
use super::super::pose::Pose;
use super::tree::BoxTree;

/// A posed and lit scene, as light cells are filled from it. Positions are metres about the centre of its leaves.
#[derive(Clone)]
pub(in crate::light) struct CellInputs {
    pub(in crate::light) leaves: Arc<Leaves>,
    /// Finds triangles.
    pub(in crate::light) tree: Arc<BoxTree>,
    /// Where instances are; `None` if nothing moves.
    pub(in crate::light) pose: Option<Arc<Pose>>,
    pub(in crate::light) lighting: Lighting,
    /// Radiance that leaf sides reflect; empty if they light nothing.
    pub(in crate::light) radiance: Arc<[Vec3]>,
}

impl CellInputs {
    /// Whether cells of both are the same since nothing was made anew.
    pub(super) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.leaves, &other.leaves)
            && Arc::ptr_eq(&self.radiance, &other.radiance)
            && self.lighting == other.lighting
    }
}
