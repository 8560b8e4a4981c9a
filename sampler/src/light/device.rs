//! The light of lights and of the sky, found on the device: rays start at the G-buffer's surfaces, and nothing is read back.
//!
//! Rays, points of lights and the sky, penumbras and the filter are those of [`super::shadows`], [`super::sky`] and
//! [`super::filter`], in single precision. So texels differ where a ray grazes an edge, and in the last digits.

mod choice;

use std::sync::{Arc, Mutex, PoisonError};

use argus_gpu::{Gpu, wgpu};
use argus_scene::{LightEffects, RenderError, Sky};
use argus_shaders::layout::sampler::LitTile as TileUniform;

use super::filter::REACHES;
use super::pattern::{SLOTS, disc_points};
use super::tracing::LightTracing;
use crate::LightSettings;
use crate::frame::Frame;
use crate::light_rays::device::{DevicePlaced, DeviceTrees};
use crate::lit_tile::{LitBuffers, LitTexels};
use crate::packets::PacketTracer;
use crate::passes::{
    ArrivingLight, AskedLight, AskedSky, ScatteredRays, ShadowRays, SkyFrom, SkyRays, TileContext, Tracing,
};
use crate::resident::Features;
use crate::scratch::GBuffer;
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
            sky: SkyRays::new(
                gpu,
                features,
                REACHES,
                &disc_points(SLOTS * LightSettings::MOST_RAYS as usize),
            ),
            sum: ArrivingLight::new(gpu, features),
        }
    }
}

/// A tile whose light is found on the device.
pub(crate) struct LitTile {
    texels: LitTexels,
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
    pub(super) fn begin(
        &self,
        context: &TileContext<'_>,
        g_buffer: &GBuffer,
        first: [u32; 2],
    ) -> Result<LitTile, RenderError> {
        let gpu = context.gpu;
        let placed = self.trees.about(gpu, context.eye.position)?;
        let size = context.tile.sub_samples();
        let merged_eye = placed.merged_eye.to_array();
        let tile = TileUniform { merged_eye, _pad: 0.0, size, first };
        let count = size[0] * size[1];
        let texels = LitTexels {
            tile: gpu.upload("texels of a tile", &[tile], wgpu::BufferUsages::UNIFORM),
            g_buffer: g_buffer.clone(),
            count,
            buffers: self.buffers(gpu, count),
        };
        Ok(LitTile { texels, placed })
    }

    fn buffers(&self, gpu: &Gpu, count: u32) -> LitBuffers {
        let mut kept = self.buffers.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept.iter().position(|buffers| buffers.count == count);
        let buffers = found.map_or_else(|| LitBuffers::new(gpu, count), |at| kept.remove(at));
        kept.insert(0, buffers.clone());
        kept.truncate(KEPT);
        buffers
    }

    fn tracing<'a>(&'a self, tile: &'a LitTile) -> Tracing<'a> {
        Tracing { rays: &self.tracer, trees: &self.trees, placed: &tile.placed }
    }

    /// Records the light of all lights.
    pub(super) fn trace_lights(&self, frame: &mut Frame<'_>, tile: &LitTile, tracing: &LightTracing) {
        let LightEffects { shadows, soft_shadows, .. } = tracing.effects;
        let Frame { commands, context, .. } = frame;
        commands.clear(&tile.texels.buffers.lit).clear(&tile.texels.buffers.seen);
        for (index, light) in tracing.lighting.lights.iter().enumerate() {
            let asked = AskedLight {
                light,
                index,
                all: &context.eye.lights,
                casts_shadows: shadows,
                is_soft: shadows && soft_shadows && light.is_extended(),
            };
            self.programs.shadows.record(commands, context.gpu, &tile.texels, self.tracing(tile), asked);
        }
    }

    /// Records the share of the sky that texels see.
    pub(super) fn trace_sky(
        &self,
        frame: &mut Frame<'_>,
        tile: &LitTile,
        sky: &Sky,
        settings: LightSettings,
    ) {
        let asked = AskedSky {
            rays: settings.sky_rays,
            reach: sky.reach.map_or(f32::MAX, |reach| reach as f32),
            filter: settings.filter,
        };
        let Frame { commands, context, .. } = frame;
        self.programs.sky.record(commands, context, asked, &tile.texels, self.tracing(tile));
    }

    /// Records the sum of all light: [`crate::lit_tile::Arriving`] of each texel. `rest`: light that was found on the CPU.
    pub(super) fn sum(
        &self,
        frame: &mut Frame<'_>,
        tile: &LitTile,
        tracing: &LightTracing,
        sky: SkyFrom,
        rest: Option<&wgpu::Buffer>,
    ) -> wgpu::Buffer {
        let Frame { commands, context, .. } = frame;
        self.programs.sum.record(commands, context, &tile.texels, sky, tracing.sky.table(), rest)
    }
}
