//! Direct light by rays: the stages of a frame, and what they need of a scene on a device.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{LightEffects, Lighting, RenderError, Scene, Stage};
use argus_shaders::layout::sampler::ScatteredRay;
use bytes::Bytes;
use glam::DVec3;
use tracing::warn;

use super::device::{self, DeviceLight, LitTile};
use super::on_cpu::{OnCpu, RaysOnCpu};
use super::path_light::PathLight;
use super::sky::SkyIrradiance;
use super::tracing::{LightTracing, emission_textures, emitters_at, reads_textures};
use crate::LightSettings;
use crate::frame::{Frame, Neighbours};
use crate::light_rays::{CullMode, LightRays, RayHit};
use crate::packets::PacketTracer;
use crate::passes::AddDirect;
use crate::resident::Features;
use crate::scratch::GBuffer;

/// Fewest rays of sight that are worth a submission and its readback. An estimate: not measured on a GPU yet.
const LEAST_SEEN: usize = 2048;

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

    /// Whether the CPU traces all rays.
    pub(crate) fn is_on_cpu(&self) -> bool {
        self.device.is_none()
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

    /// Begins the light of a frame on the device. `None` if the CPU finds it: it is the faster one, sub-samples have no neighbours, or
    /// lit leaves do not fit the device.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if trees are larger than the device can bind.
    pub(crate) fn begin(
        &self,
        frame: &Frame<'_>,
        g_buffer: &GBuffer,
        paths: Option<&PathLight>,
    ) -> Result<Option<LitTile>, RenderError> {
        let (Some(device), Neighbours::Image(first)) = (&self.device, frame.neighbours()) else {
            return Ok(None);
        };
        match paths.map_or(Ok(None), |paths| paths.leaves_on_device(frame.context.gpu)) {
            Ok(leaves) => device.begin(&frame.context, g_buffer, first, leaves).map(Some),
            Err(error) => unless_too_large(error),
        }
    }

    /// Looks up light cells on the device, where the frame has them. Where cells may lack, what was found is read back, and cells are
    /// filled. `None` if cells do not fit the device.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn look_up_cells(
        &self,
        frame: &mut Frame<'_>,
        tile: Option<LitTile>,
        paths: Option<&PathLight>,
    ) -> Result<Option<LitTile>, RenderError> {
        let (Some(device), Some(mut tile)) = (&self.device, tile) else { return Ok(None) };
        let is_asked = self.tracing.may_use_cells() && frame.uses_cells();
        let Some(paths) = paths.filter(|_| is_asked) else { return Ok(Some(tile)) };
        match device.look_up_cells(frame, &mut tile, &self.tracing, paths) {
            Ok(()) => Ok(Some(tile)),
            Err(error) => unless_too_large(error),
        }
    }

    /// The nearest surface along each of some rays of sight about an eye, found on the device. `None` if the CPU should trace them: it
    /// is the faster one, or they are few. Its time is added to `stages` where the device has a clock.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn see(
        &self,
        gpu: &Arc<Gpu>,
        eye: DVec3,
        (count, rays): (usize, impl FnOnce() -> Vec<ScatteredRay>),
        stages: &mut Vec<Stage>,
    ) -> Result<Option<Vec<Option<RayHit>>>, RenderError> {
        match self.device.as_ref().filter(|_| count >= LEAST_SEEN) {
            Some(device) => device.see(gpu, eye, &rays(), stages).or_else(unless_too_large),
            None => Ok(None),
        }
    }

    /// Begins the light of a frame on the CPU, by the G-buffer that was read back.
    pub(crate) fn on_cpu<'a>(
        &'a self,
        frame: &Frame<'_>,
        g_buffer: &[Bytes; 2],
        paths: Option<&'a PathLight>,
    ) -> OnCpu<'a> {
        let by = RaysOnCpu {
            tracing: &self.tracing,
            paths,
            ray_divisor: self.ray_divisor,
            is_glossy: self.features.specular,
        };
        OnCpu::new(by, frame, g_buffer)
    }

    /// Finds the light of lights, sky, emitters and other surfaces on the device, as far as it was not looked up in cells.
    pub(crate) fn trace(&self, frame: &mut Frame<'_>, mut tile: LitTile, paths: Option<&PathLight>) {
        let (Some(device), tracing) = (&self.device, &self.tracing) else { return };
        let settings = tracing.settings.divided(self.ray_divisor);
        device.trace_lights(frame, &tile, tracing);
        device.trace_sky(frame, &mut tile, tracing, settings);
        device.trace_emitters(frame, &mut tile, tracing, settings);
        device.gather_paths(frame, &mut tile, paths.map_or(0, |paths| paths.gather_rays(self.ray_divisor)));
        frame.arriving = Some(device.sum(frame, &tile, tracing));
    }

    /// Adds the light that arrives to what was shaded; in views also its reflection on glossy surfaces towards the eye.
    pub(crate) fn add(&self, frame: &mut Frame<'_>, g_buffer: &GBuffer) {
        let Frame { commands, context, arriving, is_view, .. } = frame;
        if let Some(arriving) = arriving {
            self.add.record(commands, context, g_buffer, arriving, *is_view);
        }
    }
}

/// Nothing, for the error of what is too large for the device.
fn unless_too_large<T>(error: RenderError) -> Result<Option<T>, RenderError> {
    match error {
        RenderError::OutOfMemory(reason) => {
            warn!(reason, "light is found on the CPU");
            Ok(None)
        }
        error => Err(error),
    }
}

fn too_large() -> RenderError {
    RenderError::Internal("the scene has too many triangles to trace light in".to_owned())
}
