//! Samples: what a sampler rendered, plane by plane, and what a compositor reconstructs views from.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::{
    Bounds, Indirect, InvalidField, Lighting, OmniLayout, Rig, SampleCamera, Sampling, Scene, SceneHash,
    Specification, Stage, Surroundings, Visibility,
};

/// Names one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SampleId {
    /// Number of the version that it belongs to: [`Version::number`].
    pub version: u64,
    /// Which camera of the rig took it: argument of [`Rig::camera`].
    pub camera: u64,
}

/// What a version shows of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct SceneState {
    /// Scene time: epoch·Δt.
    pub epoch: u64,
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
    /// The version of that number which shows an epoch.
    pub fn of_epoch(number: u64, epoch: u64) -> Self {
        Self { number, state: SceneState { epoch } }
    }
}

impl SampleId {
    /// The camera of a set's surroundings: no camera of a rig has its number.
    pub const SURROUNDINGS: u64 = u64::MAX;

    /// Whether it names a set's surroundings: the maps that reflections are looked up in ([`crate::reflection`]), which no
    /// view is warped from.
    pub fn is_surroundings(&self) -> bool {
        self.camera == Self::SURROUNDINGS
    }
}

impl fmt::Display for SampleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.version, self.camera)
    }
}

/// What a plane holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum PlaneKind {
    /// Linear radiance that does not depend on the viewer: diffuse reflection and emission; where there is
    /// no surface, the sky's.
    Radiance,
    /// 1 / distance from the sample's centre, 1/metres; 0 where there is no surface.
    InverseRange,
    /// Shading normal, world space, octahedral. Only in scenes with glossy materials.
    Normal,
    /// F0 in rgb, perceptual roughness in a; F0 is 0 where there is no specular lobe. Only with `Normal`.
    Specular,
    /// Which map of the set's surroundings the surface looks up, and what passes through it; from the lowest bits: 1 + the
    /// number of the map, 0 for none (11 bits), and the shares of red, green and blue that pass (7 each). Only in sets with
    /// reflections.
    Reflector,
    /// Of surroundings alone, a row a map: where it is seen from, as x, y and z from the sample's centre, and how far from
    /// there its reflector reaches; metres.
    Place,
}

/// How a texel is stored. Names, channel order and meaning are those of the wgpu texture format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PlaneFormat {
    /// Three mantissas of 9 bits and a shared exponent of 5.
    Rgb9e5Ufloat,
    /// Four halves.
    Rgba16Float,
    /// One f32. The sampler may have rounded its mantissa, which makes it pack better.
    R32Float,
    /// Two signed 16-bit fractions.
    Rg16Snorm,
    /// Four unsigned 8-bit fractions.
    Rgba8Unorm,
    /// One u32.
    R32Uint,
}

impl PlaneFormat {
    /// Bytes of one texel.
    pub fn texel_bytes(self) -> usize {
        match self {
            Self::Rgba16Float => 8,
            Self::Rgb9e5Ufloat | Self::R32Float | Self::Rg16Snorm | Self::Rgba8Unorm | Self::R32Uint => 4,
        }
    }
}

/// Where a plane's texels are.
#[derive(Clone)]
pub enum PlaneData {
    /// Tightly packed rows, row 0 at the top, little-endian channels.
    Host(Bytes),
    /// A handle that the GPU crate made and it alone can open; never crosses a process.
    Device(Arc<dyn Any + Send + Sync>),
}

impl fmt::Debug for PlaneData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Host(bytes) => write!(f, "Host({} bytes)", bytes.len()),
            Self::Device(_) => f.write_str("Device"),
        }
    }
}

/// One image of a sample.
#[derive(Debug, Clone)]
pub struct Plane {
    /// What it holds.
    pub kind: PlaneKind,
    /// How a texel is stored.
    pub format: PlaneFormat,
    /// Texels: width, height.
    pub size: [u32; 2],
    /// The texels.
    pub data: PlaneData,
}

/// One image of the scene from a sample camera.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Which.
    pub id: SampleId,
    /// Where from.
    pub camera: SampleCamera,
    /// `Radiance` and `InverseRange` always; `Normal` and `Specular` where the scene is glossy, and `Reflector` where such a
    /// set has reflections. Surroundings have the first two, and `Place`.
    pub planes: Vec<Plane>,
    /// What rendering it cost, by pass.
    pub stages: Vec<Stage>,
}

impl Plane {
    /// Texels that a plane of that kind has in a sample of that camera.
    pub fn size_of(kind: PlaneKind, camera: &SampleCamera) -> [u32; 2] {
        match (kind, camera) {
            (PlaneKind::Place, SampleCamera::Omni { layout: OmniLayout::Surroundings { count, .. }, .. }) => {
                [4, *count]
            }
            _ => camera.size(),
        }
    }
}

impl Sample {
    /// The plane of that kind, if the sample has one.
    pub fn plane(&self, kind: PlaneKind) -> Option<&Plane> {
        self.planes.iter().find(|plane| plane.kind == kind)
    }
}

/// What all samples of a set have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampleSetInfo {
    /// Of which scene.
    pub scene: SceneHash,
    /// Box around everything in the scene: no surface is outside it.
    pub bounds: Bounds,
    /// The placement rule.
    pub rig: Rig,
    /// Which version the samples are, and what it shows.
    pub version: Version,
    /// Seconds of scene time from one epoch to the next; 0 where the scene is held still.
    pub epoch_secs: f64,
    /// Lights, sky and exposure that the samples were shaded with.
    pub lighting: Lighting,
    /// How their triangles are seen: alike in all of them, whoever renders them.
    pub visibility: Visibility,
    /// What they are rendered from.
    pub sampling: Sampling,
    /// Sub-samples of each texel: 1, 4 or 16.
    pub sub_samples: u32,
    /// How light from surface to surface is found, in samples and in direct views.
    pub indirect: Indirect,
    /// The maps that glossy and transparent surfaces look up; `None` where they reflect lights and the sky alone.
    pub reflections: Option<Surroundings>,
}

impl SampleSetInfo {
    /// Scene time, seconds: epoch·Δt.
    pub fn time_secs(&self) -> f64 {
        self.version.state.epoch as f64 * self.epoch_secs
    }

    /// How its samples are rendered.
    pub fn specification(&self) -> Specification {
        Specification {
            visibility: self.visibility,
            sampling: self.sampling,
            sub_samples: self.sub_samples,
            indirect: self.indirect,
            reflections: self.reflections,
            exposure: self.lighting.exposure,
        }
    }

    /// The camera of a sample of the set: the rig's, or that of its surroundings.
    ///
    /// # Errors
    /// That of [`Rig::camera`]; also for surroundings of a set without reflections.
    pub fn camera(&self, index: u64) -> Result<SampleCamera, InvalidField> {
        match self.reflections {
            Some(Surroundings { knobs, count }) if index == SampleId::SURROUNDINGS => {
                let layout = OmniLayout::Surroundings { side: knobs.side, count };
                Ok(SampleCamera::Omni { center: self.bounds.center(), layout })
            }
            _ => self.rig.camera(index),
        }
    }

    /// What a view from these samples of the rig is composed of: them, and the set's surroundings if it has any.
    pub fn with_surroundings(&self, mut ids: Vec<SampleId>) -> Vec<SampleId> {
        let version = ids.first().map_or(self.version.number, |id| id.version);
        ids.extend(self.reflections.map(|_| SampleId { version, camera: SampleId::SURROUNDINGS }));
        ids
    }

    /// The same set in another version, which may be lit otherwise.
    pub fn at_version(&self, scene: &Scene, version: Version) -> Self {
        let mut info = Self { version, ..self.clone() };
        info.lighting = scene.at(info.time_secs()).lighting;
        info
    }
}

/// Samples of one rig and version.
#[derive(Debug, Clone)]
pub struct SampleSet {
    /// What they have in common.
    pub info: Arc<SampleSetInfo>,
    /// The samples, not necessarily all that the rig could place.
    pub samples: Vec<Arc<Sample>>,
}
