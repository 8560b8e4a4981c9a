//! Ends of a view's rays, and what cameras are worth to them.

use glam::DVec3;

/// Share of a camera's worth that still counts for a target shown by other cameras: between the rays, near edges, it sees
/// surfaces that they do not.
pub(crate) const BESIDES: f64 = 0.3;

/// The end of a view's ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A surface at a point, metres, world space.
    Surface(DVec3),
    /// No surface, in this direction.
    Sky(DVec3),
}

impl Target {
    /// Direction from a position: not of unit length; zero or not finite at the target itself.
    pub(super) fn direction_from(&self, at: DVec3) -> DVec3 {
        match *self {
            Self::Surface(point) => point - at,
            Self::Sky(direction) => direction,
        }
    }

    /// Worth of a camera that sees this target, 0 to 1. It falls at a low angle and with distance from the target. It
    /// also falls with distance from the viewer, since more between the rays is hidden from the camera.
    pub fn worth(&self, camera: DVec3, eye: DVec3) -> f64 {
        let Self::Surface(point) = *self else { return 1.0 };
        let (from_camera, from_eye) = (point - camera, point - eye);
        let (distance, near) = (from_camera.length(), from_eye.length());
        if !(distance > 0.0 && near > 0.0) {
            return 0.0;
        }
        let aside = (from_camera.dot(from_eye) / (distance * near)).max(0.0);
        aside * (near / distance).min(1.0).sqrt() * near / (near + camera.distance(eye))
    }
}

/// Gain of a camera that shows a target with a worth, over cameras that show it with `shown`.
pub(crate) fn added(worth: f64, shown: f64) -> f64 {
    (worth - shown).max(0.0) + BESIDES * worth
}
