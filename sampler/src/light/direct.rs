//! Direct light by rays: the stages of a frame, and what they need of a scene on a device.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{LightEffects, Lighting, RenderError, Scene};
use bytes::Bytes;

use super::device::{self, DeviceLight, LitTile};
use super::on_cpu::{LightOnCpu, OnCpu, RaysOnCpu};
use super::path_light::PathLight;
use super::sky::SkyIrradiance;
use super::tracing::{LightTracing, emission_textures, emitters_at, reads_textures};
use crate::LightSettings;
use crate::frame::{Frame, Neighbours};
use crate::light_rays::{CullMode, LightRays};
use crate::packets::PacketTracer;
use crate::passes::{AddDirect, SkyFrom};
use crate::resident::Features;
use crate::scratch::GBuffer;

/// The direct light of one scene on one device.
pub(crate) struct DirectLight {
    tracing: Arc<LightTracing>,
    /// Traces rays of tiles to lights and to the sky; `None` if the CPU does.
    device: Option<DeviceLight>,
    /// Texels of an image cast one of so many of their rays.
    ray_divisor: u32,
    features: Features,
    add: AddDirect,
}

/// Which light is found, and from which of a scene's lightings.
#[derive(Clone, Copy)]
pub(crate) struct LightConditions<'a> {
    pub(crate) effects: LightEffects,
    pub(crate) settings: LightSettings,
    pub(crate) lighting: &'a Lighting,
    /// Time of the pose, seconds.
    pub(crate) time_secs: f64,
}

impl DirectLight {
    /// The direct light of a scene at the pose of a tracer.
    ///
    /// # Errors
    /// [`RenderError::Internal`] for a scene with too many triangles to trace.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Scene,
        features: Features,
        tracer: &PacketTracer,
        conditions: LightConditions<'_>,
    ) -> Result<Self, RenderError> {
        let rays = LightRays::new(tracer, CullMode::None).ok_or_else(too_large)?;
        let device = device::chosen(gpu, features, tracer, &rays, conditions.settings.tracer)?;
        let lit = Self::with_rays(gpu, scene, features, rays, conditions);
        Ok(Self { device, ..lit })
    }

    /// Direct light that is found by these rays.
    fn with_rays(
        gpu: &Gpu,
        scene: &Scene,
        features: Features,
        rays: LightRays,
        conditions: LightConditions<'_>,
    ) -> Self {
        let LightConditions { effects, settings, lighting, time_secs } = conditions;
        let emission = emission_textures(scene, effects);
        let tracing = LightTracing {
            effects,
            settings,
            rays,
            emitters: emitters_at(scene, &emission, effects, time_secs),
            emission,
            sky: SkyIrradiance::new(&lighting.sky),
            lighting: lighting.clone(),
        };
        let add = AddDirect::new(gpu, features);
        Self { tracing: Arc::new(tracing), device: None, ray_divisor: 1, features, add }
    }

    /// Reads alpha and transmission from another tracer's scene, whose triangles are the same.
    pub(crate) fn share_textures(&mut self, tracer: &PacketTracer) {
        Arc::make_mut(&mut self.tracing).rays.share_textures(tracer);
    }

    /// The direct light of the same triangles in another scene's light, without building trees again.
    pub(crate) fn of_scene(
        self,
        gpu: &Gpu,
        scene: &Scene,
        features: Features,
        tracer: &PacketTracer,
        conditions: LightConditions<'_>,
    ) -> Self {
        let mut rays = Arc::unwrap_or_clone(self.tracing).rays;
        rays.share_textures(tracer);
        let device = self.device.map(|device| device.with_features(gpu, features));
        let lit = Self { device, ..Self::with_rays(gpu, scene, features, rays, conditions) };
        // Programs that were used are compiled.
        if self.features == features { Self { add: self.add, ..lit } } else { lit }
    }

    /// Takes over the pose of a tracer.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn pose(
        &mut self,
        gpu: &Arc<Gpu>,
        scene: &Scene,
        tracer: &PacketTracer,
        time_secs: f64,
    ) -> Result<(), RenderError> {
        if let Some(device) = &mut self.device {
            device.pose(gpu, tracer)?;
        }
        let tracing = Arc::make_mut(&mut self.tracing);
        tracing.emitters = emitters_at(scene, &tracing.emission, tracing.effects, time_secs);
        tracing.rays.pose(tracer).ok_or_else(too_large)
    }

    /// Changes the rays.
    pub(crate) fn set_settings(&mut self, settings: LightSettings) {
        Arc::make_mut(&mut self.tracing).settings = settings;
    }

    /// Changes the effects of later images, at a pose. Emission stays off if it needs textures that are not held. Returns whether
    /// that is possible: not while another thread uses the rays.
    pub(crate) fn set_effects(&mut self, scene: &Scene, effects: LightEffects, time_secs: f64) -> bool {
        let Some(tracing) = Arc::get_mut(&mut self.tracing) else { return false };
        let lacks_textures = reads_textures(scene) && tracing.emission.len() < scene.textures.len();
        let emitters = effects.emitters && !lacks_textures;
        tracing.effects = LightEffects { emitters, ..effects };
        tracing.emitters = emitters_at(scene, &tracing.emission, tracing.effects, time_secs);
        true
    }

    /// Has texels of images cast one of so many of their rays.
    pub(crate) fn divide_rays(&mut self, divisor: u32) {
        self.ray_divisor = divisor;
    }

    /// What rays need, to be shared.
    pub(crate) fn tracing(&self) -> &Arc<LightTracing> {
        &self.tracing
    }

    /// Changes lights and sky.
    pub(crate) fn relight(&mut self, lighting: &Lighting) {
        if self.tracing.lighting == *lighting {
            return;
        }
        let tracing = Arc::make_mut(&mut self.tracing);
        if tracing.lighting.sky != lighting.sky {
            tracing.sky = SkyIrradiance::new(&lighting.sky);
        }
        tracing.lighting = lighting.clone();
    }

    /// Begins the light of a frame on the device. `None` if the CPU traces all rays: it is the faster one, or sub-samples have no
    /// neighbours.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if trees are larger than the device can bind.
    pub(crate) fn begin(
        &self,
        frame: &Frame<'_>,
        g_buffer: &GBuffer,
    ) -> Result<Option<LitTile>, RenderError> {
        match (&self.device, frame.neighbours()) {
            (Some(device), Neighbours::Image(first)) => {
                device.begin(&frame.context, g_buffer, first).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Whether the CPU traces rays of a frame: all of them, or those to emitters and between surfaces.
    pub(crate) fn needs_cpu(&self, tile: Option<&LitTile>, paths: Option<&PathLight>) -> bool {
        tile.is_none() || paths.is_some() || self.tracing.emitters.any()
    }

    /// Begins the light of a frame on the CPU, by the G-buffer that was read back. `tile` is its light on the device.
    pub(crate) fn on_cpu<'a>(
        &'a self,
        frame: &Frame<'_>,
        g_buffer: &[Bytes; 2],
        paths: Option<&'a PathLight>,
        tile: Option<&LitTile>,
    ) -> OnCpu<'a> {
        let by = RaysOnCpu {
            tracing: &self.tracing,
            paths,
            ray_divisor: self.ray_divisor,
            is_glossy: self.features.specular,
            has_device: tile.is_some(),
        };
        OnCpu::new(by, frame, g_buffer)
    }

    /// Traces rays to lights on the device.
    pub(crate) fn trace_lights(&self, frame: &mut Frame<'_>, tile: Option<&LitTile>) {
        if let (Some(device), Some(tile)) = (&self.device, tile) {
            device.trace_lights(frame, tile, &self.tracing);
        }
    }

    /// Traces rays to the sky on the device, and sums the light there. Otherwise the light is that of the CPU.
    pub(crate) fn sum_light(
        &self,
        frame: &mut Frame<'_>,
        tile: Option<&LitTile>,
        on_cpu: Option<LightOnCpu>,
    ) {
        let (Some(device), Some(tile)) = (&self.device, tile) else {
            frame.arriving = on_cpu.map(|light| light.arriving);
            return;
        };
        let tracing = &self.tracing;
        let sky = match tracing.effects.sky_visibility && !tracing.sky.is_black() {
            _ if on_cpu.as_ref().is_some_and(|light| light.has_cells) => SkyFrom::Rest,
            true => SkyFrom::Rays,
            false => SkyFrom::Open,
        };
        if sky == SkyFrom::Rays {
            device.trace_sky(frame, tile, &tracing.lighting.sky, tracing.settings.divided(self.ray_divisor));
        }
        let rest = on_cpu.as_ref().map(|light| &light.arriving);
        frame.arriving = Some(device.sum(frame, tile, tracing, sky, rest));
    }

    /// Adds the light that arrives to what was shaded; in views also its reflection on glossy surfaces towards the eye.
    pub(crate) fn add(&self, frame: &mut Frame<'_>, g_buffer: &GBuffer) {
        let Frame { commands, context, arriving, is_view, .. } = frame;
        if let Some(arriving) = arriving {
            self.add.record(commands, context, g_buffer, arriving, *is_view);
        }
    }
}

fn too_large() -> RenderError {
    RenderError::Internal("the scene has too many triangles to trace light in".to_owned())
}
