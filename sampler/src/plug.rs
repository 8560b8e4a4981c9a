//! What methods beside the product plug into.
//!
//! A sampler renders samples from triangles, finds indirect light along rays, and fills reflection probes by rays. The crates
//! under `papers/` have other ways. Each implements one of the traits here and adds its constructor to [`Methods`], which are
//! handed to the sampler when it is made. No crate of the product names them. Settings of all methods are part of the scene's
//! vocabulary, since specifications and provenance state them: where a sampler lacks a method that they ask for, it refuses the
//! job with [`missing`].
//!
//! The module also makes public what methods need of a sampler: a tile and its targets ([`TileContext`]), the scene on the device
//! ([`Resident`]) and on the CPU ([`PacketTracer`], [`Surfaces`]), the light of a posed scene ([`LitScene`]), the planes of
//! samples and probes, and maps whose texels name what they see ([`IndexMaps`]).

mod lit_scene;

use std::any::Any;
use std::sync::Arc;

use argus_gpu::{Commands, Gpu};
use argus_scene::{
    Indirect, Instance, InvalidField, Lighting, MegaViews, ProbeEye, ProbeSource, ReflectionProbeSet,
    RenderError, Sample, SampleJob, Sampling, Scene, Stage, ViewJob,
};
use glam::DVec3;

pub use self::lit_scene::LitScene;
pub use crate::eye::Eye;
pub use crate::index_maps::{
    FACES, HalfSpace, IndexMaps, MappedReflector, Requests, face_of, from_face, in_face,
};
pub use crate::indirect::{LightInputs, LightSharing};
pub use crate::mixed::mixed;
pub use crate::packets::cutouts::Cutouts;
pub use crate::packets::{Hit, PacketTracer};
pub use crate::passes::{BlurProbes, PlaneBuffers, ProbePlanes, ResolveSample, TileContext};
pub use crate::point_shading::{CHUNK_SIDE, Points, ShadingPoint, Side, image_of, probe_point};
pub use crate::probe_renderer::{FilledMaps, ProbeBytes, ProbePlaces};
pub use crate::reflected_light::{Met, MetByRay, Ray, ReflectionRays};
pub use crate::resident::{Cull, DrawClass, Features, GuideUse, Placement, Resident, placed, upload};
pub use crate::scratch::{Extras, Guides, Scratch, Targets};
pub use crate::surfaces::{Point, Surfaces};
pub use crate::tile::Tile;
pub use crate::view_reflections::taps;

/// Stage times of several submissions in one table.
pub mod timing {
    pub use crate::timing::{add, add_rest, add_since};
}

/// Renders the samples of a set in another way than from triangles.
pub trait SampleMethod: Send + Sync {
    /// Renders the samples of a job, in the order of its ids. `stages` are the costs of pose and light so far. `None` for a scene
    /// without surfaces, which is rendered from its triangles.
    ///
    /// # Errors
    /// The errors that keep all samples from being rendered.
    fn render(
        &mut self,
        scene: &mut LitScene<'_>,
        job: &SampleJob,
        knobs: MegaViews,
        stages: Vec<Stage>,
    ) -> Result<Option<SampleResults>, RenderError>;

    /// Marks all as out of date, because surfaces moved.
    fn forget_pose(&mut self);

    /// Marks the light as out of date.
    fn forget_light(&mut self);
}

/// A result for each sample of a job.
pub type SampleResults = Vec<Result<Sample, RenderError>>;

/// Finds indirect light. [`Any`] gives access to its report.
pub trait IndirectMethod: Any + Send + Sync {
    /// Changes the settings. Marks the light as out of date. Returns false if they are of another method.
    fn set_knobs(&mut self, knobs: Indirect) -> bool;

    /// Moves instances of a posed scene. Marks the light as out of date.
    fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]);

    /// Prepares the light of tiles, unless it is up to date. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a buffer exceeds what the device can bind, or the errors of the device.
    fn ready(&mut self, inputs: &LightInputs<'_>, scratch: &mut Scratch) -> Result<Vec<Stage>, RenderError>;

    /// Adds the indirect light of a tile that `commands` shade. Returns the commands that later passes are recorded into.
    ///
    /// # Errors
    /// The errors of [`Self::ready`].
    fn add(
        &mut self,
        commands: Commands,
        context: &TileContext<'_>,
        sharing: LightSharing,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError>;
}

/// Renders reflection probes from a scene that it has prepared.
pub trait ProbeMethod: Send + Sync {
    /// Prepares what probes are rendered from, unless it is up to date. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`], or the errors of the device.
    fn ready(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError>;

    /// Renders all probes of a side in texels, once the scene is ready. A scene without surfaces has no probes.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`], or the errors of the device.
    fn render(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        places: &ProbePlaces,
        side: u32,
    ) -> Result<ProbeBytes, RenderError>;

    /// Marks all as out of date, because surfaces moved.
    fn forget_pose(&mut self);

    /// Marks the light as out of date.
    fn forget_light(&mut self);
}

/// Finds what surfaces reflect by points on triangles, in a scene at a pose.
pub trait PointMethod: Send + Sync {
    /// An instance at its pose as a reflector whose map has `side` texels on an edge. `None` for an instance without an extent.
    fn reflector(
        &self,
        scene: &Scene,
        index: u32,
        instance: &Instance,
        viewers: &ProbeEye,
        side: u32,
    ) -> Option<MappedReflector>;

    /// Fills the maps of reflectors, whose sides are equal, from at most `budget` points, as dense as viewers see them.
    /// Positions are relative to `middle`.
    fn fill(
        &self,
        scene: &Scene,
        middle: DVec3,
        reflectors: &[MappedReflector],
        viewers: &ProbeEye,
        budget: u32,
    ) -> FilledMaps;

    /// The maps of the reflectors that a view at a time in seconds sees, from at most `budget` points. `instances` reflect;
    /// `ids` are the view's visibility: instance + 1 and triangle, or zeros for the sky.
    fn maps_of_view(
        self: Arc<Self>,
        scene: &Scene,
        instances: &[u32],
        ids: &[[u32; 2]],
        view: (&ViewJob, f64, u32),
    ) -> Box<dyn ViewMaps>;
}

/// Maps around the reflectors that a view sees.
pub trait ViewMaps: Send + Sync {
    /// What rays meet that begin about an eye: each point once.
    fn meet(&self, eye: DVec3, rays: &[Ray]) -> Met;
}

/// Makes a [`SampleMethod`].
pub type NewSamples = Arc<dyn Fn(&LitScene<'_>, MegaViews) -> Box<dyn SampleMethod> + Send + Sync>;
/// Makes the [`IndirectMethod`] of settings; `None` for settings of another method.
pub type NewIndirect =
    Arc<dyn Fn(&Arc<Gpu>, &Arc<Scene>, &Resident, Indirect) -> Option<Box<dyn IndirectMethod>> + Send + Sync>;
/// Makes a [`ProbeMethod`] from an octree of so many levels.
pub type NewProbes = Arc<dyn Fn(&Gpu, &Resident, GuideUse, u32) -> Box<dyn ProbeMethod> + Send + Sync>;
/// Makes the [`PointMethod`] of a scene at a time in seconds.
pub type NewPoints = Arc<dyn Fn(&Arc<Scene>, f64) -> Arc<dyn PointMethod> + Send + Sync>;

/// Constructors of the methods that a sampler has beside its own. The default has none.
#[derive(Clone, Default)]
pub struct Methods {
    /// Samples for [`Sampling::MegaViews`].
    pub samples: Option<NewSamples>,
    /// Light for [`Indirect::Vpl`] and [`Indirect::Points`].
    pub indirect: Option<NewIndirect>,
    /// Probes for [`ProbeSource::Octree`].
    pub probes: Option<NewProbes>,
    /// Reflections for [`ProbeSource::Points`].
    pub points: Option<NewPoints>,
}

impl Methods {
    /// Checks that indirect light can be found by these settings.
    ///
    /// # Errors
    /// [`missing`], of the field `indirect`.
    pub fn check_indirect(&self, knobs: Indirect) -> Result<(), InvalidField> {
        match knobs {
            Indirect::Vpl(_) | Indirect::Points(_) if self.indirect.is_none() => {
                Err(missing("indirect", if matches!(knobs, Indirect::Vpl(_)) { "vpl" } else { "points" }))
            }
            _ => Ok(()),
        }
    }

    /// Checks that samples can be rendered in this way.
    ///
    /// # Errors
    /// [`missing`], of the field `sampling`.
    pub fn check_sampling(&self, sampling: Sampling) -> Result<(), InvalidField> {
        match sampling {
            Sampling::MegaViews(_) if self.samples.is_none() => Err(missing("sampling", sampling.name())),
            _ => Ok(()),
        }
    }

    /// Checks that reflections can be found in this way.
    ///
    /// # Errors
    /// [`missing`], of the field `reflections`.
    pub fn check_reflections(&self, set: Option<&ReflectionProbeSet>) -> Result<(), InvalidField> {
        let has = |source| match source {
            ProbeSource::Octree { .. } => self.probes.is_some(),
            ProbeSource::Points { .. } => self.points.is_some(),
            ProbeSource::Rays => true,
        };
        match set.map(|set| set.knobs.source).filter(|source| !has(*source)) {
            Some(source) => Err(missing("reflections", source.name())),
            None => Ok(()),
        }
    }
}

/// The error of a field whose value names a method that this build lacks.
pub fn missing(field: &'static str, name: &str) -> InvalidField {
    InvalidField::new(field, format!("{name} is not in this build, which lacks the feature `papers`"))
}
