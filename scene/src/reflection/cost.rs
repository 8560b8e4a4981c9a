//! What reflection probes are predicted to cost, so that the cheapest source can be chosen before anything is rendered.

use std::fmt;

use super::{ProbeSource, Reflections};
use crate::Scene;

/// Predicted cost of all reflection probes of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectionCost {
    /// Number of objects that reflect.
    pub reflectors: usize,
    /// Number of triangles at their instances.
    pub triangles: u64,
    /// Milliseconds of rendering all probes once, on two cores.
    pub ms: f64,
}

/// Milliseconds a triangle of building and lighting an octree.
const OCTREE_TRIANGLE: f64 = 0.05;
/// Milliseconds a texel of a probe from an octree.
const OCTREE_TEXEL: f64 = 9e-4;
/// Milliseconds a triangle and reflector of points.
const POINT_TRIANGLE: f64 = 6.5e-4;
/// Milliseconds a texel of a probe from points.
const POINT_TEXEL: f64 = 1.8e-3;
/// Milliseconds a texel of a probe by rays: one and a half rays of 2.2 million a second, and shading what they met.
const RAY_TEXEL: f64 = 3e-3;

impl ReflectionCost {
    /// The cost of a scene's probes. Constants are from ten mirrors (`argus study reflections`) and a first view of Sponza with
    /// 256 reflectors, with a software driver; shading by rays is estimated.
    pub fn of(scene: &Scene, knobs: &Reflections) -> Self {
        let reflectors = scene.reflectors(knobs.most).len();
        let mesh_triangles =
            |mesh: u32| scene.meshes.get(mesh as usize).map_or(0, |mesh| mesh.triangles() as u64);
        let triangles: u64 = scene.instances.iter().map(|instance| mesh_triangles(instance.mesh)).sum();
        Self { reflectors, triangles, ms: Self::ms(knobs, reflectors as f64, triangles as f64) }
    }

    fn ms(knobs: &Reflections, reflectors: f64, triangles: f64) -> f64 {
        let texels = reflectors * f64::from(knobs.side).powi(2);
        match knobs.source {
            ProbeSource::Octree { .. } => OCTREE_TRIANGLE * triangles + OCTREE_TEXEL * texels,
            ProbeSource::Points { .. } => POINT_TRIANGLE * triangles * reflectors + POINT_TEXEL * texels,
            ProbeSource::Rays => RAY_TEXEL * texels,
        }
    }
}

impl fmt::Display for ReflectionCost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "about {:.2} s for all probes of {} triangles", self.ms * 1e-3, self.triangles)
    }
}
