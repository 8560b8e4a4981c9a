//! The setup of the image checks: the built-in scene with a sampler, compositors and its reference tracer.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_compositor::{CompositorSettings, GpuCompositor, SearchBackend};
use argus_gpu::Gpu;
use argus_sampler::GpuSampler;
use argus_scene::metrics::{self, Comparison};
use argus_scene::reference::{ReferenceImage, Tracer};
use argus_scene::sample::{Sample, SampleId, SampleSet, SampleSetInfo};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, Output, Plan, RenderError, Rig, RigSettings, SampleJob,
    Sampler as _, Scene, ViewJob, Visibility, Warp,
};
use image::RgbImage;

/// Small enough for seconds, with textures, a shining lake, and trees whose leaves hide each other.
const SCENE: &str = "terrain:20000";
/// Size of a view in pixels.
pub(super) const SIZE: [u32; 2] = [160, 120];
/// Samples per pixel of the reference and of views from triangles.
const SAMPLES_PER_PIXEL: u32 = 16;
/// Number of views.
const VIEWS: usize = 2;
/// Samples used for each warped view.
const SAMPLES: usize = 4;

/// State shared by the image checks.
pub(super) struct Stage {
    pub(super) gpu: Arc<Gpu>,
    pub(super) scene: Arc<Scene>,
    pub(super) sampler: GpuSampler,
    pub(super) cameras: Vec<Camera>,
    pub(super) tracer: Tracer,
    /// The reference of each view.
    pub(super) truth: Vec<RgbImage>,
    info: Arc<SampleSetInfo>,
}

impl Stage {
    pub(super) fn new(gpu: &Arc<Gpu>) -> Result<Self> {
        let mut stage = Self::without_truth(gpu)?;
        let exposure = stage.scene.lighting.exposure;
        let truth = stage.cameras.iter().map(|camera| {
            let image = stage.tracer.render(camera, SIZE[0], SIZE[1], SAMPLES_PER_PIXEL, |_| ());
            image.display(exposure)
        });
        stage.truth = truth.collect();
        Ok(stage)
    }

    /// A stage without references.
    pub(super) fn without_truth(gpu: &Arc<Gpu>) -> Result<Self> {
        let scene = Arc::new(argus_scene::open(SCENE)?);
        let info =
            Arc::new(SampleSetInfo::of_scene(&scene, Rig::for_scene(&scene, &RigSettings::default())?));
        let sampler = GpuSampler::new(Arc::clone(gpu), Arc::clone(&scene))?;
        let tracer = Tracer::new(Arc::clone(&scene));
        let cameras: Vec<Camera> = scene.cameras.iter().take(VIEWS).map(|named| named.camera).collect();
        Ok(Self { gpu: Arc::clone(gpu), scene, sampler, cameras, tracer, truth: Vec::new(), info })
    }

    fn job(&self, camera: Camera, plan: Plan, visibility: Visibility) -> ViewJob {
        ViewJob { visibility, ..ViewJob::new(camera, SIZE, plan) }
    }

    /// Renders all views from triangles.
    pub(super) fn direct(&mut self, backend: Visibility) -> Result<Vec<Frame>> {
        let plan = Plan::direct(SAMPLES_PER_PIXEL);
        let jobs: Vec<_> =
            self.cameras.iter().map(|camera| self.job(*camera, plan.clone(), backend)).collect();
        Ok(self
            .sampler
            .render_views(&jobs, &Cancel::new())
            .into_iter()
            .collect::<Result<_, RenderError>>()?)
    }

    /// Renders the samples for all views, each once.
    pub(super) fn samples(&mut self, to_host: bool) -> Result<Vec<Sample>> {
        let mut ids: Vec<SampleId> = self.cameras.iter().flat_map(|camera| self.ids(camera)).collect();
        ids.sort();
        ids.dedup();
        let job = SampleJob::new(Arc::clone(&self.info), ids, to_host);
        let samples = self.sampler.render_samples(&job, &Cancel::new());
        Ok(samples.into_iter().collect::<Result<_, RenderError>>()?)
    }

    fn ids(&self, camera: &Camera) -> Vec<SampleId> {
        let id = |index| SampleId { version: self.info.version.number, camera: index };
        self.info.rig.nearest(camera, SAMPLES).into_iter().map(id).collect()
    }

    /// A compositor that holds the samples of all views and uses one kind of program.
    pub(super) fn compositor(&mut self, search_backend: SearchBackend) -> Result<GpuCompositor> {
        let samples = self.samples(false)?.into_iter().map(Arc::new).collect();
        let settings = CompositorSettings { search_backend, ..CompositorSettings::default() };
        let mut compositor = GpuCompositor::with_settings(Arc::clone(&self.gpu), settings)?;
        compositor.hold(&SampleSet { info: Arc::clone(&self.info), samples })?;
        Ok(compositor)
    }

    /// Composes all views from samples.
    pub(super) fn warped(&self, compositor: &mut GpuCompositor, warp: &Warp) -> Result<Vec<Frame>> {
        let job = |camera: &Camera| {
            let plan = Plan::Warp(Warp { samples: self.ids(camera), ..warp.clone() });
            self.job(*camera, plan, Visibility::default())
        };
        let jobs: Vec<ViewJob> = self.cameras.iter().map(job).collect();
        Ok(compositor.compose(&jobs, &Cancel::new()).into_iter().collect::<Result<_, RenderError>>()?)
    }

    /// The reference of a camera at one sample per pixel, for its ranges.
    pub(super) fn ranges(&self, camera: &Camera, [width, height]: [u32; 2]) -> ReferenceImage {
        self.tracer.render(camera, width, height, 1, |_| ())
    }

    /// The worst FLIP and PSNR of the views' frames against the reference.
    pub(super) fn judge(&self, frames: &[Frame]) -> Result<Comparison> {
        let judge = |(frame, truth): (&Frame, &RgbImage)| -> Result<Comparison> {
            let pixels = frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
            let image =
                RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")?;
            Ok(metrics::compare(truth, &image)?)
        };
        let judged = frames.iter().zip(&self.truth).map(judge).collect::<Result<Vec<_>>>()?;
        let worst = |a: Comparison, b: Comparison| Comparison {
            flip_mean: a.flip_mean.max(b.flip_mean),
            psnr_db: a.psnr_db.min(b.psnr_db),
            ssim: a.ssim.min(b.ssim),
        };
        judged.into_iter().reduce(worst).context("no view was judged")
    }
}
