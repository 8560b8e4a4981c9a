//! The render thread: the only one that touches the two roles.
//!
//! It takes all views that wait as one batch, so a busy worker gets the gain of batching and an idle one the
//! latency of a single view. A panic in a role counts as a lost device: both roles are made anew, and whoever
//! waits asks once more.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use argus_scene::{
    Compositor, Frame, PixelJob, RenderError, Sample, SampleId, SampleJob, SampleSet, SampleSetInfo, Sampler,
    Scene,
};
use tracing::{debug, info, warn};

use super::claim::Batch;
use super::health::Health;
use super::meter::{Kind, Meter};
use super::queue::{PixelTask, Queue, Rendered, SampleTask, ViewTask, Work};
use super::store::Store;
use super::warm;
use crate::RoleFactory;
use crate::core::Role;
use crate::seldom::Seldom;

/// What the render thread owns.
pub(super) struct Renderer {
    factory: Arc<dyn RoleFactory>,
    queue: Arc<Queue>,
    store: Arc<Store>,
    meter: Arc<Meter>,
    scene: Option<Arc<Scene>>,
    /// What it was made ready for last.
    set: Option<Arc<SampleSetInfo>>,
    sampler: Option<Box<dyn Sampler>>,
    /// A sampler in the making, or made and not used yet.
    standby: Option<Standby>,
    /// Those whose scene or device is gone, until they have noticed.
    retired: Vec<Standby>,
    compositor: Option<Box<dyn Compositor>>,
    /// What the compositor holds; a sample that only this map knows of is released.
    held: HashMap<SampleId, Held>,
    /// Whether the compositor has worked.
    is_warm: bool,
    /// Counts batches of views.
    batches: u64,
    /// Counts devices that were given up.
    rebuilt: u64,
    health: Arc<Health>,
    rest: Rest,
    /// The role that it was made ready for last.
    role: Role,
    /// When the sampler was used last, when the compositor was, and when that was looked at.
    sampled: Instant,
    composed: Instant,
    tidied: Instant,
}

/// When a role's own things are given up that nobody uses: the other role would keep them for ever.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rest {
    pub(super) after: Duration,
    /// Not a sampler.
    pub(super) keeps_sampler: bool,
}

impl Rest {
    /// How often it is looked at.
    fn look(&self) -> Duration {
        self.after / 4
    }
}

/// A sample that the compositor holds.
struct Held {
    sample: Weak<Sample>,
    /// The last batch that it was for.
    used: u64,
}

/// A sampler in the making.
type Standby = JoinHandle<Result<Box<dyn Sampler>, RenderError>>;

/// While it lives, what needs a sampler waits for one.
struct Coming(Arc<Queue>);

impl Coming {
    fn to(queue: &Arc<Queue>) -> Self {
        queue.sampler_is_coming();
        Self(queue.clone())
    }
}

impl Drop for Coming {
    fn drop(&mut self) {
        self.0.sampler_is_made();
    }
}

/// Results of a call into a role, or the news that the role is of no use any more.
type Results<T> = Result<Vec<Result<T, RenderError>>, RenderError>;

impl Renderer {
    /// A renderer whose compositor is made, so that a machine that cannot render says so at once.
    pub(super) fn new(
        factory: Arc<dyn RoleFactory>,
        queue: Arc<Queue>,
        store: Arc<Store>,
        meter: Arc<Meter>,
        health: Arc<Health>,
        rest: Rest,
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
            is_warm: false,
            batches: 0,
            rebuilt: 0,
            health,
            rest,
            role: Role::Both,
            sampled: now,
            composed: now,
            tidied: now,
        };
        Ok((renderer, device))
    }

    /// Renders until it is told to stop.
    pub(super) fn run(mut self) {
        loop {
            let work = self.queue.next(self.rest.look());
            match self.or_later(work) {
                Work::Nothing => {}
                Work::Stop => {
                    // A process that exits while its driver works may crash on its way out.
                    self.retire_standby();
                    self.retired.drain(..).for_each(|standby| drop(standby.join()));
                    return;
                }
                Work::Scene(scene) => {
                    self.scene = Some(scene);
                    self.sampler = None;
                    self.retire_standby();
                }
                Work::Prepare { info, role, reply } => {
                    // Nobody waits for it once the assignment is overtaken.
                    let _ = reply.send(self.prepare(&info, role));
                }
                Work::WarmUp(info) => self.warm_up(&info),
                Work::StandBy(info) => self.stand_by(info),
                Work::Ways(info, reply) => {
                    let _ = reply.send(self.sampler().and_then(|sampler| sampler.ways(&info)));
                }
                Work::Samples(tasks) => self.samples(tasks),
                Work::Pixels(tasks) => self.pixels(tasks),
                Work::Views(tasks) => self.views(tasks),
                Work::Direct(tasks) => self.direct(tasks),
            }
            self.tidy();
        }
    }

    /// The work, if a sampler is there or none is needed. Else one is made beside what needs none, and the work waits for it:
    /// a hierarchy over a scene's triangles takes a second, in which views are composed of what is held.
    fn or_later(&mut self, work: Work) -> Work {
        if let Work::Prepare { info, .. } = &work {
            self.set = Some(info.clone());
        }
        if self.sampler.is_some() || !work.needs_sampler() {
            return work;
        }
        if let Some(set) = self.set.clone() {
            self.stand_by(set);
        }
        self.queue.postpone(work).unwrap_or(Work::Nothing)
    }

    /// Gives up what nobody has used for a while: a sampler, with the scene on its device, where samples are another's work,
    /// and samples where composing is. The compositor itself is small, and samplers with time to spare compose.
    fn tidy(&mut self) {
        if self.tidied.elapsed() < self.rest.look() {
            return;
        }
        self.tidied = Instant::now();
        let rests = |used: Instant| used.elapsed() >= self.rest.after;
        if self.sampler.is_some() && !(self.role.samples() || self.rest.keeps_sampler) && rests(self.sampled)
        {
            self.sampler = None;
            debug!("the sampler is given up: nobody has used it for a while");
        }
        let none = !self.role.composites() && rests(self.composed);
        let gone = |held: &Held| none || held.sample.strong_count() == 0;
        let gone: Vec<SampleId> =
            self.held.iter().filter(|(_, held)| gone(held)).map(|(id, _)| *id).collect();
        if let Some(compositor) = self.compositor.as_mut().filter(|_| !gone.is_empty()) {
            compositor.release(&gone);
            self.held.retain(|id, _| !gone.contains(id));
            debug!(released = gone.len(), held = self.held.len(), "samples released");
        }
        self.health.holds(self.held.len());
    }

    /// Makes what a role needs; a compositor has composed something, too. A sampler's samples are asked for ahead of
    /// demand.
    fn prepare(&mut self, info: &Arc<SampleSetInfo>, role: Role) -> Result<(), RenderError> {
        self.role = role;
        if role.samples() && self.sampler.is_none() {
            self.sampler()?;
        }
        if role.composites() {
            self.warm_up(info);
        }
        Ok(())
    }

    /// Composes something, if the compositor never has.
    fn warm_up(&mut self, info: &Arc<SampleSetInfo>) {
        if std::mem::replace(&mut self.is_warm, true) {
            return;
        }
        let began = Instant::now();
        let warmed = self.guarded(|own| {
            warm::compositor(own.compositor()?, info).map(|()| Vec::<Result<(), RenderError>>::new())
        });
        debug!(ms = ms_since(began), ok = warmed.is_ok(), "compositor warmed up");
    }

    /// Begins to make a sampler beside the work, unless there is one.
    fn stand_by(&mut self, info: Arc<SampleSetInfo>) {
        let (None, None, Some(scene)) = (&self.sampler, &self.standby, self.scene.clone()) else { return };
        let (factory, coming) = (self.factory.clone(), Coming::to(&self.queue));
        let make = move || {
            let _coming = coming;
            warmed_sampler(factory.as_ref(), scene, &info)
        };
        // Without a thread it is made when it is needed.
        self.standby = std::thread::Builder::new().name("standby".to_owned()).spawn(make).ok();
    }

    fn retire_standby(&mut self) {
        self.retired.retain(|standby| !standby.is_finished());
        self.retired.extend(self.standby.take());
    }

    fn sampler(&mut self) -> Result<&mut dyn Sampler, RenderError> {
        self.sampled = Instant::now();
        if self.sampler.is_none() {
            let scene = self.scene.clone().ok_or_else(|| RenderError::Internal("no scene yet".to_owned()))?;
            let (standby, factory) = (self.standby.take(), self.factory.as_ref());
            let sampler = self.queue.getting_ready(|| {
                match standby.and_then(|thread| thread.join().ok()).and_then(Result::ok) {
                    Some(sampler) => Ok(sampler),
                    None => made_sampler(factory, scene),
                }
            });
            self.sampler = Some(sampler.inspect_err(|error| self.health.failed(&error.to_string()))?);
        }
        match &mut self.sampler {
            Some(sampler) => Ok(sampler.as_mut()),
            None => Err(RenderError::Internal("no sampler".to_owned())),
        }
    }

    fn compositor(&mut self) -> Result<&mut dyn Compositor, RenderError> {
        if self.compositor.is_none() {
            let compositor = self.queue.getting_ready(|| self.factory.compositor());
            let failed = |error: &RenderError| self.health.failed(&error.to_string());
            self.compositor = Some(compositor.inspect_err(failed)?);
        }
        match &mut self.compositor {
            Some(compositor) => Ok(compositor.as_mut()),
            None => Err(RenderError::Internal("no compositor".to_owned())),
        }
    }

    /// Gives the device up; the next work makes both roles anew.
    fn rebuild(&mut self, reason: &str) {
        static LOST: Seldom = Seldom::new();
        if let Some(left_out) = LOST.now() {
            warn!(reason, left_out, "device lost, the roles are made anew");
        }
        self.rebuilt += 1;
        self.sampler = None;
        self.retire_standby();
        (self.compositor, self.is_warm) = (None, false);
        self.held.clear();
        self.store.forget_device_planes();
    }

    /// Calls into a role. A panic there takes the role down, not the process.
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
        // One job a set and a place for the planes; there is one of each nearly always.
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
        let job = SampleJob { info, ids: tasks.iter().map(|task| task.id).collect(), to_host };
        let mut began = Instant::now();
        let results = match tasks.iter().all(|task| task.ahead) {
            false => self.guarded(|own| Ok(own.sampler()?.render_samples(&job, &batch.cancel))),
            true => self.samples_ahead(&job, &batch, &mut began),
        };
        self.record(Kind::Sample, &results, began, began);
        deliver(tasks.into_iter().map(|task| task.reply), results);
    }

    /// Samples that nobody waits for: views are composed between their parts, which `began` is moved on by.
    fn samples_ahead(&mut self, job: &SampleJob, batch: &Batch, began: &mut Instant) -> Results<Sample> {
        let mut parts = 0;
        let results = self.guarded(|own| {
            own.sampler()?;
            let rebuilt = own.rebuilt;
            let none = || RenderError::Internal("no sampler".to_owned());
            let mut sampler = own.sampler.take().ok_or_else(none)?;
            let queue = own.queue.clone();
            let results = sampler.render_samples_ahead(job, &batch.cancel, &mut || {
                let gave_way = Instant::now();
                queue.give_way(|tasks| own.views(tasks));
                *began += gave_way.elapsed();
                parts += 1;
                // What is made for a device that was given up is of no use: it begins again with the next one.
                if own.rebuilt != rebuilt {
                    batch.cancel.cancel();
                }
            });
            if own.rebuilt != rebuilt {
                let reason = "it was lost while views were composed between two parts of a sample";
                return Err(RenderError::DeviceLost(reason.to_owned()));
            }
            own.sampler = Some(sampler);
            Ok(results)
        });
        if results.as_ref().is_ok_and(|results| results.iter().all(Result::is_ok)) {
            self.meter.add_parts(parts.max(1), began.elapsed());
        }
        results
    }

    fn pixels(&mut self, tasks: Vec<PixelTask>) {
        let batch = Arc::new(Batch::default());
        let tasks: Vec<PixelTask> = tasks.into_iter().filter(|task| task.claimed.join(&batch)).collect();
        if tasks.is_empty() {
            return;
        }
        let rays = |job: &PixelJob| job.pixels.len() * job.samples_per_pixel as usize;
        let jobs: Vec<PixelJob> = tasks.iter().map(|task| task.job.clone()).collect();
        let began = Instant::now();
        let results = self.guarded(|own| Ok(own.sampler()?.render_pixels(&jobs, &batch.cancel)));
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
        let (batch, tasks) = begin(tasks);
        if tasks.is_empty() {
            return;
        }
        let jobs: Vec<_> = tasks.iter().map(|task| task.job.clone()).collect();
        let began = Instant::now();
        let results = self.guarded(|own| Ok(own.sampler()?.render_views(&jobs, &batch.cancel)));
        self.record(Kind::Direct, &results, began, began);
        deliver_frames(tasks, results, began);
    }

    fn views(&mut self, tasks: Vec<ViewTask>) {
        let (batch, tasks) = begin(tasks);
        if tasks.is_empty() {
            return;
        }
        let began = Instant::now();
        (self.composed, self.batches) = (began, self.batches + 1);
        let tasks: Vec<ViewTask> = tasks.into_iter().filter_map(|task| self.holding(task)).collect();
        if tasks.is_empty() {
            return;
        }
        let jobs: Vec<_> = tasks.iter().map(|task| task.job.clone()).collect();
        let composing = Instant::now();
        let results = self.guarded(|own| Ok(own.compositor()?.compose(&jobs, &batch.cancel)));
        self.record(Kind::View, &results, composing, began);
        self.health.holds(self.held.len());
        deliver_frames(tasks, results, began);
    }

    /// The view, now that the compositor holds its samples; a view whose samples it refuses fails alone.
    fn holding(&mut self, task: ViewTask) -> Option<ViewTask> {
        match self.guarded(|own| own.hold(&task).map(|()| Vec::<Result<(), RenderError>>::new())) {
            Ok(_) => Some(task),
            Err(error) => {
                let _ = task.reply.send(Err(error));
                None
            }
        }
    }

    /// Makes the compositor hold what a view needs, and no longer what the store has forgotten.
    fn hold(&mut self, task: &ViewTask) -> Result<(), RenderError> {
        let gone: Vec<SampleId> =
            self.held.iter().filter(|(_, held)| held.sample.strong_count() == 0).map(|(id, _)| *id).collect();
        if !gone.is_empty() {
            self.compositor()?.release(&gone);
            self.held.retain(|id, _| !gone.contains(id));
        }
        let is_held = |sample: &Arc<Sample>| {
            let held = self.held.get(&sample.id);
            held.is_some_and(|held| std::ptr::eq(held.sample.as_ptr(), Arc::as_ptr(sample)))
        };
        let used = self.batches;
        let samples: Vec<Arc<Sample>> = task.samples.iter().filter(|s| !is_held(s)).cloned().collect();
        for sample in &task.samples {
            if let Some(held) = self.held.get_mut(&sample.id) {
                held.used = used;
            }
        }
        if samples.is_empty() {
            return Ok(());
        }
        let set = SampleSet { info: task.info.clone(), samples };
        while let Err(error) = self.compositor()?.hold(&set) {
            let full = matches!(error, RenderError::OutOfMemory(_));
            let Some(oldest) = self.least_recently_used().filter(|_| full) else { return Err(error) };
            self.compositor()?.release(&[oldest]);
            self.held.remove(&oldest);
        }
        self.held.extend(
            set.samples.iter().map(|sample| (sample.id, Held { sample: Arc::downgrade(sample), used })),
        );
        Ok(())
    }

    /// The sample that the compositor can do without for longest, none of this batch's.
    fn least_recently_used(&self) -> Option<SampleId> {
        let unused = self.held.iter().filter(|(_, held)| held.used < self.batches);
        unused.min_by_key(|(id, held)| (held.used, **id)).map(|(id, _)| *id)
    }

    fn record<T>(&self, kind: Kind, results: &Results<T>, rendering: Instant, began: Instant) {
        let done = results.as_ref().map_or(0, |results| results.iter().filter(|r| r.is_ok()).count());
        if done > 0 {
            self.meter.add(kind, done, rendering.elapsed(), began.elapsed());
        }
    }
}

fn made_sampler(factory: &dyn RoleFactory, scene: Arc<Scene>) -> Result<Box<dyn Sampler>, RenderError> {
    let began = Instant::now();
    let sampler = factory.sampler(scene)?;
    info!(ms = ms_since(began), "sampler made");
    Ok(sampler)
}

/// A sampler whose first sample is no slower than others.
fn warmed_sampler(
    factory: &dyn RoleFactory,
    scene: Arc<Scene>,
    info: &Arc<SampleSetInfo>,
) -> Result<Box<dyn Sampler>, RenderError> {
    let mut sampler = made_sampler(factory, scene)?;
    let began = Instant::now();
    // One that cannot work would be in the way of another.
    let warmed = warm::sampler(sampler.as_mut(), info);
    warmed.inspect_err(|error| warn!(%error, "the sampler that was made beside other work is of no use"))?;
    debug!(ms = ms_since(began), "sampler at hand");
    Ok(sampler)
}

fn ms_since(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}

/// The batch of the views that somebody still waits for.
fn begin(tasks: Vec<ViewTask>) -> (Arc<Batch>, Vec<ViewTask>) {
    let batch = Arc::new(Batch::default());
    let tasks = tasks.into_iter().filter(|task| task.claimed.join(&batch)).collect();
    (batch, tasks)
}

/// One result for each who waits. A role that returns too few has failed at the rest.
fn deliver<T>(
    replies: impl Iterator<Item = tokio::sync::oneshot::Sender<Result<T, RenderError>>>,
    results: Results<T>,
) {
    let (mut results, error) = match results {
        Ok(results) => (results.into_iter(), RenderError::Internal("a result is missing".to_owned())),
        Err(error) => (Vec::new().into_iter(), error),
    };
    for reply in replies {
        // Whoever gave up waiting meanwhile misses nothing.
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
