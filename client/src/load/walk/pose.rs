//! What all walks share: cameras by viewer and time, and how a camera is moved.

use std::fmt;

use argus_scene::Camera;
use glam::DVec3;

/// The moving viewpoints of all viewers of a load.
pub(super) trait Walk: fmt::Debug + Send + Sync {
    /// The camera of a viewer, counted from 0, at a time in seconds. It is valid.
    fn camera(&self, viewer: u32, secs: f64) -> Camera;
}

/// A camera moved to an eye and turned to a direction. If that camera is invalid, the base stays.
pub(super) fn moved(base: Camera, eye: DVec3, look: DVec3) -> Camera {
    let moved = Camera { eye, target: eye + look, ..base };
    if moved.validate().is_ok() { moved } else { base }
}

/// The upward direction of a camera's image.
pub(super) fn up(camera: &Camera) -> DVec3 {
    camera.up.normalize_or(DVec3::Y)
}
