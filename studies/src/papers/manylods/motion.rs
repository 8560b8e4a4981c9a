//! How views and scenes move in the study.

use argus_megaviews::hierarchy::{Triangle, stream};
use argus_megaviews::many_views::ViewPoint;
use glam::DVec3;

use super::stage::Stage;

/// What moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Path {
    /// All views move together.
    Views,
    /// The scene moves: by its own animation, or else bent up and down.
    Scene,
}

impl Path {
    pub(super) const ALL: [Self; 2] = [Self::Views, Self::Scene];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Views => "views",
            Self::Scene => "scene",
        }
    }
}

/// Radius of the views' circle, as a share of the scene's extent: views stay near their start.
const CIRCLE: f64 = 0.1;

/// The views after moving `distance` metres along a slightly tilted circle.
pub(super) fn views_at(stage: &Stage<'_>, distance: f64) -> Vec<ViewPoint> {
    let radius = CIRCLE * stage.extent();
    let turn = distance / radius;
    let along = DVec3::new(turn.sin(), 0.3 * (1.0 - turn.cos()), 1.0 - turn.cos()) * radius / 1.02;
    let moved = |view: &ViewPoint| ViewPoint { position: view.position + along, ..*view };
    stage.views.iter().map(moved).collect()
}

/// The triangles after the fastest part of the scene has moved `distance` metres.
pub(super) fn triangles_at(stage: &Stage<'_>, distance: f64) -> Vec<Triangle> {
    if stage.scene.is_animated() {
        // Animated scenes move by their clock; one second counts as a tenth of the extent.
        let seconds = distance / (0.1 * stage.extent());
        let pose = stage.scene.at(seconds);
        return stream::triangles(stage.scene, &pose).collect();
    }
    // A triangle wave of a tenth of the extent: the most bent point moves at constant speed.
    let most = 0.1 * stage.extent();
    let phase = (distance / most).rem_euclid(4.0);
    let amount = most * if phase < 2.0 { phase - 1.0 } else { 3.0 - phase } + most;
    let amount = 0.5 * amount;
    let (low, size) = (stage.bounds.min, stage.bounds.size().max(DVec3::splat(1e-9)));
    let bend = |p: DVec3| {
        // Zero at the walls, largest in the middle.
        let unit = (p - low) / size;
        let hill = |x: f64| (4.0 * x * (1.0 - x)).max(0.0);
        p + DVec3::new(0.0, 2.0 * amount * hill(unit.x) * hill(unit.z) * 0.5, 0.0)
    };
    stage.triangles.iter().map(|t| Triangle { corners: t.corners.map(bend), ..*t }).collect()
}
