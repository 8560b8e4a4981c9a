//! The light of lights and of the sky, found on the device: rays start at the guides, and nothing is read back.
//!
//! Rays, points of lights and the sky, penumbras and the filter are those of [`super::shadows`], [`super::sky`] and
//! [`super::filter`], in single precision. So texels differ where a ray grazes an edge, and in the last digits.

mod choice;

use std::sync::{Arc, Mutex, PoisonError};

use argus_gpu::{Commands, ComputeCall, Gpu, wgpu};
use argus_scene::{LightEffects, RenderError, Sky};
use argus_shaders::layout::sampler::LitTile as TileUniform;

use super::LightTracing;
use super::filter::REACHES;
use super::pattern::{SLOTS, disc_points};
use crate::LightKnobs;
use crate::light_rays::device::{DevicePlaced, DeviceTrees};
use crate::packets::PacketTracer;
use crate::passes::{
    ArrivingLight, AskedLight, AskedSky, ScatteredRays, ShadowRays, SkyFrom, SkyRays, TileContext, Tracing,
};
use crate::resident::Features;
use crate::scratch::Guides;
pub(super) use choice::chosen;

/// Sizes of tiles whose buffers are kept.
const KEPT: usize = 2;

/// Programs and trees of one scene on one device.
pub(super) struct DeviceLight {
    trees: DeviceTrees,
    tracer: ScatteredRays,
    programs: Programs,
    buffers: Mutex<Vec<LitBuffers>>,
}

struct Programs {
    shadows: ShadowRays,
    sky: SkyRays,
    sum: ArrivingLight,
}

impl Programs {
    fn new(gpu: &Gpu, features: Features) -> Self {
        Self {
            shadows: ShadowRays::new(gpu),
            sky: SkyRays::new(gpu, features, REACHES, &disc_points(SLOTS * LightKnobs::MOST_RAYS as usize)),
            sum: ArrivingLight::new(gpu, features),
        }
    }
}

/// Buffers of a tile's light, one entry a texel.
#[derive(Clone)]
pub(crate) struct LitBuffers {
    count: u32,
    /// Rays that [`Self::rays`] and [`Self::passed`] have room for.
    pub(crate) capacity: u32,
    pub(crate) rays: wgpu::Buffer,
    /// The share of light that passes each ray.
    pub(crate) passed: wgpu::Buffer,
    /// The share of a light that each texel sees.
    pub(crate) shares: wgpu::Buffer,
    /// Texels in a penumbra, and their number.
    pub(crate) penumbra: wgpu::Buffer,
    pub(crate) penumbra_count: wgpu::Buffer,
    /// Irradiance / π of all lights, and which of them are seen.
    pub(crate) lit: wgpu::Buffer,
    pub(crate) seen: wgpu::Buffer,
    /// Sums over rays to the sky, before and after a step of the filter.
    pub(crate) sky: [wgpu::Buffer; 2],
}

impl LitBuffers {
    fn new(gpu: &Gpu, count: u32) -> Self {
        // A texel in a penumbra needs 16.
        let capacity = count.next_multiple_of(16).max(16);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let of = |label, entries: u32, bytes: u64| gpu.buffer(label, u64::from(entries) * bytes, usage);
        Self {
            count,
            capacity,
            rays: of("rays to lights", capacity, 32),
            passed: of("light that passes", capacity, 4),
            shares: of("shares of a light", count, 4),
            penumbra: of("texels in a penumbra", count, 4),
            penumbra_count: of("number of texels in a penumbra", 1, 4),
            lit: of("light of lights", count, 16),
            seen: of("lights that are seen", count, 16),
            sky: [of("light of the sky", count, 32), of("light of the sky, filtered", count, 32)],
        }
    }
}

/// The texels of a tile on the device.
pub(crate) struct LitTexels<'a> {
    tile: wgpu::Buffer,
    guides: &'a Guides,
    pub(crate) count: u32,
}

impl LitTexels<'_> {
    /// Binds what a program reads to find texels.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        self.bind_size(call).read("guide_materials", &self.guides.materials)
    }

    /// Binds what a program reads to find how many texels there are.
    pub(crate) fn bind_size<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        call.read("tile", &self.tile).read("guides", &self.guides.surfaces)
    }
}

/// The light of one tile, as it is recorded.
pub(super) struct LitTile<'a> {
    device: &'a DeviceLight,
    context: &'a TileContext<'a>,
    texels: LitTexels<'a>,
    buffers: LitBuffers,
    placed: DevicePlaced,
}

impl DeviceLight {
    fn new(gpu: &Arc<Gpu>, features: Features, tracer: &PacketTracer) -> Result<Self, RenderError> {
        Ok(Self {
            trees: DeviceTrees::new(gpu, tracer)?,
            tracer: ScatteredRays::new(gpu),
            programs: Programs::new(gpu, features),
            buffers: Mutex::default(),
        })
    }

    /// The same triangles in another light.
    pub(super) fn with_features(self, gpu: &Gpu, features: Features) -> Self {
        Self { programs: Programs::new(gpu, features), ..self }
    }

    /// Takes over the pose of a tracer.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if trees are larger than the device can bind.
    pub(super) fn pose(&mut self, gpu: &Arc<Gpu>, tracer: &PacketTracer) -> Result<(), RenderError> {
        self.trees.pose(gpu, tracer)
    }

    /// Begins the light of a tile, whose first texel has these coordinates in the whole image.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if trees are larger than the device can bind.
    pub(super) fn begin<'a>(
        &'a self,
        context: &'a TileContext<'a>,
        guides: &'a Guides,
        first: [u32; 2],
    ) -> Result<LitTile<'a>, RenderError> {
        let gpu = context.gpu;
        let placed = self.trees.about(gpu, context.eye.position)?;
        let size = context.tile.sub_samples();
        let merged_eye = placed.merged_eye.to_array();
        let tile = TileUniform { merged_eye, _pad: 0.0, size, first };
        let texels = LitTexels {
            tile: gpu.upload("texels of a tile", &[tile], wgpu::BufferUsages::UNIFORM),
            guides,
            count: size[0] * size[1],
        };
        let buffers = self.buffers(gpu, texels.count);
        Ok(LitTile { device: self, context, texels, buffers, placed })
    }

    fn buffers(&self, gpu: &Gpu, count: u32) -> LitBuffers {
        let mut kept = self.buffers.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept.iter().position(|buffers| buffers.count == count);
        let buffers = found.map_or_else(|| LitBuffers::new(gpu, count), |at| kept.remove(at));
        kept.insert(0, buffers.clone());
        kept.truncate(KEPT);
        buffers
    }
}

impl LitTile<'_> {
    fn tracing(&self) -> Tracing<'_> {
        Tracing { rays: &self.device.tracer, trees: &self.device.trees, placed: &self.placed }
    }

    /// Records the light of all lights.
    pub(super) fn lights(&self, commands: &mut Commands, tracing: &LightTracing) {
        let LightEffects { shadows, soft_shadows, .. } = tracing.effects;
        commands.clear(&self.buffers.lit).clear(&self.buffers.seen);
        for (index, light) in tracing.lighting.lights.iter().enumerate() {
            let asked = AskedLight {
                light,
                index,
                all: &self.context.eye.lights,
                casts_shadows: shadows,
                is_soft: shadows && soft_shadows && light.is_extended(),
            };
            let programs = &self.device.programs;
            let texels = (&self.texels, &self.buffers);
            programs.shadows.record(commands, self.context.gpu, texels, self.tracing(), asked);
        }
    }

    /// Records the share of the sky that texels see.
    pub(super) fn sky(&self, commands: &mut Commands, sky: &Sky, knobs: LightKnobs) {
        let asked = AskedSky {
            rays: knobs.sky_rays,
            reach: sky.reach.map_or(f32::MAX, |reach| reach as f32),
            filter: knobs.filter,
        };
        let texels = (&self.texels, &self.buffers);
        self.device.programs.sky.record(commands, (self.context, asked), texels, self.tracing());
    }

    /// Records the sum of all light: [`super::Arriving`] of each texel. `rest`: light that was found on the CPU.
    pub(super) fn sum(
        &self,
        commands: &mut Commands,
        tracing: &LightTracing,
        sky: SkyFrom,
        rest: Option<&wgpu::Buffer>,
    ) -> wgpu::Buffer {
        let texels = (&self.texels, &self.buffers);
        self.device.programs.sum.record(commands, self.context, texels, (sky, tracing.sky.table()), rest)
    }
}
