//! The render thread, which alone calls the two roles.
//!
//! It takes waiting views in batches: a busy worker gains by batching, and an idle worker has the latency of a single
//! view. A panic in a role counts as a lost device: both roles are recreated, and callers retry once.

mod frame_cost;
mod holding;
mod light;
mod measuring;
mod roles;
mod sliced;

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use argus_scene::{
    Compositor, Detail, FaceMask, Frame, LightLevel, Outputs, PixelJob, Plan, RenderError, Sample, SampleId,
    SampleJob, SampleSetInfo, Sampler, Scene,
};
use tracing::debug;

use super::claim::Batch;
use super::health::Health;
use super::meter::{Kind, Meter};
use super::queue::{PixelTask, Queue, Rendered, SampleTask, ViewTask, Work};
use super::slices::Slices;
use super::store::Store;
use super::view_costs::ViewKind;
use crate::RoleFactory;
use crate::core::Role;

/// The state of the render thread.
pub(super) struct Renderer {
    factory: Arc<dyn RoleFactory>,
    queue: Arc<Queue>,
    store: Arc<Store>,
    meter: Arc<Meter>,
    scene: Option<Arc<Scene>>,
    /// The set of the last order.
    set: Option<Arc<SampleSetInfo>>,
    sampler: Option<Box<dyn Sampler>>,
    /// A sampler that is being made, or was made and is not used yet.
    standby: Option<Standby>,
    /// Standby threads that are no longer needed but have not ended.
    retired: Vec<Standby>,
    compositor: Option<Box<dyn Compositor>>,
    /// Samples that the compositor holds. A sample that only this map refers to is released.
    held: HashMap<SampleId, Held>,
    /// Samples that arrived before the compositor was used. They are uploaded once it is.
    unheld: Vec<(Arc<SampleSetInfo>, Weak<Sample>)>,
    /// Whether the compositor was used, so that samples are uploaded to it in advance.
    is_warm: bool,
    /// Whether the cost of views from samples was measured, or measuring was abandoned.
    is_measured: bool,
    /// The cost of views from triangles is being measured, or will be as soon as no view waits.
    measures_direct: bool,
    /// What effects cost will be measured, once nothing more important is to be done.
    measures_effects: bool,
    /// The best light that the sampler has ready.
    light: LightLevel,
    /// Whether better light is being prepared.
    light_rises: bool,
    /// Light cells are being filled.
    fills_light: bool,
    /// Number of batches of views.
    batches: u64,
    /// Number of lost devices.
    rebuilt: u64,
    health: Arc<Health>,
    /// Time after which an unused compositor releases its samples.
    rest_after: Duration,
    /// The role of the last order.
    role: Role,
    /// When the compositor was last used, and when [`Self::tidy`] last ran.
    composed: Instant,
    tidied: Instant,
}

/// Interval at which the preparation of light is looked at.
const LIGHT_INTERVAL: Duration = Duration::from_millis(100);
/// A sample that the compositor holds.
struct Held {
    sample: Weak<Sample>,
    /// Number of the last batch that used it.
    used: u64,
}

/// The amount of an upload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Amount {
    All,
    Slice,
}

/// A thread that makes a sampler and compiles its programs.
type Standby = JoinHandle<Result<Box<dyn Sampler>, RenderError>>;

/// Results of a call to a role. The outer error means that the call as a whole failed.
type Results<T> = Result<Vec<Result<T, RenderError>>, RenderError>;

impl Renderer {
    /// A renderer with a compositor, and its device. Fails at once on a machine that cannot render.
    ///
    /// # Errors
    /// The error of making the compositor.
    pub(super) fn new(
        factory: Arc<dyn RoleFactory>,
        queue: Arc<Queue>,
        store: Arc<Store>,
        meter: Arc<Meter>,
        health: Arc<Health>,
        rest_after: Duration,
    ) -> Result<(Self, String), RenderError> {
        let compositor = factory.compositor()?;
        let device = compositor.device().to_owned();
        let now = Instant::now();
        let renderer = Self {
            factory,
            queue,
            store,
            meter,
            scene: None,
            set: None,
            sampler: None,
            standby: None,
            retired: Vec::new(),
            compositor: Some(compositor),
            held: HashMap::new(),
            unheld: Vec::new(),
            is_warm: false,
            is_measured: false,
            measures_direct: false,
            measures_effects: false,
            light: LightLevel::Direct,
            light_rises: false,
            fills_light: false,
            batches: 0,
            rebuilt: 0,
            health,
            rest_after,
            role: Role::Both,
            composed: now,
            tidied: now,
        };
        Ok((renderer, device))
    }

    /// Renders until a stop is ordered.
    pub(super) fn run(mut self) {
        loop {
            let pause = if self.light_rises { LIGHT_INTERVAL } else { self.rest_after / 4 };
            let work = self.queue.next(pause);
            match self.or_postpone(work) {
                Work::Nothing => {}
                Work::Stop => {
                    // A process may crash if it exits while the driver works.
                    self.retire_standby();
                    self.retired.drain(..).for_each(|standby| drop(standby.join()));
                    return;
                }
                Work::Scene { scene, set } => {
                    if self.scene.as_ref().is_some_and(|before| before.hash != scene.hash) {
                        self.meter.forget_costs();
                        self.is_measured = false;
                    }
                    (self.scene, self.set) = (Some(scene), Some(set));
                    self.sampler = None;
                    self.retire_standby();
                }
                Work::Prepare { role, reply, .. } => {
                    // The receiver is gone if a newer assignment arrived.
                    let _ = reply.send(self.prepare(role));
                }
                Work::Measure { info, backends, reply } => self.measure(&info, backends, reply),
                Work::Background(work) => self.background(work),
                Work::Samples(tasks) => self.samples(tasks),
                Work::Pixels(tasks) => self.pixels(tasks),
                Work::Views(tasks) => self.views(tasks),
                Work::Direct(tasks) => self.direct(tasks),
            }
            self.prepare_light();
            self.seek_cells();
            self.seek_effects();
            self.tidy();
        }
    }

    /// Calls a role. A panic there counts as a lost device, and the process continues.
    fn guarded<T>(&mut self, call: impl FnOnce(&mut Self) -> Results<T>) -> Results<T> {
        let results = match catch_unwind(AssertUnwindSafe(|| call(self))) {
            Ok(results) => results,
            Err(panic) => {
                let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
                let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
                Err(RenderError::DeviceLost(format!("a role panicked: {text}")))
            }
        };
        let lost = match &results {
            Err(RenderError::DeviceLost(reason)) => Some(reason.clone()),
            Err(_) => None,
            Ok(results) => results.iter().find_map(|result| match result {
                Err(RenderError::DeviceLost(reason)) => Some(reason.clone()),
                _ => None,
            }),
        };
        if let Some(reason) = lost {
            self.health.failed(&reason);
            self.rebuild(&reason);
        } else if results.as_ref().is_ok_and(|results| results.iter().any(Result::is_ok)) {
            self.health.works();
        }
        results
    }

    fn samples(&mut self, tasks: Vec<SampleTask>) {
        // One job for each set and location of planes. Almost always there is one.
        let mut rest = tasks;
        while let Some(first) = rest.first() {
            let (info, to_host) = (first.info.clone(), first.to_host);
            let (group, others): (Vec<SampleTask>, Vec<SampleTask>) =
                rest.into_iter().partition(|task| task.to_host == to_host && Arc::ptr_eq(&task.info, &info));
            rest = others;
            self.sample_group(info, to_host, group);
        }
    }

    fn sample_group(&mut self, info: Arc<SampleSetInfo>, to_host: bool, tasks: Vec<SampleTask>) {
        let batch = Arc::new(Batch::default());
        let tasks: Vec<SampleTask> = tasks.into_iter().filter(|task| task.claimed.join(&batch)).collect();
        if tasks.is_empty() {
            return;
        }
        let ids = tasks.iter().map(|task| task.id).collect();
        let faces = tasks.iter().map(|task| (task.id.camera, task.faces)).collect();
        let lacks = |task: &SampleTask, held: &Sample| !held.faces.contains(task.faces);
        let held = tasks.iter().filter_map(|task| self.store.get(task.id).filter(|held| lacks(task, held)));
        let mut job = SampleJob { faces, extended: held.collect(), ..SampleJob::new(info, ids, to_host) };
        let mut began = Instant::now();
        self.take_over_unchanged(&mut job, &batch);
        let results = self.samples_in_slices(&job, &batch, &mut began);
        self.record_samples(&job, &results, began);
        deliver(tasks.into_iter().map(|task| task.reply), results);
    }

    /// Begins samples with the faces of an earlier version that nothing has changed since.
    fn take_over_unchanged(&mut self, job: &mut SampleJob, batch: &Batch) {
        for id in job.ids.clone() {
            let earlier = self.store.latest_before(id).filter(|_| job.extended(id).is_none());
            let Some((earlier, shows)) = earlier else { continue };
            let unchanged = self.guarded(|own| {
                let faces = own.sampler()?.unchanged_faces(job, (&earlier, shows), &batch.cancel);
                Ok(vec![faces])
            });
            // Whatever failed will fail again, where callers are told.
            let faces = unchanged.ok().and_then(|mut faces| faces.pop()?.ok()).unwrap_or(FaceMask::NONE);
            if !faces.is_empty() {
                debug!(%id, faces = faces.bits(), "faces of an earlier version are kept");
                job.extended.push(Arc::new(Sample { id, faces, stages: Vec::new(), ..(*earlier).clone() }));
            }
        }
    }

    /// Renders samples in slices, and answers views between slices. `began` advances by the time of those views.
    fn samples_in_slices(&mut self, job: &SampleJob, batch: &Batch, began: &mut Instant) -> Results<Sample> {
        let mut slices = Slices::default();
        let results = self.guarded(|own| {
            own.sampler()?;
            let rebuilt = own.rebuilt;
            let none = || RenderError::Internal("no sampler".to_owned());
            let mut sampler = own.sampler.take().ok_or_else(none)?;
            let queue = own.queue.clone();
            let results = sampler.render_samples_in_slices(job, &batch.cancel, &mut |sampler, done| {
                slices.end();
                own.meter.set_sample_progress(Some(done));
                let gave_way = Instant::now();
                queue.give_way(slices.last(), true, |work| match work {
                    Work::Pixels(tasks) => own.pixels_by(Some(sampler), tasks),
                    Work::Direct(tasks) => own.direct_by(Some(sampler), tasks),
                    Work::Views(tasks) => own.views(tasks),
                    _ => {}
                });
                *began += gave_way.elapsed();
                slices.begin();
                // Results of a lost device are useless: the caller retries on the next one.
                if own.rebuilt != rebuilt {
                    batch.cancel.cancel();
                }
            });
            if own.rebuilt != rebuilt {
                let reason = "the device was lost while views were composed between two slices of a sample";
                return Err(RenderError::DeviceLost(reason.to_owned()));
            }
            own.sampler = Some(sampler);
            Ok(results)
        });
        self.meter.set_sample_progress(None);
        if results.as_ref().is_ok_and(|results| results.iter().all(Result::is_ok)) {
            self.meter.add_parts(slices.count().max(1), began.elapsed());
            debug!(%slices, "samples rendered");
        }
        results
    }

    fn pixels(&mut self, tasks: Vec<PixelTask>) {
        self.pixels_by(None, tasks);
    }

    /// Traces pixels with this sampler, or else the thread's own.
    fn pixels_by(&mut self, sampler: Option<&mut dyn Sampler>, tasks: Vec<PixelTask>) {
        let batch = Arc::new(Batch::default());
        let tasks: Vec<PixelTask> = tasks.into_iter().filter(|task| task.claimed.join(&batch)).collect();
        if tasks.is_empty() {
            return;
        }
        let rays = |job: &PixelJob| job.pixels.len() * job.samples_per_pixel as usize;
        let jobs: Vec<PixelJob> = tasks.iter().map(|task| task.job.clone()).collect();
        let began = Instant::now();
        let results = self.guarded(|own| {
            Ok(match sampler {
                Some(sampler) => sampler.render_pixels(&jobs, &batch.cancel),
                None => own.sampler()?.render_pixels(&jobs, &batch.cancel),
            })
        });
        if let Ok(results) = &results {
            let done = results.iter().zip(&jobs).filter(|(result, _)| result.is_ok());
            let (rays, took) = (done.map(|(_, job)| rays(job)).sum(), began.elapsed());
            if rays > 0 {
                self.meter.add(Kind::Ray, rays, took, took);
            }
        }
        deliver(tasks.into_iter().map(|task| task.reply), results);
    }

    fn direct(&mut self, tasks: Vec<ViewTask>) {
        self.direct_by(None, tasks);
    }

    /// Renders views from triangles with this sampler, or else the thread's own.
    fn direct_by(&mut self, sampler: Option<&mut dyn Sampler>, tasks: Vec<ViewTask>) {
        let (batch, tasks) = begin(tasks);
        if tasks.is_empty() {
            return;
        }
        let jobs: Vec<_> = tasks.iter().map(|task| task.job.clone()).collect();
        let began = Instant::now();
        let results = self.guarded(|own| {
            Ok(match sampler {
                Some(sampler) => sampler.render_views(&jobs, &batch.cancel),
                None => own.sampler()?.render_views(&jobs, &batch.cancel),
            })
        });
        // What the triangles alone decide costs less than a view.
        if jobs.iter().all(|job| job.outputs.has_any(Outputs::SHADED)) {
            self.record(Kind::Direct, &results, began, began);
            self.observe(&results);
        }
        deliver_frames(tasks, results, began);
    }

    fn views(&mut self, tasks: Vec<ViewTask>) {
        let (batch, tasks) = begin(tasks);
        if tasks.is_empty() {
            return;
        }
        let began = Instant::now();
        (self.composed, self.batches) = (began, self.batches + 1);
        self.upload_waiting();
        let tasks: Vec<ViewTask> = tasks.into_iter().filter_map(|task| self.holding(task)).collect();
        if tasks.is_empty() {
            return;
        }
        let jobs: Vec<_> = tasks.iter().map(|task| task.job.clone()).collect();
        let composing = Instant::now();
        let results = self.guarded(|own| Ok(own.compositor()?.compose(&jobs, &batch.cancel)));
        self.record(Kind::View, &results, composing, began);
        self.observe(&results);
        self.health.holds(self.held.len());
        deliver_frames(tasks, results, began);
    }

    /// Uploads the view's samples, and returns the view. If the compositor refuses them, only this view fails.
    fn holding(&mut self, task: ViewTask) -> Option<ViewTask> {
        match self.guarded(|own| {
            own.hold(&task.info, &task.samples, Amount::All).map(|_| Vec::<Result<(), RenderError>>::new())
        }) {
            Ok(_) => Some(task),
            Err(error) => {
                let _ = task.reply.send(Err(error));
                None
            }
        }
    }

    /// Records the time of each view.
    fn observe(&self, results: &Results<Frame>) {
        for frame in results.iter().flatten().flatten() {
            let (plan, pixels) = (&frame.provenance.plan, sub_pixels(frame));
            self.meter.observe_view(ViewKind::of(plan), pixels, frame.rendering_ms());
            if matches!(plan, Plan::Direct { detail: Detail::Full, .. }) {
                self.meter.effects(|effects| effects.observe(pixels, &frame.stages));
            }
        }
    }

    /// Records the cost of samples. It is that of whole samples: all faces cost the same.
    fn record_samples(&self, job: &SampleJob, results: &Results<Sample>, began: Instant) {
        let Ok(results) = results else { return };
        let rendered = |sample: &Sample| {
            let before = job.extended(sample.id).map_or(FaceMask::NONE, |sample| sample.faces);
            sample.faces.without(before).share()
        };
        let done = results.iter().flatten().count();
        let whole: f64 = results.iter().flatten().map(rendered).sum();
        if whole > 0.0 {
            let took = began.elapsed();
            self.meter.add(Kind::Sample, done, took.mul_f64(done as f64 / whole), took);
        }
    }

    fn record<T>(&self, kind: Kind, results: &Results<T>, rendering: Instant, began: Instant) {
        let done = results.as_ref().map_or(0, |results| results.iter().filter(|r| r.is_ok()).count());
        if done > 0 {
            self.meter.add(kind, done, rendering.elapsed(), began.elapsed());
        }
    }
}

/// Pixels of a frame that were rendered, with sub-pixels.
fn sub_pixels(frame: &Frame) -> u64 {
    frame.provenance.plan.sub_pixels(u64::from(frame.width) * u64::from(frame.height))
}

fn ms_since(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}

/// Begins a batch of the views whose callers still wait.
fn begin(tasks: Vec<ViewTask>) -> (Arc<Batch>, Vec<ViewTask>) {
    let batch = Arc::new(Batch::default());
    let tasks = tasks.into_iter().filter(|task| task.claimed.join(&batch)).collect();
    (batch, tasks)
}

/// Sends each caller its result. If the role returned too few results, the last callers get an error.
fn deliver<T>(
    replies: impl Iterator<Item = tokio::sync::oneshot::Sender<Result<T, RenderError>>>,
    results: Results<T>,
) {
    let (mut results, error) = match results {
        Ok(results) => (results.into_iter(), RenderError::Internal("a result is missing".to_owned())),
        Err(error) => (Vec::new().into_iter(), error),
    };
    for reply in replies {
        // The caller may have given up.
        let _ = reply.send(results.next().unwrap_or_else(|| Err(error.clone())));
    }
}

fn deliver_frames(tasks: Vec<ViewTask>, results: Results<Frame>, began: Instant) {
    let waited: Vec<f64> = tasks.iter().map(|task| (began - task.queued).as_secs_f64() * 1e3).collect();
    let results = results.map(|frames| {
        let rendered = |(frame, queue_ms): (Result<Frame, RenderError>, f64)| {
            frame.map(|frame| Rendered { frame, queue_ms })
        };
        frames.into_iter().zip(waited).map(rendered).collect()
    });
    deliver(tasks.into_iter().map(|task| task.reply), results);
}
