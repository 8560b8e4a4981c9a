//! Samples: planes that a sampler renders and a compositor reconstructs views from.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

pub use crate::sample_id::SampleId;
use crate::{
    Bounds, FaceMask, Indirect, InvalidField, LightEffects, LightLevel, Lighting, OmniLayout, ProbeSource,
    ReflectionProbeSet, Rig, SampleCamera, Sampling, Scene, SceneHash, Specification, Stage, Version,
    Visibility,
};

/// Content of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum PlaneKind {
    /// Linear radiance that does not depend on the viewer: diffuse reflection and emission; the sky's where there is no
    /// surface.
    Radiance,
    /// 1 / distance from the sample's centre, 1/metres; 0 where there is no surface.
    InverseRange,
    /// Shading normal, world space, octahedral. Only in scenes with glossy materials.
    Normal,
    /// F0 in rgb, perceptual roughness in a; F0 is 0 where there is no specular lobe. Only with `Normal`.
    Specular,
    /// Reflection probe that the surface looks up, and the light that passes through the surface. From the lowest bits:
    /// 1 + the number of the probe, 0 for none (11 bits), and the shares of red, green and blue that pass (7 bits
    /// each). Only in sets with reflections.
    Reflector,
    /// Share of each light that the surface sees, in r and g of the two strongest lights, in b of the rest together, and in a
    /// of the sky: [`crate::Lighting::visibility_bytes`]. Only with `Normal`, in sets with effects of light.
    LightVisibility,
    /// Only in samples of reflection probes, one row per probe: its viewpoint as x, y and z from the sample's centre, and
    /// the radius of its reflector around that viewpoint; metres.
    ProbeSphere,
}

/// Storage of a texel. Names, channel order and meaning are those of the wgpu texture format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PlaneFormat {
    /// Three mantissas of 9 bits and a shared exponent of 5.
    Rgb9e5Ufloat,
    /// Four halves.
    Rgba16Float,
    /// One f32. The sampler may have rounded its mantissa, which compresses better.
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

/// Memory of a plane's texels.
#[derive(Clone)]
pub enum PlaneData {
    /// Tightly packed rows, row 0 at the top, little-endian channels.
    Host(Bytes),
    /// A handle that only the GPU crate makes and opens; never crosses a process.
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
    /// Content of a texel.
    pub kind: PlaneKind,
    /// Storage of a texel.
    pub format: PlaneFormat,
    /// Texels: width, height.
    pub size: [u32; 2],
    /// The texels.
    pub data: PlaneData,
}

/// One image of the scene from a sample camera.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Identity of the sample.
    pub id: SampleId,
    /// Camera of the sample.
    pub camera: SampleCamera,
    /// Faces that were rendered. Texels of all others are zero, and mean nothing: they are not seen.
    pub faces: FaceMask,
    /// `Radiance` and `InverseRange` always; `Normal` and `Specular` if the scene is glossy, and `Reflector` if also
    /// the set has reflections. Reflection probes have `Radiance`, `InverseRange` and `ProbeSphere`.
    pub planes: Vec<Plane>,
    /// Cost of its rendering, by pass.
    pub stages: Vec<Stage>,
}

impl Plane {
    /// Texels of a plane of a kind in a sample of a camera.
    pub fn size_of(kind: PlaneKind, camera: &SampleCamera) -> [u32; 2] {
        match (kind, camera) {
            (
                PlaneKind::ProbeSphere,
                SampleCamera::Omni { layout: OmniLayout::ReflectionProbes { count, .. }, .. },
            ) => [4, *count],
            _ => camera.size(),
        }
    }
}

impl Sample {
    /// The plane of a kind, if the sample has one.
    pub fn plane(&self, kind: PlaneKind) -> Option<&Plane> {
        self.planes.iter().find(|plane| plane.kind == kind)
    }
}

/// Properties that all samples of a set share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampleSetInfo {
    /// Hash of the scene.
    pub scene: SceneHash,
    /// Box around everything in the scene: no surface is outside it.
    pub bounds: Bounds,
    /// Box of the surfaces that viewers look at: [`Scene::extent`].
    pub extent: Bounds,
    /// The placement rule.
    pub rig: Rig,
    /// Version of the samples, and the state of the scene that it shows.
    pub version: Version,
    /// Seconds of scene time from one epoch to the next; 0 where the scene is held still.
    pub epoch_secs: f64,
    /// Lights, sky and exposure that the samples were shaded with.
    pub lighting: Lighting,
    /// Visibility backend, the same for all samples of the set on every worker.
    pub visibility: Visibility,
    /// Source of the samples.
    pub sampling: Sampling,
    /// Sub-samples of a texel: 1, 4 or 16.
    pub sub_samples: u32,
    /// Effects of direct light, in samples and in direct views.
    pub effects: LightEffects,
    /// Indirect light, in samples and in direct views.
    pub indirect: Indirect,
    /// Reflection probes of glossy and transparent surfaces; `None` if these reflect only lights and the sky.
    pub reflections: Option<ReflectionProbeSet>,
}

impl SampleSetInfo {
    /// A still set from triangles in the rig's cameras, without lights and without effects of light.
    pub fn plain(scene: SceneHash, bounds: Bounds, rig: Rig) -> Self {
        Self {
            scene,
            bounds,
            extent: bounds,
            rig,
            version: Version::of_epoch(0, 0),
            epoch_secs: 0.0,
            lighting: Lighting::default(),
            visibility: Visibility::default(),
            sampling: Sampling::default(),
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            effects: LightEffects::NONE,
            indirect: Indirect::Off,
            reflections: None,
        }
    }

    /// A still set of a scene in its own light, without shadows and the like.
    pub fn of_scene(scene: &Scene, rig: Rig) -> Self {
        let plain = Self::plain(scene.hash, scene.bounds(), rig);
        Self { extent: scene.extent(), lighting: scene.lighting.clone(), ..plain }
    }

    /// Scene time, seconds: epoch·Δt.
    pub fn time_secs(&self) -> f64 {
        self.version.state.epoch as f64 * self.epoch_secs
    }

    /// The level of light that the set is served in at first. Light among surfaces takes seconds, so that direct light is served
    /// meanwhile. Where maps or probes of an octree would have to be made anew at each level, and where the scene moves, light
    /// stays at the coarse level.
    pub fn first_light(&self) -> LightLevel {
        let from_octree =
            |probes: &ReflectionProbeSet| matches!(probes.settings.source, ProbeSource::Octree { .. });
        let has_octree =
            self.reflections.as_ref().is_some_and(from_octree) || self.sampling != Sampling::Triangles;
        match self.indirect {
            Indirect::Paths(_) | Indirect::Cells(_) if has_octree || self.epoch_secs > 0.0 => {
                LightLevel::Coarse
            }
            Indirect::Paths(_) | Indirect::Cells(_) => LightLevel::Direct,
            Indirect::Off | Indirect::Vpl(_) | Indirect::Points(_) => LightLevel::Full,
        }
    }

    /// The level of light that the set is served in at last.
    pub fn last_light(&self) -> LightLevel {
        match self.first_light() {
            LightLevel::Direct => LightLevel::Full,
            stays => stays,
        }
    }

    /// How the samples are rendered.
    pub fn specification(&self) -> Specification {
        Specification {
            visibility: self.visibility,
            sampling: self.sampling,
            sub_samples: self.sub_samples,
            effects: self.effects,
            indirect: self.indirect,
            reflections: self.reflections,
            exposure: self.lighting.exposure,
        }
    }

    /// The camera of a sample of the set: a camera of the rig, or the one of the reflection probes.
    ///
    /// # Errors
    /// An index that [`Rig::camera`] refuses, or reflection probes of a set without reflections.
    pub fn camera(&self, index: u64) -> Result<SampleCamera, InvalidField> {
        match self.reflections {
            Some(ReflectionProbeSet { settings, count, .. }) if index == SampleId::REFLECTION_PROBES => {
                let layout = OmniLayout::ReflectionProbes { side: settings.side, count };
                Ok(SampleCamera::Omni { center: self.bounds.center(), layout })
            }
            _ => self.rig.camera(index),
        }
    }

    /// Appends the sample of the set's reflection probes, if it has any, to a view's samples of the rig.
    pub fn with_reflection_probes(&self, mut ids: Vec<SampleId>) -> Vec<SampleId> {
        let version = ids.first().map_or(self.version.number, |id| id.version);
        ids.extend(self.reflections.map(|_| SampleId { version, camera: SampleId::REFLECTION_PROBES }));
        ids
    }

    /// The set of the same rig in another version, with the lights and sky of that version.
    pub fn at_version(&self, scene: &Scene, version: Version) -> Self {
        let mut info = Self { version, ..self.clone() };
        info.lighting = Lighting {
            exposure: self.lighting.exposure,
            ..scene.lighting_at(info.time_secs(), version.state.revision)
        };
        info
    }
}

/// Samples of one rig and version.
#[derive(Debug, Clone)]
pub struct SampleSet {
    /// Properties that all of the samples share.
    pub info: Arc<SampleSetInfo>,
    /// The samples, not necessarily all of the rig's.
    pub samples: Vec<Arc<Sample>>,
}
