//! The search for a frame within a bound on its error.

use argus_scene::{Camera, PlanRequest};

use crate::core::quality::choose::QualityTarget;
use crate::core::quality::{Setting, Situation};

/// The state of the search for one view.
#[derive(Debug, Clone)]
pub(super) struct TargetSearch {
    pub(super) camera: Camera,
    pub(super) request: PlanRequest,
    pub(super) target: QualityTarget,
    pub(super) situation: Situation,
    pub(super) pixels: u64,
    pub(super) tried: Vec<Setting>,
    pub(super) spent_ms: f64,
    /// Whether the awaited frame must be judged.
    pub(super) judged: bool,
}

impl TargetSearch {
    /// Number of rejected frames.
    pub(super) fn thrown_away(&self) -> u32 {
        u32::try_from(self.tried.len().saturating_sub(1)).unwrap_or(u32::MAX)
    }
}
