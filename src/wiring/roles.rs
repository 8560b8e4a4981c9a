//! Creates both roles on one GPU context.

use std::sync::{Arc, Mutex, PoisonError};

use argus_cluster::RoleFactory;
use argus_compositor::{CompositorKnobs, GpuCompositor};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, SamplerKnobs};
use argus_scene::{Compositor, RenderError, SampleSetInfo, Sampler, Scene};

/// This machine's device, opened for the first role and shared by both, so that samples can stay on it.
pub(crate) struct Device {
    gpu: Mutex<Option<Arc<Gpu>>>,
    compositing: CompositorKnobs,
}

impl Device {
    /// A device whose compositor holds at most this many bytes of samples.
    pub(crate) fn new(max_sample_bytes: u64) -> Self {
        let compositing = CompositorKnobs { max_sample_bytes, ..CompositorKnobs::default() };
        Self { gpu: Mutex::default(), compositing }
    }

    /// Opens the device ahead of its first use. An error is reported at that use.
    pub(crate) fn open(&self) {
        let _ = self.gpu();
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
        Ok(Box::new(GpuSampler::with_knobs(self.gpu()?, scene, SamplerKnobs::of(set))?))
    }

    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError> {
        Ok(Box::new(GpuCompositor::with_knobs(self.gpu()?, self.compositing)?))
    }
}
