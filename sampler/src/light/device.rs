//! Light that is found on the device: rays start at the G-buffer's surfaces, and nothing is read back but what light cells lack.
//!
//! Rays, points of lights and the sky, penumbras, the filter, the gathering of lit leaves and the lookup of cells are those of
//! [`super::shadows`], [`super::sky`], [`super::emitters`], [`super::filter`], [`super::paths`] and [`super::cells`], in single
//! precision. So texels differ where a ray grazes an edge, and in the last digits.

mod choice;
mod sight;
mod surfaces;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use argus_gpu::{Gpu, wgpu};
use argus_scene::{LightEffects, RenderError};
use argus_shaders::layout::sampler::LitTile as TileUniform;

use super::filter::REACHES;
use super::pattern::{SLOTS, disc_points};
use super::tracing::LightTracing;
use crate::LightSettings;
use crate::frame::Frame;
use crate::light_rays::device::{DevicePlaced, DeviceTrees};
use crate::lit_leaves::DeviceLeaves;
use crate::lit_tile::{LitBuffers, LitTexels};
use crate::packets::PacketTracer;
use crate::passes::{
    AloneRays, ArrivingLight, AskedLight, AskedSky, EmitterRays, GatherRays, LightParts, LookUpCells,
    ScatteredRays, ShadowRays, SkyFrom, SkyRays, SmoothTexels, TileContext, Tracing,
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
    features: Features,
    // Made when they are first used.
    smooth: OnceLock<SmoothTexels>,
    smooth_cells: OnceLock<SmoothTexels>,
    emitters: OnceLock<EmitterRays>,
    gather: OnceLock<GatherRays>,
    /// For what pixels show, and for other areas.
    cells: [OnceLock<LookUpCells>; 2],
    alone: OnceLock<AloneRays>,
}

impl Programs {
    fn new(gpu: &Gpu, features: Features) -> Self {
        Self {
            features,
            smooth: OnceLock::new(),
            smooth_cells: OnceLock::new(),
            emitters: OnceLock::new(),
            gather: OnceLock::new(),
            cells: Default::default(),
            alone: OnceLock::new(),
            shadows: ShadowRays::new(gpu),
            sky: SkyRays::new(
                gpu,
                features,
                REACHES,
                &disc_points(SLOTS * LightSettings::MOST_RAYS as usize),
            ),
            sum: ArrivingLight::new(features),
        }
    }
}

/// A tile whose light is found on the device.
pub(crate) struct LitTile {
    texels: LitTexels,
    placed: DevicePlaced,
    /// What reflects light, if that of surfaces is found.
    leaves: Option<Arc<DeviceLeaves>>,
    /// What was found so far.
    parts: LightParts,
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

    /// Begins the light of a tile, whose first texel has these coordinates in the whole image. `leaves`: what reflects light.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if trees are larger than the device can bind.
    pub(super) fn begin(
        &self,
        context: &TileContext<'_>,
        g_buffer: &GBuffer,
        first: [u32; 2],
        leaves: Option<Arc<DeviceLeaves>>,
    ) -> Result<LitTile, RenderError> {
        let gpu = context.gpu;
        let placed = self.trees.about(gpu, context.eye.position)?;
        let size = context.tile.sub_samples();
        let merged_eye = placed.merged_eye.to_array();
        let tile = TileUniform { merged_eye, _pad: 0.0, size, first };
        let count = size[0] * size[1];
        let texels = LitTexels {
            gpu: Arc::clone(gpu),
            size,
            first,
            tile: gpu.upload("texels of a tile", &[tile], wgpu::BufferUsages::UNIFORM),
            g_buffer: g_buffer.clone(),
            count,
            buffers: self.buffers(gpu, count),
        };
        let parts = LightParts { sky: SkyFrom::Open, emitters: false, surfaces: false };
        Ok(LitTile { texels, placed, leaves, parts })
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

    /// Records the share of the sky that texels see, unless it was looked up.
    pub(super) fn trace_sky(
        &self,
        frame: &mut Frame<'_>,
        tile: &mut LitTile,
        tracing: &LightTracing,
        settings: LightSettings,
    ) {
        let is_cast = tracing.effects.sky_visibility && !tracing.sky.is_black();
        if tile.parts.sky != SkyFrom::Open || !is_cast {
            return;
        }
        let asked = AskedSky {
            rays: settings.sky_rays,
            reach: tracing.lighting.sky.reach.map_or(f32::MAX, |reach| reach as f32),
            filter: settings.filter,
        };
        let Frame { commands, context, .. } = frame;
        self.programs.sky.record(commands, context, asked, &tile.texels, self.tracing(tile));
        tile.parts.sky = SkyFrom::Rays;
    }

    /// Records the sum of all light: [`crate::lit_tile::Arriving`] of each texel.
    pub(super) fn sum(&self, frame: &mut Frame<'_>, tile: &LitTile, tracing: &LightTracing) -> wgpu::Buffer {
        let Frame { commands, context, .. } = frame;
        self.programs.sum.record(commands, context, &tile.texels, tile.parts, tracing.sky.table())
    }
}
