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
/// Milliseconds a texel of a probe by rays: one and a half rays, and shading what they met.
const RAY_TEXEL: f64 = 9e-4;

impl ReflectionCost {
    /// The costs of a scene's probes by several settings. Constants are from ten mirrors (`argus-lab study method probes`) and a first
    /// view of Sponza with 256 reflectors, with a software driver.
    pub fn of<const N: usize>(scene: &Scene, all: [Reflections; N]) -> [Self; N] {
        let found = scene.reflectors(u32::MAX).len();
        let of_mesh = |mesh: u32| scene.meshes.get(mesh as usize).map_or(0, |mesh| mesh.triangles() as u64);
        let triangles: u64 = scene.instances.iter().map(|instance| of_mesh(instance.mesh)).sum();
        all.map(|settings| {
            let reflectors = found.min(settings.most as usize);
            Self { reflectors, triangles, ms: Self::ms(&settings, reflectors as f64, triangles as f64) }
        })
    }

    fn ms(settings: &Reflections, reflectors: f64, triangles: f64) -> f64 {
        let texels = reflectors * f64::from(settings.side).powi(2);
        match settings.source {
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

#[cfg(all(test, feature = "procedural"))]
mod tests {
    use super::*;
    use crate::procedural::mirrors;

    #[test]
    fn points_cost_with_triangles_times_reflectors_and_rays_with_reflectors_alone() {
        let cost = |triangles, reflectors| {
            Reflections::USUAL.map(|settings| ReflectionCost::ms(&settings, reflectors, triangles))
        };
        let [[_, points, rays], [_, twice_points, twice_rays]] = [cost(1e6, 10.0), cost(2e6, 10.0)];
        assert!(twice_points > 1.5 * points && twice_rays == rays);
        assert!(cost(1e6, 20.0)[2] == 2.0 * rays);
        assert!(cost(1e6, 256.0).iter().all(|ms| ms.is_finite() && *ms > 0.0));
    }

    #[test]
    fn reflectors_beyond_the_limit_cost_nothing() {
        let few = Reflections { most: 2, ..Reflections::default() };
        let [all, two] = ReflectionCost::of(&mirrors(5), [Reflections::default(), few]);
        assert_eq!((all.reflectors, two.reflectors), (5, 2));
        assert!(two.ms < all.ms && two.triangles == all.triangles);
    }
}
