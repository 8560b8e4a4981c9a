//! Names of samples, and the versions of the scene that they show.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::LightLevel;

/// Names one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SampleId {
    /// Number of the version that it belongs to: [`Version::number`].
    pub version: u64,
    /// Which camera of the rig took it: argument of [`crate::Rig::camera`].
    pub camera: u64,
}

/// What a version shows of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct SceneState {
    /// Scene time: epoch·Δt.
    pub epoch: u64,
    /// How much of the set's light is there.
    pub light: LightLevel,
    /// Number of the state of the nodes' transforms; 0: as in the file. See [`crate::Transforms`].
    #[serde(default)]
    pub revision: u64,
}

impl SceneState {
    /// An epoch in all of the set's light.
    pub fn of_epoch(epoch: u64) -> Self {
        Self { epoch, light: LightLevel::Full, revision: 0 }
    }
}

/// A version of a sample set, as its coordinator issues it. Several versions live side by side, and two of them may show the
/// same state of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct Version {
    /// Ascending; no other version of the set has it.
    pub number: u64,
    /// What its samples show.
    pub state: SceneState,
}

impl Version {
    /// The version of that number which shows an epoch in all of the set's light.
    pub fn of_epoch(number: u64, epoch: u64) -> Self {
        Self { number, state: SceneState::of_epoch(epoch) }
    }
}

impl SampleId {
    /// Camera number of the sample that holds a set's reflection probes. No camera of a rig has this number.
    pub const REFLECTION_PROBES: u64 = u64::MAX;

    /// Version number of direct frames that serve as samples ([`crate::FrameSource`]). No version of a set has this number.
    pub const FRAMES: u64 = u64::MAX - 1;

    /// Whether the sample holds a set's reflection probes ([`crate::reflection`]). Reflections are looked up in them; no
    /// view is warped from them.
    pub fn is_reflection_probe(&self) -> bool {
        self.camera == Self::REFLECTION_PROBES
    }
}

impl fmt::Display for SampleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.version {
            Self::FRAMES => write!(f, "frame/{:016x}", self.camera),
            version => write!(f, "{version}/{}", self.camera),
        }
    }
}
