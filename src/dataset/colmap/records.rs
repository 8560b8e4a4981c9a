//! What the files of a model hold.

use anyhow::Context;
use argus_scene::Intrinsics;
use glam::{DQuat, DVec3};

/// A camera of the file `cameras`.
pub(super) struct Sensor {
    pub(super) id: u32,
    pub(super) size: [u32; 2],
    pub(super) lens: Intrinsics,
}

/// An image of the file `images`.
pub(super) struct Image {
    pub(super) id: u32,
    /// Rotation from world to camera, not normalised.
    pub(super) rotation: DQuat,
    pub(super) translation: DVec3,
    pub(super) sensor: u32,
    pub(super) name: String,
}

/// A side of an image, pixels.
pub(super) fn side(pixels: u64) -> anyhow::Result<u32> {
    let fits = u32::try_from(pixels).ok().filter(|side| *side > 0);
    fits.with_context(|| format!("a side of {pixels} pixels: it must be at least 1"))
}
