//! Camera paths of a load's clients around a scene's recommended viewpoints.

use std::f64::consts::TAU;

use argus_proto::Description;
use argus_scene::Camera;
use glam::{DQuat, DVec3};

/// A moving camera, deterministic in scene, client and time (up to the last bits of sines on other machines). It does not know what
/// stands in its way: the walk `loop` is this path, as far as there is room.
///
/// Outside the scene's bounds it swings about its target by up to ±25° and 10% of its distance. Inside, it stays
/// within 1% of the scene's size, so that it does not leave the room, and turns its head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPath {
    base: Camera,
    inside: bool,
    /// Radius in metres of the movement inside the bounds.
    stray: f64,
    /// This client's phase, in turns.
    phase: f64,
}

/// Seconds of a full swing: fast enough that all frames of a second differ, slow enough that consecutive ones are
/// similar, as with a person's hand.
const PERIOD_SECS: f64 = 12.0;
/// Phase between consecutive clients, in turns: the golden ratio spreads any number of clients evenly.
pub(super) const GOLDEN: f64 = 0.618_033_988_749_895;

impl CameraPath {
    /// The path of client `index`. Clients use the recommended viewpoints in turn.
    pub fn new(description: &Description, index: u32) -> Self {
        let cameras = &description.cameras;
        let base = cameras[index as usize % cameras.len().max(1)].camera;
        let path = Self {
            base,
            inside: description.bounds.contains(base.eye),
            stray: description.bounds.size().max_element() * 0.01,
            phase: 0.0,
        };
        path.of_client(index)
    }

    /// The path of another client around the same viewpoint.
    pub(super) fn of_client(self, index: u32) -> Self {
        Self { phase: (f64::from(index) * GOLDEN).fract(), ..self }
    }

    /// The camera that the path leads around.
    pub(super) fn viewpoint(&self) -> Camera {
        self.base
    }

    /// The camera at a time in seconds.
    pub fn camera(&self, secs: f64) -> Camera {
        self.at(self.turn(secs), 1.0)
    }

    /// The part of a full swing (0 to 1) at a time in seconds.
    pub(super) fn turn(&self, secs: f64) -> f64 {
        (secs / PERIOD_SECS + self.phase).rem_euclid(1.0)
    }

    /// The camera at a part of a full swing, displaced by a share (0 to 1) of the swing.
    pub(super) fn at(&self, turn: f64, share: f64) -> Camera {
        let turn = TAU * turn;
        let up = self.base.up.normalize_or(DVec3::Y);
        let axis = self.base.target - self.base.eye;
        let moved = if self.inside {
            let side = axis.cross(up).normalize_or(DVec3::X);
            let stray = (side * turn.sin() + up * (2.0 * turn).cos() * 0.5) * self.stray;
            let eye = self.base.eye + stray * share;
            let look = DQuat::from_axis_angle(up, 0.4 * (turn + 0.7).sin()) * axis;
            Camera { eye, target: eye + look, ..self.base }
        } else {
            let swing = DQuat::from_axis_angle(up, 0.436 * turn.sin());
            let eye = self.base.target - swing * axis * (1.0 + 0.1 * (2.0 * turn).cos());
            Camera { eye: self.base.eye.lerp(eye, share), ..self.base }
        };
        // Extreme viewpoints may become invalid when moved.
        if moved.validate().is_ok() { moved } else { self.base }
    }
}
