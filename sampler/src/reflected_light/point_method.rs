//! What finds reflections by points on triangles, where such a method is plugged in.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{Instance, ProbeEye, Scene, ViewJob};
use argus_shaders::layout::sampler::ProbePoint;
use glam::DVec3;

use super::mirror::Ray;
use crate::index_maps::{IndexMaps, MappedReflector, Requests};
use crate::point_shading::Points;

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
        view: &ViewJob,
        time_secs: f64,
        budget: u32,
    ) -> Box<dyn ViewMaps>;
}

/// Maps around the reflectors that a view sees.
pub trait ViewMaps: Send + Sync {
    /// What rays meet that begin about an eye: each point once.
    fn meet(&self, eye: DVec3, rays: &[Ray]) -> Met;
}

/// Makes the [`PointMethod`] of a scene at a time in seconds, for a device.
pub type NewPoints = Arc<dyn Fn(&Arc<Gpu>, &Arc<Scene>, f64) -> Arc<dyn PointMethod> + Send + Sync>;

/// What rays met, to be shaded.
pub struct Met {
    /// Each point once.
    pub points: Points,
    /// For each ray the index of its point; `None` for the sky.
    pub of_ray: Vec<Option<u32>>,
}

impl Met {
    /// Points that are seen along rays, which see one each.
    pub(crate) fn of_points(points: Vec<ProbePoint>) -> Self {
        let of_ray = (0..points.len() as u32).map(Some).collect();
        Self { points: Points { all: points, image: None }, of_ray }
    }
}

/// Some reflectors' cube maps, and the points that they show.
pub struct FilledMaps {
    /// For each texel 1 + the index of its point, or 0 for sky; and its inverse range, 1/metres, f32 bits.
    pub texels: Vec<[u32; 2]>,
    /// The points, each once. Positions are relative to [`crate::probe_renderer::ProbePlaces::middle`].
    pub points: Vec<ProbePoint>,
    /// The rays that found them, if rays did.
    pub rays: Vec<Ray>,
    /// Number of maps.
    pub maps: u32,
}

impl FilledMaps {
    /// Maps whose ids are replaced by places in the list of shown points.
    pub fn new(maps: &IndexMaps, shown: &Requests, points: Vec<ProbePoint>) -> Self {
        let texel = |key: u64| match key {
            0 => [0; 2],
            key => [1 + shown.slot(key as u32) as u32, (key >> 32) as u32],
        };
        Self { texels: maps.bits().map(texel).collect(), points, rays: Vec::new(), maps: maps.count() }
    }
}
