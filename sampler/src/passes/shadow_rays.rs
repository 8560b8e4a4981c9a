//! Program: `shaders/sampler/shadow_rays.wgsl`. Rays from texels to lights, and what arrives.

use std::sync::Arc;

use argus_gpu::{Commands, ComputePipeline, Gpu, wgpu};
use argus_scene::Light;
use argus_scene::effects::SHARED_STAGE;
use argus_scene::light_sampling::{disc_point, r2};
use argus_shaders::layout::sampler::{ShadowLight, shadow_flags};
use argus_shaders::sampler::SHADOW_RAYS;

use super::scattered_rays::{Sought, Tracing};
use crate::lit_tile::LitTexels;

/// Points of a light that a texel in a penumbra looks at; `POINTS` of the program.
const POINTS: u32 = 16;
/// Rows of the timing table.
const SHADOWS: &str = "trace shadows";
const PENUMBRAS: &str = "trace penumbras";

/// Programs for the steps of a light.
pub(crate) struct ShadowRays {
    first_rays: ComputePipeline,
    first_shares: ComputePipeline,
    find_penumbras: ComputePipeline,
    penumbra_rays: ComputePipeline,
    penumbra_shares: ComputePipeline,
    add_light: ComputePipeline,
    /// Points of the unit disc.
    discs: wgpu::Buffer,
}

/// A light of a scene, and what is asked of it.
#[derive(Clone, Copy)]
pub(crate) struct AskedLight<'a> {
    pub(crate) light: &'a Light,
    /// Its index in the buffer of all lights about the eye.
    pub(crate) index: usize,
    pub(crate) all: &'a wgpu::Buffer,
    /// Whether surfaces block it.
    pub(crate) casts_shadows: bool,
    /// Whether its shadows are soft.
    pub(crate) is_soft: bool,
}

impl AskedLight<'_> {
    /// The uniform of its rays. `first`: first texel in a penumbra.
    fn uniform(&self, gpu: &Gpu, first: u32) -> wgpu::Buffer {
        let radius = match self.light {
            Light::Directional { angular_radius, .. } => angular_radius.tan(),
            Light::Point { radius, .. } | Light::Spot { radius, .. } => *radius,
        };
        let soft = if self.is_soft { shadow_flags::SOFT } else { 0 };
        let unblocked = if self.casts_shadows { 0 } else { shadow_flags::UNBLOCKED };
        let (light, radius) = (self.index as u32, radius as f32);
        let uniform = ShadowLight { light, radius, flags: soft | unblocked, first };
        gpu.upload("rays to a light", &[uniform], wgpu::BufferUsages::UNIFORM)
    }
}

impl ShadowRays {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&SHADOW_RAYS, entry);
        let discs: Vec<[f32; 2]> = (1..=POINTS).map(|i| disc_point(r2(i)).as_vec2().to_array()).collect();
        Self {
            first_rays: pipeline("first_rays"),
            first_shares: pipeline("first_shares"),
            find_penumbras: pipeline("find_penumbras"),
            penumbra_rays: pipeline("penumbra_rays"),
            penumbra_shares: pipeline("penumbra_shares"),
            add_light: pipeline("add_light"),
            discs: gpu.upload("points of lights", &discs, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Adds a light to what arrives at texels, as far as it is seen. For a soft shadow each texel first looks at one point of
    /// the light. Where neighbours on the same surface do not agree, each looks at all of [`POINTS`] points.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        gpu: &Arc<Gpu>,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        light: AskedLight<'_>,
    ) {
        let (whole, count) = (light.uniform(gpu, 0), u64::from(texels.count));
        let buffers = &texels.buffers;
        texels
            .bind(commands.compute(SHADOWS, &self.first_rays))
            .read("shadow", &whole)
            .read("lights", light.all)
            .read("discs", &self.discs)
            .write("shadow_rays", &buffers.rays)
            .write("shares", &buffers.shares)
            .dispatch_linear(count);
        if light.casts_shadows {
            let sought = Sought::Passed(&buffers.passed);
            tracing.record_as(SHADOWS, commands, gpu, &buffers.rays, texels.count, sought);
            texels
                .bind_size(commands.compute(SHADOWS, &self.first_shares))
                .write("shadow_rays", &buffers.rays)
                .read("passed", &buffers.passed)
                .write("shares", &buffers.shares)
                .dispatch_linear(count);
        }
        if light.casts_shadows && light.is_soft {
            self.penumbras(commands, gpu, texels, tracing, light);
        }
        texels
            .bind(commands.compute(SHARED_STAGE, &self.add_light))
            .read("shadow", &whole)
            .read("lights", light.all)
            .write("shares", &buffers.shares)
            .write("lit", &buffers.lit)
            .write("seen", &buffers.seen)
            .dispatch_linear(count);
    }

    /// How many texels are in a penumbra is known to the device alone. So rays for all are dispatched, in as many parts as
    /// the buffer of rays demands; those that there are not end at once.
    fn penumbras(
        &self,
        commands: &mut Commands,
        gpu: &Arc<Gpu>,
        texels: &LitTexels,
        tracing: Tracing<'_>,
        light: AskedLight<'_>,
    ) {
        let buffers = &texels.buffers;
        commands.clear(&buffers.penumbra_count);
        texels
            .bind(commands.compute(PENUMBRAS, &self.find_penumbras))
            .write("shares", &buffers.shares)
            .write("penumbra_count", &buffers.penumbra_count)
            .write("penumbra", &buffers.penumbra)
            .dispatch_linear(u64::from(texels.count));
        let each = buffers.capacity / POINTS;
        for first in (0..texels.count).step_by(each as usize) {
            let part = light.uniform(gpu, first);
            texels
                .bind(commands.compute(PENUMBRAS, &self.penumbra_rays))
                .read("shadow", &part)
                .read("lights", light.all)
                .read("discs", &self.discs)
                .write("shadow_rays", &buffers.rays)
                .write("penumbra_count", &buffers.penumbra_count)
                .write("penumbra", &buffers.penumbra)
                .dispatch_linear(u64::from(each * POINTS));
            let sought = Sought::Passed(&buffers.passed);
            tracing.record_as(PENUMBRAS, commands, gpu, &buffers.rays, each * POINTS, sought);
            commands
                .compute(PENUMBRAS, &self.penumbra_shares)
                .read("shadow", &part)
                .write("shadow_rays", &buffers.rays)
                .read("passed", &buffers.passed)
                .write("shares", &buffers.shares)
                .write("penumbra_count", &buffers.penumbra_count)
                .write("penumbra", &buffers.penumbra)
                .dispatch_linear(u64::from(each));
        }
    }
}
