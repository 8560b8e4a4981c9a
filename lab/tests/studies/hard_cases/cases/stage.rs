//! The setup of a case: a scene, its samples in two compositors (one for each program), and its oracle.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_compositor::{CompositorSettings, GpuCompositor, SearchBackend};
use argus_gpu::Gpu;
use argus_sampler::{GpuSampler, SamplerSettings};
use argus_scene::reference::Tracer;
use argus_scene::sample::{Sample, SampleId, SampleSet, SampleSetInfo};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, Output, Outputs, Plan, RenderError, SampleJob, Sampler as _,
    Search, Version, ViewJob, Warp,
};

use super::oracle::{Judged, Truth};
use super::world::World;
use super::{Outcome, Row};

/// The device and the compositors that all cases share. Compiling a program takes longer than most cases.
pub(in super::super) struct Stages {
    gpu: Arc<Gpu>,
    compositors: [GpuCompositor; 2],
    version: u64,
}

/// A scene whose samples are held.
pub(super) struct Stage {
    pub(super) info: Arc<SampleSetInfo>,
    pub(super) tracer: Tracer,
    pub(super) samples: Vec<Arc<Sample>>,
}

/// A view and its error limits.
#[derive(Clone)]
pub(super) struct Pose {
    pub(super) name: &'static str,
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    /// Samples from which the view is composed.
    pub(super) samples: usize,
    pub(super) limits: Limits,
}

/// Largest accepted errors of a view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Share of wrong pixels.
    pub(super) wrong: f64,
    /// Share of unresolved pixels.
    pub(super) unresolved: f64,
    /// Whether a right surface with a wrong colour is wrong. False where no sample saw a surface's lit side.
    pub(super) colors: bool,
    /// Why the limits are wide; empty if they are not.
    pub(super) why: &'static str,
    /// Searches with their own limits.
    pub(super) exceptions: &'static [Exception],
}

/// A search's own limits for a case that its method cannot solve.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exception {
    pub(super) search: Search,
    pub(super) wrong: f64,
    pub(super) unresolved: f64,
    pub(super) why: &'static str,
}

impl Limits {
    pub(super) const fn new(wrong: f64, unresolved: f64) -> Self {
        Self { wrong, unresolved, colors: true, why: "", exceptions: &[] }
    }

    pub(super) const fn ranges(wrong: f64, unresolved: f64) -> Self {
        Self { colors: false, ..Self::new(wrong, unresolved) }
    }

    pub(super) const fn but(self, exceptions: &'static [Exception]) -> Self {
        Self { exceptions, ..self }
    }

    pub(super) const fn because(self, why: &'static str) -> Self {
        Self { why, ..self }
    }

    /// The limits on wrong and unresolved pixels for a search, and the reason.
    pub(super) fn of(&self, search: Search) -> (f64, f64, &'static str) {
        let exception = self.exceptions.iter().find(|exception| exception.search == search);
        exception.map_or((self.wrong, self.unresolved, self.why), |e| (e.wrong, e.unresolved, e.why))
    }
}

const SIZE: [u32; 2] = [64, 48];
/// Default number of samples of a plan.
const SAMPLES: usize = 4;

impl Pose {
    pub(super) fn new(name: &'static str, camera: Camera, limits: Limits) -> Self {
        Self { name, camera, size: SIZE, samples: SAMPLES, limits }
    }

    pub(super) fn sized(self, size: [u32; 2]) -> Self {
        Self { size, ..self }
    }

    pub(super) fn of_samples(self, samples: usize) -> Self {
        Self { samples, ..self }
    }
}

/// A composed view.
pub(super) struct Answer {
    pub(super) frame: Frame,
    pub(super) twin_bytes: usize,
    pub(super) ms: f64,
}

impl Stages {
    /// Creates the compositors on a device.
    ///
    /// # Errors
    /// The device lacks a feature that the passes need.
    pub(in super::super) fn new(gpu: &Arc<Gpu>) -> Result<Self> {
        let compositor = |search_backend| {
            GpuCompositor::with_settings(
                Arc::clone(gpu),
                CompositorSettings { search_backend, ..CompositorSettings::default() },
            )
        };
        let compositors = [compositor(SearchBackend::Fragment)?, compositor(SearchBackend::Compute)?];
        Ok(Self { gpu: Arc::clone(gpu), compositors, version: 0 })
    }

    pub(super) fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Renders the samples that the poses need, and gives them to both compositors.
    pub(super) fn prepare(&mut self, world: World, poses: &[Pose]) -> Result<Stage> {
        let (scene, rig) = world.shared();
        self.version += 1;
        let info = Arc::new(SampleSetInfo {
            version: Version::of_epoch(self.version, 0),
            sub_samples: 1,
            ..SampleSetInfo::of_scene(&scene, rig)
        });
        let mut ids: Vec<SampleId> =
            poses.iter().flat_map(|pose| nearest(&info, &pose.camera, pose.samples)).collect();
        ids.sort();
        ids.dedup();
        // One sub-sample per texel, so that the sample sees exactly what the oracle sees.
        let settings = SamplerSettings { sub_samples: 1, ..SamplerSettings::default() };
        let mut sampler = GpuSampler::with_settings(Arc::clone(&self.gpu), Arc::clone(&scene), settings)?;
        let job = SampleJob::new(Arc::clone(&info), ids, true);
        let samples = sampler.render_samples(&job, &Cancel::new()).into_iter();
        let samples: Vec<Arc<Sample>> =
            samples.map(|s| s.map(Arc::new)).collect::<Result<_, RenderError>>()?;
        let set = SampleSet { info: Arc::clone(&info), samples: samples.clone() };
        for compositor in &mut self.compositors {
            compositor.hold(&set)?;
        }
        Ok(Stage { info, tracer: Tracer::new(scene), samples })
    }

    /// Releases a stage's samples.
    pub(super) fn release(&mut self, stage: &Stage) {
        let ids: Vec<SampleId> = stage.samples.iter().map(|sample| sample.id).collect();
        self.compositors.iter_mut().for_each(|compositor| compositor.release(&ids));
    }

    /// Composes a view with both programs.
    pub(super) fn compose(&mut self, stage: &Stage, pose: &Pose, search: Search) -> Result<Answer> {
        let job = stage.job(pose, search);
        let mut answer = |index: usize| {
            compose_one(&mut self.compositors[index], &job)
                .with_context(|| format!("{}, {}", pose.name, search.name()))
        };
        let ((frame, a), (other, b)) = (answer(0)?, answer(1)?);
        Ok(Answer { twin_bytes: differing(&frame, &other), frame, ms: a.max(b) })
    }

    /// Composes every pose with every search and compares the frames with the oracle.
    pub(super) fn run(&mut self, world: World, poses: &[Pose]) -> Result<Vec<Row>> {
        let stage = self.prepare(world, poses)?;
        let mut rows = Vec::new();
        for pose in poses {
            let truth = Truth::of(&stage.tracer, &pose.camera, pose.size);
            for search in Search::ALL {
                let answer = self.compose(&stage, pose, search)?;
                let judged = truth.judge(&answer.frame, pose.samples, pose.limits.colors);
                if let Some(folder) = std::env::var_os("ARGUS_TEST_IMAGES") {
                    let file = format!("{}-{}.png", pose.name.replace(['/', ' '], "-"), search.name());
                    let picture = truth.picture(&answer.frame, pose.limits.colors);
                    picture.save(std::path::Path::new(&folder).join(file))?;
                }
                rows.push(answer.row(pose, search, judged));
            }
        }
        self.release(&stage);
        Ok(rows)
    }
}

impl Stage {
    pub(super) fn job(&self, pose: &Pose, search: Search) -> ViewJob {
        let samples = nearest(&self.info, &pose.camera, pose.samples);
        let plan = Plan::Warp(Warp { search, samples, ..Warp::default() });
        let outputs =
            [Output::Range, Output::Mask, Output::Source].into_iter().fold(Outputs::COLOR, Outputs::with);
        ViewJob { outputs, ..ViewJob::new(pose.camera, pose.size, plan) }
    }
}

impl Answer {
    /// The row of an answer, with its share of wrong pixels.
    pub(super) fn row(&self, pose: &Pose, search: Search, judged: Judged) -> Row {
        let (tolerance, unresolved_tolerance, why) = pose.limits.of(search);
        Row {
            theme: None,
            case: pose.name.to_owned(),
            search: search.name(),
            measure: "wrong pixels",
            oracle_error: judged.wrong,
            tolerance,
            unresolved: judged.unresolved,
            unresolved_tolerance,
            why,
            malformed: judged.malformed,
            twin_bytes: self.twin_bytes,
            ms: self.ms,
            outcome: Outcome::default(),
        }
        .judged()
    }
}

fn nearest(info: &SampleSetInfo, camera: &Camera, count: usize) -> Vec<SampleId> {
    let id = |index| SampleId { version: info.version.number, camera: index };
    info.rig.nearest(camera, count).into_iter().map(id).collect()
}

/// Composes a view. Returns the frame and the milliseconds it took.
pub(super) fn compose_one(
    compositor: &mut GpuCompositor,
    job: &ViewJob,
) -> Result<(Frame, f64), RenderError> {
    let begin = Instant::now();
    let mut frames = compositor.compose(std::slice::from_ref(job), &Cancel::new());
    let missing = || RenderError::Internal("a view was not answered".to_owned());
    let frame = frames.pop().ok_or_else(missing)??;
    Ok((frame, begin.elapsed().as_secs_f64() * 1e3))
}

/// The number of differing bytes of two frames. An image that one of them lacks counts with all its bytes.
pub(super) fn differing(a: &Frame, b: &Frame) -> usize {
    let bytes = |frame: &Frame, output| frame.images[output].clone().unwrap_or_default();
    let differ = |output| {
        let (a, b) = (bytes(a, output), bytes(b, output));
        a.len().abs_diff(b.len()) + a.iter().zip(b.iter()).filter(|(a, b)| a != b).count()
    };
    Output::ALL.into_iter().map(differ).sum()
}
