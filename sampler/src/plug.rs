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

use std::sync::Arc;

use argus_scene::{
    Indirect, InvalidField, MegaViews, ProbeSource, ReflectionProbeSet, RenderError, Sample, SampleJob,
    Sampling, Stage,
};

pub use crate::eye::Eye;
pub use crate::frame::{Footprint, Frame, LightSharing};
pub use crate::index_maps::{
    FACES, HalfSpace, IndexMaps, MappedReflector, Requests, face_of, from_face, in_face,
};
pub use crate::indirect::{IndirectMethod, LightInputs, NewIndirect};
pub use crate::lit_scene::LitScene;
pub use crate::mixed::mixed;
pub use crate::packets::cutouts::Cutouts;
pub use crate::packets::{Hit, PacketTracer};
pub use crate::passes::{BlurProbes, PlaneBuffers, ProbePlanes, ResolveSample, TileContext};
pub use crate::point_shading::{CHUNK_SIDE, Points, Side, SurfacePoint, image_of, probe_point};
pub use crate::probe_renderer::{NewProbes, ProbeBytes, ProbeMethod, ProbePlaces};
pub use crate::reflected_light::{
    FilledMaps, Met, MetByRay, NewPoints, PointMethod, Ray, ReflectionRays, ViewMaps,
};
pub use crate::resident::{Cull, DrawClass, Features, GBufferUse, Placement, Resident, placed, upload};
pub use crate::scratch::{Extras, GBuffer, Scratch, Targets};
pub use crate::settings::missing;
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
        settings: MegaViews,
        stages: Vec<Stage>,
    ) -> Result<Option<SampleResults>, RenderError>;

    /// Marks all as out of date, because surfaces moved.
    fn forget_pose(&mut self);

    /// Marks the light as out of date.
    fn forget_light(&mut self);
}

/// A result for each sample of a job.
pub type SampleResults = Vec<Result<Sample, RenderError>>;

/// Makes a [`SampleMethod`].
pub type NewSamples = Arc<dyn Fn(&LitScene<'_>, MegaViews) -> Box<dyn SampleMethod> + Send + Sync>;
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
    pub fn check_indirect(&self, settings: Indirect) -> Result<(), InvalidField> {
        match settings {
            Indirect::Vpl(_) | Indirect::Points(_) if self.indirect.is_none() => {
                Err(missing("indirect", if matches!(settings, Indirect::Vpl(_)) { "vpl" } else { "points" }))
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
        match set.map(|set| set.settings.source).filter(|source| !has(*source)) {
            Some(source) => Err(missing("reflections", source.name())),
            None => Ok(()),
        }
    }
}
