//! The setup that studies without a network share: one scene, its sampler, its compositor and its reference tracer.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_compositor::{GpuCompositor, SearchBackend};
use argus_gpu::Gpu;
use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::metrics::{self, Comparison};
use argus_scene::reference::{DirectLight, Indirect as Paths, SceneSight, Tracer, cache};
use argus_scene::rig::{CandidateCameras, VisibilityQuery};
use argus_scene::sample::{SampleId, SampleSet, SampleSetInfo};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, InvalidField, Output, Outputs, Plan, RenderError, Rig,
    RigSettings, SampleJob, Sampler as _, Sampling, Scene, Version, ViewJob, Visibility,
};
use glam::{DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;

use crate::median::{mean, median};

/// Both roles for one scene, in one process and on one device, so that no network time is measured.
pub(crate) struct Bench {
    pub(crate) scene: Arc<Scene>,
    pub(crate) info: Arc<SampleSetInfo>,
    pub(crate) sampler: GpuSampler,
    pub(crate) compositor: GpuCompositor,
    pub(crate) tracer: Tracer,
    /// Light between surfaces in references.
    truth_paths: Option<Paths>,
    sight: Option<SceneSight>,
}

/// What rendering a set of samples cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SamplingCost {
    pub(crate) count: usize,
    /// Milliseconds for all samples: the median of the rounds.
    pub(crate) ms: f64,
}

/// A frame's error against the reference.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FrameErrors {
    pub(crate) image: Comparison,
    pub(crate) unresolved: f64,
    /// Share of pixels whose range differs from the reference by more than [`WRONG_SURFACE`].
    pub(crate) wrong_surface: f64,
}

/// The reference image and ranges of a view.
pub(crate) struct Truth {
    pub(crate) image: RgbImage,
    /// True ranges in metres, for frames with 1, 2, 3, … sub-pixels a side. A frame reports the range of one sub-pixel.
    ranges: Vec<(u32, Vec<f64>)>,
}

/// Batches until the compositor's autotuner has tried both programs of a search: four rounds of each, and one more.
const BATCHES_TO_DECIDE: usize = 9;

/// Relative range error above which a pixel counts as another surface.
pub(crate) const WRONG_SURFACE: f64 = 0.05;

impl Bench {
    /// Opens a scene and places a rig; holds no samples yet.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        spec: &str,
        rig: &RigSettings,
        sampler: SamplerSettings,
    ) -> Result<Self> {
        let scene = Arc::new(argus_scene::open(spec)?);
        Self::with_scene(gpu, scene, rig, sampler)
    }

    /// Uses a scene that is already open.
    pub(crate) fn with_scene(
        gpu: &Arc<Gpu>,
        scene: Arc<Scene>,
        rig: &RigSettings,
        sampler: SamplerSettings,
    ) -> Result<Self> {
        let info = Arc::new(SampleSetInfo {
            sub_samples: sampler.sub_samples,
            effects: sampler.effects,
            indirect: sampler.indirect,
            ..SampleSetInfo::of_scene(&scene, Rig::for_scene(&scene, rig)?)
        });
        let sampler = GpuSampler::with_methods(
            Arc::clone(gpu),
            Arc::clone(&scene),
            sampler,
            crate::methods::methods(),
        )?;
        let compositor = GpuCompositor::new(Arc::clone(gpu))?;
        let tracer = Tracer::new(Arc::clone(&scene));
        let sight = (!scene.is_animated()).then(|| SceneSight::new(&scene));
        Ok(Self { scene, info, sampler, compositor, tracer, truth_paths: None, sight })
    }

    /// From now on references have direct light by rays, and light between surfaces by `paths`.
    pub(crate) fn light_references(&mut self, light: DirectLight, paths: Option<Paths>) {
        self.tracer = Tracer::new(Arc::clone(&self.scene)).with_direct_light(light);
        self.truth_paths = paths;
    }

    /// Releases samples held by the compositor.
    pub(crate) fn release(&mut self, ids: &[SampleId]) {
        self.compositor.release(ids);
    }

    /// Releases all samples and places a new rig, as a new version.
    pub(crate) fn replace_rig(&mut self, rig: &RigSettings, held: &[SampleId]) -> Result<()> {
        self.release(held);
        let rig = Rig::for_scene(&self.scene, rig)?;
        self.info = Arc::new(SampleSetInfo { rig, version: self.next_version(), ..(*self.info).clone() });
        Ok(())
    }

    /// The next version, which shows the same as this one.
    pub(crate) fn next_version(&self) -> Version {
        Version { number: self.info.version.number + 1, ..self.info.version }
    }

    /// Sets the visibility backend of later samples and direct views.
    pub(crate) fn set_visibility(&mut self, visibility: Visibility) {
        self.info = Arc::new(SampleSetInfo { visibility, ..(*self.info).clone() });
    }

    /// Sets what later samples are rendered from, as a new version.
    pub(crate) fn set_sampling(&mut self, sampling: Sampling) -> Result<(), InvalidField> {
        sampling.validate(&self.info.rig)?;
        let version = self.next_version();
        self.info = Arc::new(SampleSetInfo { sampling, version, ..(*self.info).clone() });
        Ok(())
    }

    /// The scene's suggested cameras, or its default camera if it suggests none.
    pub(crate) fn suggested(&self) -> Vec<Camera> {
        match self.scene.cameras.as_slice() {
            [] => vec![self.scene.default_camera()],
            cameras => cameras.iter().map(|named| named.camera).collect(),
        }
    }

    /// The visibility test that selects sample cameras for a view; `None` if cameras are selected by distance alone.
    pub(crate) fn sight(&self) -> Option<&dyn VisibilityQuery> {
        self.sight.as_ref().map(|sight| sight as &dyn VisibilityQuery)
    }

    /// From now on selects sample cameras by distance alone.
    pub(crate) fn ignore_sight(&mut self) {
        self.sight = None;
    }

    /// Whether sample cameras are selected by visibility rather than by distance. True for a `Cell` rig: its lattice
    /// ignores walls, so the nearest camera may see nothing of the view.
    pub(crate) fn chooses_by_sight(&self) -> bool {
        self.sight.is_some() && matches!(self.info.rig, Rig::Cell { .. })
    }

    /// The `count` best samples for a viewpoint; fewer if the rig has fewer.
    pub(crate) fn sample_ids(&self, camera: &Camera, count: usize) -> Vec<SampleId> {
        let id = |index| SampleId { version: self.info.version.number, camera: index };
        let among = CandidateCameras { refined: &[], sight: self.sight() };
        self.info.rig.nearest_among(camera, count, among).into_iter().map(id).collect()
    }

    /// All samples that the viewpoints use, each once, sorted.
    pub(crate) fn all_ids(&self, cameras: &[Camera], count: usize) -> Vec<SampleId> {
        let mut ids: Vec<SampleId> =
            cameras.iter().flat_map(|camera| self.sample_ids(camera, count)).collect();
        ids.sort();
        ids.dedup();
        ids
    }

    /// Renders samples and gives them to the compositor, eight at a time. Rendering all at once would hold large samples
    /// in memory twice.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they exceed the compositor's budget; it then holds some of them.
    pub(crate) fn hold(&mut self, ids: &[SampleId]) -> Result<(), RenderError> {
        for ids in ids.chunks(8) {
            let job = SampleJob::new(Arc::clone(&self.info), ids.to_vec(), false);
            let samples = self.sampler.render_samples(&job, &Cancel::new()).into_iter();
            let samples = samples.map(|sample| Ok(Arc::new(sample?))).collect::<Result<_, RenderError>>()?;
            self.compositor.hold(&SampleSet { info: Arc::clone(&self.info), samples })?;
        }
        Ok(())
    }

    ///
    /// Renders samples `rounds` times after one warm-up, gives them to the compositor, and returns the cost.
    pub(crate) fn render_timed(&mut self, ids: Vec<SampleId>, rounds: usize) -> Result<SamplingCost> {
        let count = ids.len();
        let job = SampleJob::new(Arc::clone(&self.info), ids, false);
        let (mut times, mut samples) = (Vec::new(), Vec::new());
        // The first round also compiles the pipelines.
        for round in 0..=rounds {
            let begin = Instant::now();
            let rendered = self.sampler.render_samples(&job, &Cancel::new());
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            samples = rendered.into_iter().collect::<Result<Vec<_>, RenderError>>()?;
            if round > 0 || rounds == 0 {
                times.push(ms);
            }
        }
        let samples = samples.into_iter().map(Arc::new).collect();
        self.compositor.hold(&SampleSet { info: Arc::clone(&self.info), samples })?;
        Ok(SamplingCost { count, ms: median(&times) })
    }

    /// A view job with this bench's epoch, visibility and probes.
    pub(crate) fn job(&self, camera: Camera, size: [u32; 2], outputs: Outputs, plan: Plan) -> ViewJob {
        let SampleSetInfo { visibility, reflections, ref version, .. } = *self.info;
        let (state, time_secs) = (version.state, self.info.time_secs());
        ViewJob { outputs, state, time_secs, visibility, reflections, ..ViewJob::new(camera, size, plan) }
    }

    /// Renders a batch. Returns its milliseconds and its frames. Jobs are all direct or all warped.
    pub(crate) fn time(&mut self, jobs: &[ViewJob]) -> Result<(f64, Vec<Frame>), RenderError> {
        let cancel = Cancel::new();
        let direct = matches!(jobs.first().map(|job| &job.plan), Some(Plan::Direct { .. }));
        let begin = Instant::now();
        let frames = match direct {
            true => self.sampler.render_views(jobs, &cancel),
            false => self.compositor.compose(jobs, &cancel),
        };
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        Ok((ms, frames.into_iter().collect::<Result<_, RenderError>>()?))
    }

    /// Composes batches until the autotuner has chosen a program for the search. Returns `fragment` or `compute`, or
    /// `undecided` after [`BATCHES_TO_DECIDE`] batches. By then all pipelines are compiled.
    pub(crate) fn decide_program(&mut self, jobs: &[ViewJob]) -> Result<&'static str, RenderError> {
        let search = jobs.iter().find_map(|job| match &job.plan {
            Plan::Warp(warp) => Some(warp.search),
            Plan::Direct { .. } => None,
        });
        for _ in 0..BATCHES_TO_DECIDE {
            self.time(jobs)?;
            match search.and_then(|search| self.compositor.search_backend(search)) {
                Some(SearchBackend::Fragment) => return Ok("fragment"),
                Some(_) => return Ok("compute"),
                None => {}
            }
        }
        Ok("undecided")
    }

    /// The reference of a view: colour averaged over `samples` rays per pixel, and ranges for each number of sub-pixels a
    /// side in `sides`. Images are cached between runs.
    pub(crate) fn truth(&self, camera: &Camera, size: [u32; 2], samples: u32, sides: &[u32]) -> Truth {
        let exposure = self.scene.lighting.exposure;
        let (folder, paths) = (cache::directory(), self.truth_paths);
        let image = cache::render_with(folder.as_deref(), &self.tracer, camera, size, samples, paths, |_| ());
        let ranges = sides.iter().map(|&side| (side, self.ranges(camera, size, side))).collect();
        Truth { image: image.display(exposure), ranges }
    }

    /// True ranges in metres, row by row, through the sub-pixel whose range a frame with `side`² sub-pixels reports: the
    /// middle one, or the one below and right of the middle if `side` is even.
    fn ranges(&self, camera: &Camera, [width, height]: [u32; 2], side: u32) -> Vec<f64> {
        let middle = DVec2::splat((f64::from(side / 2) + 0.5) / f64::from(side));
        (0..width * height)
            .into_par_iter()
            .map(|i| {
                let at = DVec2::new(f64::from(i % width), f64::from(i / width)) + middle;
                let direction = camera.direction(at, width, height);
                self.tracer.trace(camera.eye, direction).map_or(f64::INFINITY, |hit| hit.range)
            })
            .collect()
    }

    /// Compares a frame's colour and range with the reference. `side`: the frame's sub-pixels a side; 1 for a direct
    /// view, which reports the range at the pixel's centre.
    pub(crate) fn judge(frame: &Frame, truth: &Truth, side: u32) -> Result<FrameErrors> {
        let range = frame.images[Output::Range].as_ref().context("the frame has no range")?;
        let (_, ranges) =
            truth.ranges.iter().find(|(s, _)| *s == side).context("no true ranges for these sub-pixels")?;
        let (values, _) = range.as_chunks::<4>();
        let wrong = values.iter().zip(ranges).filter(|(got, truth)| {
            let got = f64::from(f32::from_le_bytes(**got));
            // Equal infinities are the same sky; a NaN is always wrong.
            !(got == **truth || (got / **truth - 1.0).abs() <= WRONG_SURFACE)
        });
        Ok(FrameErrors {
            image: compare(frame, &truth.image)?,
            unresolved: frame.unresolved_fraction,
            wrong_surface: wrong.count() as f64 / ranges.len().max(1) as f64,
        })
    }

    /// A walk of `count` views that reveals hidden surfaces. It starts at the suggested cameras in turn, moves up to
    /// half way to their targets and swings sideways, never through a surface.
    pub(crate) fn walk(&self, count: usize) -> Vec<Camera> {
        let suggested = self.suggested();
        (0..count)
            .map(|i| {
                let camera = suggested[i % suggested.len()];
                let turns = count.div_ceil(suggested.len()).max(2) - 1;
                let done = (i / suggested.len()) as f64 / turns as f64;
                let forward = camera.target - camera.eye;
                let aside = forward.cross(camera.up).normalize_or_zero() * forward.length();
                let swing = (done * std::f64::consts::TAU * 1.25).sin() * 0.22;
                let step = forward * (0.5 * done) + aside * swing;
                Camera { eye: self.advance(camera.eye, step), ..camera }
            })
            .collect()
    }

    /// Moves from `from` by `step`, but at most three quarters of the way to a surface.
    pub(crate) fn advance(&self, from: DVec3, step: DVec3) -> DVec3 {
        let length = step.length();
        if !(length > 0.0) {
            return from;
        }
        let free = self.tracer.trace(from, step).map_or(f64::INFINITY, |hit| hit.range * 0.75);
        from + step / length * length.min(free)
    }
}

/// Mean device milliseconds of the frames' passes, without the compositor's work on the host. Frames of a batch share its
/// time evenly. NaN if there is no frame or the device has no timestamps.
pub(crate) fn device_ms(frames: &[Frame]) -> f64 {
    const ON_HOST: [&str; 3] = ["prepare views", "record passes", "unpack frames"];
    let passes = |frame: &Frame| {
        let passes = frame.stages.iter().filter(|stage| !ON_HOST.contains(&stage.name.as_str()));
        passes.map(|stage| stage.ms).reduce(|a, b| a + b).unwrap_or(f64::NAN)
    };
    mean(frames.iter().map(passes))
}

/// FLIP, PSNR and SSIM of a frame against the reference image.
pub(crate) fn compare(frame: &Frame, reference: &RgbImage) -> Result<Comparison> {
    Ok(metrics::compare(reference, &image_of(frame)?)?)
}

/// A frame's colour.
pub(crate) fn image_of(frame: &Frame) -> Result<RgbImage> {
    let pixels = frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
    RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")
}
