//! Rays of sight on the device: what reflections show.

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{RenderError, Stage};
use argus_shaders::layout::sampler::{ScatteredHit, ScatteredRay};
use bytemuck::pod_read_unaligned;
use glam::DVec3;
use rayon::prelude::*;

use super::DeviceLight;
use crate::light_rays::RayHit;
use crate::passes::{Sought, Tracing};
use crate::resident::upload;

impl DeviceLight {
    /// The nearest surface along each of some rays about an eye; `None` in the place of all if a walk was cut off.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if rays or trees are larger than the device can bind, or a fault of the device.
    pub(in crate::light) fn see(
        &self,
        gpu: &Arc<Gpu>,
        eye: DVec3,
        rays: &[ScatteredRay],
        stages: &mut Vec<Stage>,
    ) -> Result<Option<Vec<Option<RayHit>>>, RenderError> {
        const EACH: usize = size_of::<ScatteredHit>();
        let placed = self.trees.about(gpu, eye)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let sent = upload(gpu, "reflected rays", rays, usage)?;
        let hits = gpu.buffer("surfaces along rays", (rays.len() * EACH) as u64, usage);
        let mut commands = gpu.commands("trace reflected rays");
        self.tracer.clear_unfinished(&mut commands);
        let tracing = Tracing { rays: &self.tracer, trees: &self.trees, placed: &placed };
        let sought = Sought::Nearest(&hits);
        tracing.record_as("trace reflected rays", &mut commands, gpu, &sent, rays.len() as u32, sought);
        let read = [commands.read_buffer(&hits, 0..hits.size()), self.tracer.read_unfinished(&mut commands)];
        let mut finished = commands.submit().wait()?;
        let [hits, unfinished] = read.map(|pending| finished.take(pending));
        stages.append(&mut finished.stages);
        let found = || hits.par_chunks_exact(EACH).map(|hit| RayHit::of_device(pod_read_unaligned(hit)));
        Ok(unfinished.iter().all(|byte| *byte == 0).then(|| found().collect()))
    }
}
