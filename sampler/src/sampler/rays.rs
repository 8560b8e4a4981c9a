//! Single rays with arbitrary origins.

use glam::DVec3;
use rayon::prelude::*;

use super::gpu_sampler::GpuSampler;

impl GpuSampler {
    /// Distance to the nearest surface along each ray (origin, direction; metres), in units of the direction. `None`
    /// without a hit or for a ray that is not finite. Traced in f64 on all cores of the CPU; [`crate::DeviceRays`] measures the
    /// device's tracer.
    pub fn follow_rays(&mut self, rays: &[[DVec3; 2]]) -> Vec<Option<f64>> {
        let tracer = self.visibility.prepare_packets(&self.resident);
        let follow = |[origin, direction]: &[DVec3; 2]| {
            tracer.nearest(*origin, *direction, f64::INFINITY).map(|hit| hit.t)
        };
        rays.par_iter().with_min_len(256).map(follow).collect()
    }
}
