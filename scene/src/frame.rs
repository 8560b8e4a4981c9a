//! Frames: the reply to a view, with what it cost, how sure it is, and where it came from.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::{Plan, SceneHash};

/// One timed step of the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// A phrase, such as `splat samples`.
    pub name: String,
    /// Milliseconds.
    pub ms: f64,
}

impl Stage {
    /// A named duration.
    pub fn new(name: impl Into<String>, ms: f64) -> Self {
        Self { name: name.into(), ms }
    }
}

/// All that a frame's bytes are a function of, together with its camera, size and outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Scene.
    pub scene: SceneHash,
    /// Scene time.
    pub epoch: u64,
    /// Placement of the samples.
    pub generation: u64,
    /// How it was answered, sample ids included.
    pub plan: Plan,
    /// Kind of device: adapter, driver and version. Empty in a pin means any.
    pub device: String,
}

/// The reply to a view. Images are tightly packed, row 0 at the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// sRGB, 3 bytes a pixel.
    pub color: Option<Bytes>,
    /// f32 little-endian, metres from the eye, +inf where there is nothing.
    pub range: Option<Bytes>,
    /// A byte a pixel: 255 where no sample saw it.
    pub mask: Option<Bytes>,
    /// A byte a pixel: 1 + position of the sample in the plan's list, 0 for none.
    pub source: Option<Bytes>,
    /// Fraction of pixels that no sample saw; 0 for a direct view.
    pub unresolved_fraction: f64,
    /// What it was made of.
    pub provenance: Provenance,
    /// What it cost. A batch's cost is shared out evenly among its views.
    pub stages: Vec<Stage>,
}
