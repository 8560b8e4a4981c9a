//! What waits for the render thread, in one queue a kind of work. Which queue is next is in [`super::policy`].
//!
//! The queues are bounded: what does not fit is turned away at once. While a sampler is made, in a thread of its own, what
//! needs one waits, and views from samples go on.

use std::collections::VecDeque;
use std::ops::Add;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_scene::{
    FaceMask, Frame, PixelJob, Pixels, Plan, RenderError, Sample, SampleId, SampleSetInfo, Scene, ViewJob,
    Visibility,
};
use parking_lot::{Condvar, Mutex};
use tokio::sync::oneshot;

use super::claim::Claimed;
use super::config::Config;
use super::policy::{Kind, Limits, Policy, Turn, Waiting, take_batch};
use crate::core::Role;
use crate::core::quality::Cost;

/// A view for the render thread.
pub(super) struct ViewTask {
    pub(super) job: ViewJob,
    /// What the plan's samples were shaded with.
    pub(super) info: Arc<SampleSetInfo>,
    /// The plan's samples; none for a direct view.
    pub(super) samples: Vec<Arc<Sample>>,
    /// It was in a batch that took the device down: it gets one of its own.
    pub(super) alone: bool,
    pub(super) queued: Instant,
    pub(super) claimed: Claimed,
    pub(super) reply: oneshot::Sender<Result<Rendered, RenderError>>,
}

/// A frame and how long its view waited for the render thread.
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
    /// Another process needs it.
    pub(super) to_host: bool,
    /// It is ahead of demand: it may wait for everything else.
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

/// What each way to see triangles costs, ms.
pub(super) type BackendCosts = Vec<(Visibility, f64)>;

/// What the render thread does next.
pub(super) enum Work {
    /// This is the scene from now on, and a sample set of the specification that samplers are made for.
    Scene {
        scene: Arc<Scene>,
        set: Arc<SampleSetInfo>,
    },
    /// Have all that a role needs, so that the first result does not wait for it.
    Prepare {
        info: Arc<SampleSetInfo>,
        role: Role,
        reply: oneshot::Sender<Result<(), RenderError>>,
    },
    /// Measure what a view from samples costs and, if `backends` are wanted, what each way to see triangles does.
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
    /// Nothing came for a while.
    Nothing,
    Stop,
}

/// Background work, done in slices: no view waits for it.
pub(super) enum Background {
    /// Have the compositor hold a sample before a view asks for it. `reply` hears that it is done, or that it came to nothing.
    TakeUp { info: Arc<SampleSetInfo>, sample: Arc<Sample>, reply: Option<oneshot::Sender<()>> },
    /// Tell what was measured. It is queued behind samples that are to be taken up first.
    Measured {
        warp_cost: Option<Cost>,
        backend_costs: Result<BackendCosts, RenderError>,
        reply: oneshot::Sender<Result<BackendCosts, RenderError>>,
    },
}

impl Work {
    /// Whether a sampler does it.
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

    /// The awaited part of the work.
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
    /// Work that was taken before it turned out that there is no sampler yet.
    postponed: VecDeque<Work>,
    makes_sampler: bool,
    in_work: Waiting,
    /// When what is in work was taken.
    taken: Option<Instant>,
    /// Its kind.
    kind: Option<Kind>,
    /// The render thread makes what it needs for the work that it took.
    gets_ready: bool,
    policy: Policy,
    usual_visibility: Visibility,
    stopped: bool,
}

/// The queues, shared with the render thread.
pub(super) struct Queue {
    max_views: usize,
    max_samples: usize,
    state: Mutex<State>,
    filled: Condvar,
}

/// What does not fit comes back.
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

    /// Queues an order that is neither view nor sample; it is done before all of them.
    pub(super) fn order(&self, work: Work) {
        let mut state = self.state.lock();
        state.stopped |= matches!(work, Work::Stop);
        state.orders.push_back(work);
        self.filled.notify_one();
    }

    /// Queues background work.
    pub(super) fn push_background(&self, work: Background) {
        let mut state = self.state.lock();
        // After the end it is dropped, and its reply with it.
        if !state.stopped {
            state.background.push_back(work);
        }
        self.filled.notify_one();
    }

    /// Queues the rest of such work, of which a slice is done, before all other.
    pub(super) fn put_back(&self, work: Background) {
        let mut state = self.state.lock();
        if !state.stopped {
            state.background.push_front(work);
        }
    }

    pub(super) fn push_view(&self, task: ViewTask) -> Result<(), Full> {
        let mut state = self.state.lock();
        state.forget_the_gone();
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

    pub(super) fn push_pixels(&self, task: PixelTask) -> Result<(), Full> {
        let mut state = self.state.lock();
        state.forget_the_gone();
        if state.stopped || state.pixels.len() >= self.max_views {
            return Err(Full);
        }
        state.pixels.push_back(task);
        self.filled.notify_one();
        Ok(())
    }

    /// Waits for work, and no longer than that. What came before is done, whatever became of it.
    pub(super) fn next(&self, at_most: Duration) -> Work {
        let mut state = self.state.lock();
        state.account();
        state.in_work = Waiting::default();
        state.taken = None;
        state.gets_ready = false;
        loop {
            state.forget_the_gone();
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

    /// The sampler that was made is expected to see triangles best by that backend.
    pub(super) fn set_usual_visibility(&self, visibility: Visibility) {
        self.state.lock().usual_visibility = visibility;
    }

    /// The visibility backend that is expected to be best here, before any was measured.
    pub(super) fn usual_visibility(&self) -> Visibility {
        self.state.lock().usual_visibility
    }

    /// A sampler is in the making, until [`Self::sampler_is_made`].
    pub(super) fn sampler_is_coming(&self) {
        self.state.lock().makes_sampler = true;
    }

    /// It is there, or came to nothing.
    pub(super) fn sampler_is_made(&self) {
        self.state.lock().makes_sampler = false;
        self.filled.notify_one();
    }

    /// Has work wait for the sampler that is in the making; gives it back if there is none any more.
    pub(super) fn postpone(&self, work: Work) -> Option<Work> {
        let mut state = self.state.lock();
        if !state.makes_sampler {
            return Some(work);
        }
        state.postponed.push_back(work);
        None
    }

    /// Between two slices of longer work, of which the last took `slice`: answers what came meanwhile, by the rules of
    /// [`Policy::between`]. `composes`: views from samples can be answered, too.
    pub(super) fn give_way(&self, slice: Duration, composes: bool, mut answer: impl FnMut(Work)) {
        let kind = {
            let mut state = self.state.lock();
            // An awaited sample has every second turn.
            if state.in_work.samples == 0 || state.kind == Some(Kind::Prefetch) {
                state.policy.had_slice(slice);
            }
            state.policy.pause();
            state.kind
        };
        loop {
            let mut state = self.state.lock();
            (state.taken, state.kind) = (Some(Instant::now()), kind);
            state.forget_the_gone();
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

    /// How long the render thread has been at what it took last; zero while it waits.
    pub(super) fn busy_for(&self) -> Duration {
        self.state.lock().taken.map_or(Duration::ZERO, |taken| taken.elapsed())
    }

    /// How long it has been at samples, views or pixels for which it has all that it needs; zero while it is not.
    pub(super) fn at_piece_for(&self) -> Duration {
        let state = self.state.lock();
        let at_one = state.in_work != Waiting::default() && !state.gets_ready;
        state.taken.filter(|_| at_one).map_or(Duration::ZERO, |taken| taken.elapsed())
    }

    /// Does what has to be done before the work that was taken: making a role may take as long as it likes.
    pub(super) fn getting_ready<T>(&self, make: impl FnOnce() -> T) -> T {
        self.state.lock().gets_ready = true;
        let made = make();
        let mut state = self.state.lock();
        state.gets_ready = false;
        state.taken = state.taken.map(|_| Instant::now());
        made
    }

    /// What waits or is in work.
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
            sampler_is_coming: self.makes_sampler,
        }
    }

    /// Tells the policy how long the work that is over took.
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

    /// Takes the batch of a turn from its queue.
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

    /// Drops work whose callers no longer wait.
    fn forget_the_gone(&mut self) {
        self.samples.retain(|task| !task.claimed.is_gone());
        self.pixels.retain(|task| !task.claimed.is_gone());
        self.views.retain(|task| !task.claimed.is_gone());
        self.direct.retain(|task| !task.claimed.is_gone());
        self.prefetch.retain(|task| !task.claimed.is_gone());
    }
}

/// The oldest samples of one set, as many as it pays to render together.
fn take_samples(queue: &mut VecDeque<SampleTask>, most: usize) -> Vec<SampleTask> {
    let most = queue.front().map_or(0, |first| first.info.sampling.batch().min(most));
    let together = |a: &SampleTask, b: &SampleTask| a.to_host == b.to_host && Arc::ptr_eq(&a.info, &b.info);
    take_batch(queue, most, together).into()
}

/// Whether views are of one set, and neither must be alone.
fn may_share_a_batch(one: &ViewTask, other: &ViewTask) -> bool {
    !one.alone && !other.alone && Arc::ptr_eq(&one.info, &other.info)
}
