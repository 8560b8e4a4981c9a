//! The viewers whose pixels set the density of points in reflection probes.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{Bounds, Camera, InvalidField, Rig, SampleCamera};

/// The viewers of a sample set, for the density of points. All views of a set share the probes, so it is a box instead of
/// one viewpoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ProbeEye {
    /// Box of viewpoints, metres, world space; not empty.
    pub viewpoints: Bounds,
    /// Texels of a sample on an image plane at unit distance, on a length of 1. No view from samples shows more detail.
    pub pixels: f64,
}

impl ProbeEye {
    /// The viewers of a rig: within the scene's bounds for omnidirectional cameras, and at the height of the cameras over
    /// tiles. `None` for a scene without surfaces.
    pub fn of(rig: &Rig, bounds: &Bounds) -> Option<Self> {
        let eye = match *rig {
            Rig::Cell { face, .. } => Self { viewpoints: *bounds, pixels: 0.5 * f64::from(face) },
            Rig::TileCorners { tiles: [x, z], .. } => {
                // The corners of the first and of the last tile span those of all.
                let last = u64::from(x) * u64::from(z) - 1;
                let indices = (0..4).chain(4 * last..4 * last + 4);
                let mut eye = Self { viewpoints: Bounds::EMPTY, pixels: 0.0 };
                for camera in indices.filter_map(|index| rig.camera(index).ok()) {
                    if let SampleCamera::Perspective { camera, width, height } = camera {
                        eye.viewpoints.extend(camera.eye);
                        eye.pixels = eye.pixels.max(Self::pixels_of(&camera, width, height));
                    }
                }
                eye
            }
        };
        (!eye.viewpoints.is_empty()).then_some(eye)
    }

    fn pixels_of(camera: &Camera, width: u32, height: u32) -> f64 {
        f64::from(height) * 0.5 / camera.tan_half_fov(width, height).y
    }

    pub(super) fn validate(&self) -> Result<(), InvalidField> {
        if self.viewpoints.is_empty() {
            return Err(InvalidField::new("reflections.viewpoints", "must not be empty"));
        }
        // Written so that NaN is refused.
        if !(self.pixels > 0.0 && self.pixels < 1e9) {
            let reason = format!("must be above 0 and below a billion, not {}", self.pixels);
            return Err(InvalidField::new("reflections.pixels", reason));
        }
        Ok(())
    }
}

impl fmt::Display for ProbeEye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Bounds { min, max } = self.viewpoints;
        write!(f, "seen by {} pixels from {min} to {max}", self.pixels)
    }
}
