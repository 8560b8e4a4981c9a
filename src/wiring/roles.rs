//! Creates both roles on one GPU context.

use std::sync::{Arc, Mutex, PoisonError};

use argus_cluster::RoleFactory;
use argus_compositor::{CompositorSettings, GpuCompositor};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, PreparedSampler, SamplerSettings};
use argus_scene::{Compositor, RenderError, SampleSetInfo, Sampler, Scene};

use super::methods::methods;

/// This machine's device, opened for the first role and shared by both, so that samples can stay on it.
pub(crate) struct Device {
    gpu: Mutex<Option<Arc<Gpu>>>,
    compositing: CompositorSettings,
    /// A sampler of the scene that will probably be rendered.
    prepared: Mutex<Option<PreparedSampler>>,
}

impl Device {
    /// A device whose compositor holds at most this many bytes of samples.
    pub(crate) fn new(max_sample_bytes: u64) -> Self {
        let compositing = CompositorSettings { max_sample_bytes, ..CompositorSettings::default() };
        Self { gpu: Mutex::default(), compositing, prepared: Mutex::default() }
    }

    /// Opens the device ahead of its first use. An error is reported at that use.
    pub(crate) fn open(&self) {
        let _ = self.gpu();
    }

    /// Prepares a sampler of a scene, as it was opened, that will probably be rendered. An error is reported when the sampler is
    /// made.
    pub(crate) fn prepare(&self, scene: &Arc<Scene>) {
        let began = std::time::Instant::now();
        let prepared = self.gpu().and_then(|gpu| PreparedSampler::new(gpu, scene, methods()));
        tracing::debug!(ms = began.elapsed().as_secs_f64() * 1e3, ok = prepared.is_ok(), "sampler prepared");
        *self.prepared.lock().unwrap_or_else(PoisonError::into_inner) = prepared.ok();
    }

    fn gpu(&self) -> Result<Arc<Gpu>, RenderError> {
        let mut held = self.gpu.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(gpu) = held.as_ref().filter(|gpu| gpu.lost().is_none()) {
            return Ok(gpu.clone());
        }
        // The lost device is released first: it may hold memory that the new one needs.
        *held = None;
        let gpu = Gpu::new(&GpuOptions::default()).map_err(|error| error.into_render())?;
        tracing::info!("rendering on {}", gpu.kind());
        *held = Some(gpu.clone());
        Ok(gpu)
    }
}

impl RoleFactory for Device {
    fn sampler(&self, scene: Arc<Scene>, set: &SampleSetInfo) -> Result<Box<dyn Sampler>, RenderError> {
        let (gpu, settings) = (self.gpu()?, SamplerSettings::of(set));
        let prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner).take();
        let sampler = match prepared.filter(|prepared| prepared.is_of(&gpu, &scene)) {
            Some(prepared) => prepared.in_light(scene, settings),
            None => GpuSampler::with_methods(gpu, scene, settings, methods()),
        };
        Ok(Box::new(sampler?))
    }

    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError> {
        Ok(Box::new(GpuCompositor::with_settings(self.gpu()?, self.compositing)?))
    }
}
