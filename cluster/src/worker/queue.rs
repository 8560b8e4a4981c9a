//! Queues of the render thread, one for each kind of work. [`super::policy`] decides which queue is next.
//!
//! The queues are bounded: work that does not fit is refused at once. While a sampler is made, in its own thread,
//! work that needs a sampler waits, and views from samples continue.

use std::collections::VecDeque;
use std::ops::Add;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_scene::{
    FaceMask, Frame, LightLevel, PixelJob, Pixels, Plan, RenderError, Sample, SampleId, SampleSetInfo, Scene,
    ViewJob, Visibility,
};
use parking_lot::{Condvar, Mutex};
use tokio::sync::oneshot;

use super::claim::Claimed;
use super::config::Config;
use super::policy::{Kind, Limits, Policy, Turn, Waiting, take_batch};
use super::warm::EffectTrial;
use crate::core::Role;
use crate::core::quality::Cost;

/// A view for the render thread.
pub(super) struct ViewTask {
    pub(super) job: ViewJob,
    /// The sample set that the plan's samples belong to.
    pub(super) info: Arc<SampleSetInfo>,
    /// The plan's samples; empty for a direct view.
    pub(super) samples: Vec<Arc<Sample>>,
    /// Its last batch lost the device, so it gets a batch of its own.
    pub(super) alone: bool,
    pub(super) queued: Instant,
    pub(super) claimed: Claimed,
    pub(super) reply: oneshot::Sender<Result<Rendered, RenderError>>,
}

/// A frame, and how long its view was queued.
pub(super) struct Rendered {
    pub(super) frame: Frame,
    pub(super) queue_ms: f64,
}

/// A sample for the render thread.
pub(super) struct SampleTask {
    pub(super) id: SampleId,
    /// The faces that are needed.
    pub(super) faces: FaceMask,
    pub(super) info: Arc<SampleSetInfo>,
    /// Another worker needs it in host memory.
    pub(super) to_host: bool,
    /// No view waits for it, so all other work precedes it.
    pub(super) prefetch: bool,
    pub(super) claimed: Claimed,
    pub(super) reply: oneshot::Sender<Result<Sample, RenderError>>,
}

/// Pixels that no sample saw, for the render thread.
pub(super) struct PixelTask {
    pub(super) job: PixelJob,
    pub(super) claimed: Claimed,
    pub(super) reply: oneshot::Sender<Result<Pixels, RenderError>>,
}

/// A direct view that no client waits for, rendered in slices.
pub(super) struct SlicedTask {
    pub(super) job: ViewJob,
    pub(super) claimed: Claimed,
    pub(super) reply: oneshot::Sender<Result<Frame, RenderError>>,
}

/// Milliseconds of each visibility backend for a tile of a sample.
pub(super) type BackendCosts = Vec<(Visibility, f64)>;

/// Work of the render thread.
pub(super) enum Work {
    /// Replace the scene. `set` has the specification that the sampler is made for.
    Scene {
        scene: Arc<Scene>,
        set: Arc<SampleSetInfo>,
    },
    /// Make everything that a role needs, so that the first result does not wait for it.
    Prepare {
        info: Arc<SampleSetInfo>,
        role: Role,
        reply: oneshot::Sender<Result<(), RenderError>>,
    },
    /// Measure the cost of views from samples. If `backends` is set, also measure the visibility backends.
    Measure {
        info: Arc<SampleSetInfo>,
        backends: bool,
        reply: oneshot::Sender<Result<BackendCosts, RenderError>>,
    },
    /// A slice of background work.
    Background(Background),
    Samples(Vec<SampleTask>),
    Pixels(Vec<PixelTask>),
    Views(Vec<ViewTask>),
    Direct(Vec<ViewTask>),
    /// No work arrived for a while.
    Nothing,
    Stop,
}

/// Background work. It is done in slices, and no view waits for it.
pub(super) enum Background {
    /// Measure the cost of views from triangles.
    MeasureDirect,
    /// Render a small view to measure what effects of light cost. For people: no decision needs it.
    MeasureEffects(EffectTrial),
    /// Fill light cells that views lacked.
    FillLight,
    /// Render a direct view for later views.
    Sliced(SlicedTask),
    /// Upload a sample to the compositor before views need it. `reply` is sent when this is done or abandoned.
    Hold { info: Arc<SampleSetInfo>, sample: Arc<Sample>, reply: Option<oneshot::Sender<()>> },
    /// Report a measurement. It is queued behind samples that must be uploaded first.
    Measured {
        warp_cost: Option<Cost>,
        backend_costs: Result<BackendCosts, RenderError>,
        reply: oneshot::Sender<Result<BackendCosts, RenderError>>,
    },
}

impl Work {
    /// Whether it needs a sampler.
    pub(super) fn needs_sampler(&self) -> bool {
        match self {
            Self::Prepare { .. }
            | Self::Measure { .. }
            | Self::Samples(_)
            | Self::Pixels(_)
            | Self::Direct(_) => true,
            Self::Scene { .. } | Self::Background(_) | Self::Views(_) | Self::Nothing | Self::Stop => false,
        }
    }

    /// The number of awaited results, by kind.
    fn in_work(&self) -> Waiting {
        let none = Waiting::default();
        match self {
            Self::Samples(tasks) => Waiting { samples: tasks.len(), ..none },
            Self::Pixels(tasks) => Waiting { pixels: tasks.len(), ..none },
            Self::Views(tasks) => Waiting { warped: tasks.len(), ..none },
            Self::Direct(tasks) => Waiting { direct: tasks.len(), ..none },
            _ => none,
        }
    }
}

#[derive(Default)]
struct State {
    orders: VecDeque<Work>,
    samples: VecDeque<SampleTask>,
    pixels: VecDeque<PixelTask>,
    views: VecDeque<ViewTask>,
    direct: VecDeque<ViewTask>,
    prefetch: VecDeque<SampleTask>,
    background: VecDeque<Background>,
    /// Work that was dequeued and found no sampler.
    postponed: VecDeque<Work>,
    /// A sampler is being made.
    makes_sampler: bool,
    /// Awaited results of the present work.
    in_work: Waiting,
    /// When the present work was dequeued.
    taken: Option<Instant>,
    /// Kind of the present work.
    kind: Option<Kind>,
    /// The render thread is making a role that the present work needs.
    makes_role: bool,
    policy: Policy,
    usual_visibility: Visibility,
    /// The best light that the sampler has ready.
    light: LightLevel,
    stopped: bool,
}

/// The queues, shared with the render thread.
pub(super) struct Queue {
    max_views: usize,
    max_samples: usize,
    state: Mutex<State>,
    filled: Condvar,
}

/// The error of a full queue.
pub(super) struct Full;

impl Queue {
    pub(super) fn new(config: &Config) -> Self {
        let limits = Limits { warped: config.max_batch, direct: config.max_direct_batch };
        Self {
            max_views: config.max_queued_views,
            max_samples: config.max_queued_samples,
            state: Mutex::new(State { policy: Policy::new(limits), ..State::default() }),
            filled: Condvar::new(),
        }
    }

    /// Queues an order. Orders precede all other work.
    pub(super) fn order(&self, work: Work) {
        let mut state = self.state.lock();
        state.stopped |= matches!(work, Work::Stop);
        state.orders.push_back(work);
        self.filled.notify_one();
    }

    /// Queues background work.
    pub(super) fn push_background(&self, work: Background) {
        let mut state = self.state.lock();
        // After a stop it is dropped, and its reply with it.
        if !state.stopped {
            state.background.push_back(work);
        }
        self.filled.notify_one();
    }

    /// Whether nothing waits but background work.
    pub(super) fn is_idle(&self) -> bool {
        let waiting = self.state.lock().waiting();
        Waiting { background: 0, ..waiting } == Waiting::default()
    }

    /// Whether work waits that does not go between slices: orders, and awaited samples.
    pub(super) fn has_urgent_work(&self) -> bool {
        let state = self.state.lock();
        !(state.orders.is_empty() && state.samples.is_empty())
    }

    /// Queues the rest of background work, a slice of which is done, before other background work.
    pub(super) fn put_back(&self, work: Background) {
        let mut state = self.state.lock();
        if !state.stopped {
            state.background.push_front(work);
        }
    }

    /// Queues a view.
    pub(super) fn push_view(&self, task: ViewTask) -> Result<(), Full> {
        let mut state = self.state.lock();
        state.drop_abandoned();
        if state.stopped || state.views.len() + state.direct.len() >= self.max_views {
            return Err(Full);
        }
        match task.job.plan {
            Plan::Direct { .. } => state.direct.push_back(task),
            Plan::Warp(_) => state.views.push_back(task),
        }
        self.filled.notify_one();
        Ok(())
    }

    /// Queues a sample.
    pub(super) fn push_sample(&self, task: SampleTask) -> Result<(), Full> {
        let mut state = self.state.lock();
        let queue = if task.prefetch { &state.prefetch } else { &state.samples };
        if state.stopped || queue.len() >= self.max_samples {
            return Err(Full);
        }
        match task.prefetch {
            true => state.prefetch.push_back(task),
            false => state.samples.push_back(task),
        }
        self.filled.notify_one();
        Ok(())
    }

    /// Queues pixels.
    pub(super) fn push_pixels(&self, task: PixelTask) -> Result<(), Full> {
        let mut state = self.state.lock();
        state.drop_abandoned();
        if state.stopped || state.pixels.len() >= self.max_views {
            return Err(Full);
        }
        state.pixels.push_back(task);
        self.filled.notify_one();
        Ok(())
    }

    /// Waits for work, at most this long. The previous work is over.
    pub(super) fn next(&self, at_most: Duration) -> Work {
        let mut state = self.state.lock();
        state.account();
        state.in_work = Waiting::default();
        state.taken = None;
        state.makes_role = false;
        loop {
            state.drop_abandoned();
            if let Some(work) = state.take() {
                state.in_work = work.in_work();
                state.taken = Some(Instant::now());
                return work;
            }
            if self.filled.wait_for(&mut state, at_most).timed_out() {
                return Work::Nothing;
            }
        }
    }

    /// Sets the visibility backend that the sampler expects to be fastest.
    pub(super) fn set_usual_visibility(&self, visibility: Visibility) {
        self.state.lock().usual_visibility = visibility;
    }

    /// The visibility backend that is expected to be fastest here, before any measurement.
    pub(super) fn usual_visibility(&self) -> Visibility {
        self.state.lock().usual_visibility
    }

    /// Sets the best light that the sampler has ready.
    pub(super) fn set_light(&self, light: LightLevel) {
        self.state.lock().light = light;
    }

    /// The best light that the sampler has ready.
    pub(super) fn light(&self) -> LightLevel {
        self.state.lock().light
    }

    /// Marks a sampler as being made, until [`Self::end_sampler`].
    pub(super) fn begin_sampler(&self) {
        self.state.lock().makes_sampler = true;
    }

    /// The sampler is made, or making it failed.
    pub(super) fn end_sampler(&self) {
        self.state.lock().makes_sampler = false;
        self.filled.notify_one();
    }

    /// Queues work until the sampler is made. Returns the work if no sampler is being made.
    pub(super) fn postpone(&self, work: Work) -> Option<Work> {
        let mut state = self.state.lock();
        if !state.makes_sampler {
            return Some(work);
        }
        state.postponed.push_back(work);
        None
    }

    /// Between two slices of longer work: passes queued views to `answer`, by the rules of [`Policy::between`].
    /// `slice` is the time of the last slice. `composes` includes views from samples.
    pub(super) fn give_way(&self, slice: Duration, composes: bool, mut answer: impl FnMut(Work)) {
        let kind = {
            let mut state = self.state.lock();
            // An awaited sample alternates with views, so they are owed no further time.
            if state.in_work.samples == 0 || state.kind == Some(Kind::Prefetch) {
                state.policy.had_slice(slice);
            }
            state.policy.pause();
            state.kind
        };
        loop {
            let mut state = self.state.lock();
            (state.taken, state.kind) = (Some(Instant::now()), kind);
            state.drop_abandoned();
            let Some(work) = state.take_between(composes) else { return };
            let before = std::mem::replace(&mut state.in_work, work.in_work());
            drop(state);
            answer(work);
            let mut state = self.state.lock();
            state.account();
            state.in_work = before;
            state.taken = Some(Instant::now());
        }
    }

    /// How long the render thread has been at its present work; zero while it waits.
    pub(super) fn busy_for(&self) -> Duration {
        self.state.lock().taken.map_or(Duration::ZERO, |taken| taken.elapsed())
    }

    /// How long the render thread has been at its present samples, views or pixels, without the time of making roles;
    /// zero for other work.
    pub(super) fn at_piece_for(&self) -> Duration {
        let state = self.state.lock();
        let at_one = state.in_work != Waiting::default() && !state.makes_role;
        state.taken.filter(|_| at_one).map_or(Duration::ZERO, |taken| taken.elapsed())
    }

    /// Makes a role that the present work needs. This time does not count in [`Self::at_piece_for`].
    pub(super) fn making_role<T>(&self, make: impl FnOnce() -> T) -> T {
        self.state.lock().makes_role = true;
        let made = make();
        let mut state = self.state.lock();
        state.makes_role = false;
        state.taken = state.taken.map(|_| Instant::now());
        made
    }

    /// Work that is queued or in progress.
    pub(super) fn backlog(&self) -> Waiting {
        let state = self.state.lock();
        state.postponed.iter().map(Work::in_work).fold(state.waiting() + state.in_work, Add::add)
    }
}

impl State {
    fn waiting(&self) -> Waiting {
        Waiting {
            orders: self.orders.len(),
            scene_changes: self.orders.iter().any(|order| matches!(order, Work::Scene { .. } | Work::Stop)),
            postponed: self.postponed.len(),
            samples: self.samples.len(),
            pixels: self.pixels.len(),
            direct: self.direct.len(),
            warped: self.views.len(),
            background: self.background.len(),
            prefetch: self.prefetch.len(),
            makes_sampler: self.makes_sampler,
        }
    }

    /// Reports the duration of the finished work to the policy.
    fn account(&mut self) {
        let (Some(taken), Some(kind)) = (self.taken, self.kind.take()) else { return };
        match kind {
            Kind::Background => self.policy.had_slice(taken.elapsed()),
            kind if kind.is_views() => self.policy.had_views(taken.elapsed()),
            _ => {}
        }
    }

    fn take(&mut self) -> Option<Work> {
        let turn = self.policy.next(&self.waiting())?;
        self.work_of(turn)
    }

    fn take_between(&mut self, composes: bool) -> Option<Work> {
        let mut waiting = self.waiting();
        waiting.warped = if composes { waiting.warped } else { 0 };
        let turn = self.policy.between(&waiting)?;
        self.work_of(turn)
    }

    /// Dequeues the batch of a turn.
    fn work_of(&mut self, Turn { kind, most }: Turn) -> Option<Work> {
        self.kind = Some(kind);
        Some(match kind {
            Kind::Order => self.orders.pop_front()?,
            Kind::Postponed => self.postponed.pop_front()?,
            Kind::Background => Work::Background(self.background.pop_front()?),
            Kind::Sample => Work::Samples(take_samples(&mut self.samples, most)),
            Kind::Prefetch => Work::Samples(take_samples(&mut self.prefetch, most)),
            Kind::Pixels => Work::Pixels(take_batch(&mut self.pixels, most, |_, _| true).into()),
            Kind::Direct => Work::Direct(take_batch(&mut self.direct, most, may_share_a_batch).into()),
            Kind::Warped => Work::Views(take_batch(&mut self.views, most, may_share_a_batch).into()),
        })
    }

    /// Drops work whose callers gave up.
    fn drop_abandoned(&mut self) {
        self.samples.retain(|task| !task.claimed.is_gone());
        self.pixels.retain(|task| !task.claimed.is_gone());
        self.views.retain(|task| !task.claimed.is_gone());
        self.direct.retain(|task| !task.claimed.is_gone());
        self.prefetch.retain(|task| !task.claimed.is_gone());
    }
}

/// Dequeues the oldest samples of one set: as many as are efficient to render together.
fn take_samples(queue: &mut VecDeque<SampleTask>, most: usize) -> Vec<SampleTask> {
    let most = queue.front().map_or(0, |first| first.info.sampling.batch().min(most));
    let together = |a: &SampleTask, b: &SampleTask| a.to_host == b.to_host && Arc::ptr_eq(&a.info, &b.info);
    take_batch(queue, most, together).into()
}

/// Whether two views may share a batch: they have the same set, and neither needs its own batch.
fn may_share_a_batch(one: &ViewTask, other: &ViewTask) -> bool {
    !one.alone && !other.alone && Arc::ptr_eq(&one.info, &other.info)
}
