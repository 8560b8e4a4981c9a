//! Rays of anybody's choice, each with an origin of its own.

use glam::DVec3;
use rayon::prelude::*;

use super::GpuSampler;

impl GpuSampler {
    /// How far along each ray (origin, direction; metres) the nearest surface lies, in units of the direction; `None`
    /// where there is none, also for a ray that is not finite. On all cores, by the tracer that light paths are
    /// followed by: no program of the device follows rays that have nothing in common.
    pub fn follow_rays(&mut self, rays: &[[DVec3; 2]]) -> Vec<Option<f64>> {
        let tracer = self.visibility.prepare_packets(&self.resident);
        let follow = |[origin, direction]: &[DVec3; 2]| {
            tracer.nearest(*origin, *direction, f64::INFINITY).map(|hit| hit.t)
        };
        rays.par_iter().with_min_len(256).map(follow).collect()
    }
}
