//! Where a load's clients look: paths around the viewpoints that a scene recommends.

use std::f64::consts::TAU;

use argus_proto::Description;
use argus_scene::Camera;
use glam::{DQuat, DVec3};

/// A viewpoint that moves: the same for the same scene, client and time, on every machine up to the last bits
/// of sines.
///
/// From outside a scene's bounds it swings about what it looks at, as far as ±25° and a tenth nearer or farther;
/// from inside it stays within a hundredth of the scene's size, so that it does not leave the room, and turns
/// its head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPath {
    base: Camera,
    inside: bool,
    /// How far an eye inside the bounds strays, metres.
    stray: f64,
    /// Of this client, in turns.
    phase: f64,
}

/// Full swings take this long: fast enough that no two frames of a second are alike, slow enough that
/// consecutive ones are, as with a person's hand.
const PERIOD_SECS: f64 = 12.0;
/// Each client is this part of a turn after the one before: the golden ratio, which spreads any number of
/// clients evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

impl CameraPath {
    /// The path of client `index`; clients take turns among the recommended viewpoints.
    pub fn new(description: &Description, index: u32) -> Self {
        let cameras = &description.cameras;
        let base = cameras[index as usize % cameras.len().max(1)].camera;
        Self {
            base,
            inside: description.bounds.contains(base.eye),
            stray: description.bounds.size().max_element() * 0.01,
            phase: (f64::from(index) * GOLDEN).fract(),
        }
    }

    /// The camera at a time, seconds.
    pub fn camera(&self, secs: f64) -> Camera {
        let turn = TAU * (secs / PERIOD_SECS + self.phase);
        let up = self.base.up.normalize_or(DVec3::Y);
        let axis = self.base.target - self.base.eye;
        let moved = if self.inside {
            let side = axis.cross(up).normalize_or(DVec3::X);
            let eye = self.base.eye + (side * turn.sin() + up * (2.0 * turn).cos() * 0.5) * self.stray;
            let look = DQuat::from_axis_angle(up, 0.4 * (turn + 0.7).sin()) * axis;
            Camera { eye, target: eye + look, ..self.base }
        } else {
            let swing = DQuat::from_axis_angle(up, 0.436 * turn.sin());
            let eye = self.base.target - swing * axis * (1.0 + 0.1 * (2.0 * turn).cos());
            Camera { eye, ..self.base }
        };
        // A viewpoint at the edge of what is possible may be moved beyond it.
        if moved.validate().is_ok() { moved } else { self.base }
    }
}
