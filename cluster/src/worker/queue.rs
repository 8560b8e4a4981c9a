//! What waits for the render thread.
//!
//! Samples go first, since views of this and of other processes wait for them; then pixels that no sample saw,
//! since all else of their views is done; then batches of reconstructed and of direct views take turns, so that
//! neither starves the other; last, samples ahead of demand. The queues are bounded: what does not
//! fit is turned away at once. While a sampler is made, in a thread of its own, what needs one waits, and views go on.

use std::collections::VecDeque;
use std::ops::Add;
use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_scene::{
    Frame, PixelJob, Pixels, Plan, RenderError, Sample, SampleId, SampleSetInfo, Scene, ViewJob, Visibility,
};
use parking_lot::{Condvar, Mutex};
use tokio::sync::oneshot;

use super::claim::Claimed;
use crate::core::Role;

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
    pub(super) info: Arc<SampleSetInfo>,
    /// Another process needs it.
    pub(super) to_host: bool,
    /// Nobody waits for it yet: it may wait for everything else.
    pub(super) ahead: bool,
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
pub(super) type Ways = Vec<(Visibility, f64)>;

/// What the render thread does next.
pub(super) enum Work {
    /// This is the scene from now on.
    Scene(Arc<Scene>),
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
        reply: oneshot::Sender<Result<Ways, RenderError>>,
    },
    /// Have the compositor hold a sample before a view asks for it.
    TakeUp {
        info: Arc<SampleSetInfo>,
        sample: Arc<Sample>,
        reply: oneshot::Sender<()>,
    },
    Samples(Vec<SampleTask>),
    Pixels(Vec<PixelTask>),
    Views(Vec<ViewTask>),
    Direct(Vec<ViewTask>),
    /// Nothing came for a while.
    Nothing,
    Stop,
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
            Self::Scene(_) | Self::TakeUp { .. } | Self::Views(_) | Self::Nothing | Self::Stop => false,
        }
    }

    fn backlog(&self) -> Backlog {
        let none = Backlog::default();
        match self {
            Self::Samples(tasks) => Backlog { samples: tasks.len(), ..none },
            Self::Pixels(tasks) => Backlog { pixels: tasks.len(), ..none },
            Self::Views(tasks) => Backlog { views: tasks.len(), ..none },
            Self::Direct(tasks) => Backlog { direct: tasks.len(), ..none },
            _ => none,
        }
    }
}

/// How much waits or is in work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Backlog {
    pub(super) samples: usize,
    pub(super) views: usize,
    pub(super) direct: usize,
    pub(super) pixels: usize,
}

impl Add for Backlog {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            samples: self.samples + other.samples,
            views: self.views + other.views,
            direct: self.direct + other.direct,
            pixels: self.pixels + other.pixels,
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
    ahead: VecDeque<SampleTask>,
    /// Samples that the compositor shall hold before views ask for them.
    take_up: VecDeque<Work>,
    /// Work that was taken before it turned out that there is no sampler yet.
    postponed: VecDeque<Work>,
    makes_sampler: bool,
    in_work: Backlog,
    /// When what is in work was taken.
    taken: Option<Instant>,
    /// It is not that yet that the render thread is at: it makes what it needs for it.
    gets_ready: bool,
    direct_had_its_turn: bool,
    usual_visibility: Visibility,
    stopped: bool,
}

/// The queues, shared with the render thread.
pub(super) struct Queue {
    max_views: usize,
    max_samples: usize,
    max_batch: usize,
    max_direct_batch: usize,
    state: Mutex<State>,
    filled: Condvar,
}

/// What does not fit comes back.
pub(super) struct Full;

impl Queue {
    pub(super) fn new(config: &super::Config) -> Self {
        Self {
            max_views: config.max_queued_views,
            max_samples: config.max_queued_samples,
            max_batch: config.max_batch.max(1),
            max_direct_batch: config.max_direct_batch.max(1),
            state: Mutex::default(),
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

    /// Queues samples that the compositor shall hold.
    pub(super) fn order_last(&self, work: Work) {
        let mut state = self.state.lock();
        // Whoever waits for it hears that it came to nothing.
        if !state.stopped {
            state.take_up.push_back(work);
        }
        self.filled.notify_one();
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
        let queue = if task.ahead { &state.ahead } else { &state.samples };
        if state.stopped || queue.len() >= self.max_samples {
            return Err(Full);
        }
        match task.ahead {
            true => state.ahead.push_back(task),
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
        state.in_work = Backlog::default();
        state.taken = None;
        state.gets_ready = false;
        loop {
            state.forget_the_gone();
            if let Some(work) = state.take(self.max_batch, self.max_direct_batch) {
                state.in_work = work.backlog();
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

    /// Between two parts of a sample that nobody waits for: answers what came meanwhile, a batch of each kind, unless an
    /// order or a sample that somebody waits for came, which needs the sampler to itself.
    pub(super) fn give_way(&self, mut answer: impl FnMut(Work)) {
        for take in [State::take_pixels, State::take_direct, State::take_views] {
            let mut state = self.state.lock();
            state.taken = Some(Instant::now());
            state.forget_the_gone();
            if !(state.orders.is_empty() && state.samples.is_empty()) {
                return;
            }
            let Some(work) = take(&mut state, self.max_batch, self.max_direct_batch) else { continue };
            let before = std::mem::replace(&mut state.in_work, work.backlog());
            drop(state);
            answer(work);
            let mut state = self.state.lock();
            state.in_work = before;
            state.taken = Some(Instant::now());
        }
    }

    /// How long the render thread has been at what it took last; zero while it waits.
    pub(super) fn busy_for(&self) -> Duration {
        self.state.lock().taken.map_or(Duration::ZERO, |taken| taken.elapsed())
    }

    /// … at samples, views or pixels, for which it has all that it needs.
    pub(super) fn at_piece_for(&self) -> Duration {
        let state = self.state.lock();
        let at_one = state.in_work != Backlog::default() && !state.gets_ready;
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

    pub(super) fn backlog(&self) -> Backlog {
        let state = self.state.lock();
        let waits = Backlog {
            samples: state.samples.len(),
            views: state.views.len(),
            direct: state.direct.len(),
            pixels: state.pixels.len(),
        };
        state.postponed.iter().map(Work::backlog).fold(waits + state.in_work, Add::add)
    }
}

impl State {
    fn take_pixels(&mut self, _: usize, most: usize) -> Option<Work> {
        let count = self.pixels.len().min(most);
        (count > 0).then(|| Work::Pixels(self.pixels.drain(..count).collect()))
    }

    fn take_direct(&mut self, _: usize, most: usize) -> Option<Work> {
        (!self.direct.is_empty()).then(|| Work::Direct(take_batch(&mut self.direct, most)))
    }

    fn take_views(&mut self, most: usize, _: usize) -> Option<Work> {
        (!self.views.is_empty()).then(|| Work::Views(take_batch(&mut self.views, most)))
    }

    /// Views that nobody waits for any more make room for others.
    fn forget_the_gone(&mut self) {
        self.samples.retain(|task| !task.claimed.is_gone());
        self.pixels.retain(|task| !task.claimed.is_gone());
        self.views.retain(|task| !task.claimed.is_gone());
        self.direct.retain(|task| !task.claimed.is_gone());
        self.ahead.retain(|task| !task.claimed.is_gone());
    }

    fn take(&mut self, max_batch: usize, max_direct_batch: usize) -> Option<Work> {
        if let Some(work) = self.orders.pop_front() {
            return Some(work);
        }
        // What views will be composed of is soon taken up, and makes them faster.
        if let Some(work) = self.take_up.pop_front() {
            return Some(work);
        }
        let samples_now = !self.makes_sampler;
        if samples_now {
            if let Some(work) = self.postponed.pop_front() {
                return Some(work);
            }
            // One at a time where that costs no more: a compositor that waits for the first of many begins while the
            // next is rendered.
            if !self.samples.is_empty() {
                return Some(Work::Samples(take_samples(&mut self.samples, usize::MAX)));
            }
            if !self.pixels.is_empty() {
                let count = self.pixels.len().min(max_direct_batch);
                return Some(Work::Pixels(self.pixels.drain(..count).collect()));
            }
            let direct_turn = self.views.is_empty() || !self.direct_had_its_turn;
            if direct_turn && !self.direct.is_empty() {
                self.direct_had_its_turn = true;
                return Some(Work::Direct(take_batch(&mut self.direct, max_direct_batch)));
            }
        }
        self.direct_had_its_turn = false;
        if !self.views.is_empty() {
            return Some(Work::Views(take_batch(&mut self.views, max_batch)));
        }
        // As few at a time: whoever comes next waits for no more than those.
        let ahead = samples_now && !self.ahead.is_empty();
        ahead.then(|| Work::Samples(take_samples(&mut self.ahead, 1)))
    }
}

/// The oldest samples of one set, as many as it pays to render together.
fn take_samples(queue: &mut VecDeque<SampleTask>, most: usize) -> Vec<SampleTask> {
    let mut batch: Vec<SampleTask> = queue.pop_front().into_iter().collect();
    let most = batch.first().map_or(0, |first| first.info.sampling.batch().min(most));
    while batch.len() < most {
        let fits = |next: &SampleTask| {
            let first = &batch[0];
            next.to_host == first.to_host && Arc::ptr_eq(&next.info, &first.info)
        };
        if !queue.front().is_some_and(fits) {
            break;
        }
        batch.extend(queue.pop_front());
    }
    batch
}

/// The oldest tasks, up to `most`, of one set; one that must be alone is.
fn take_batch(queue: &mut VecDeque<ViewTask>, most: usize) -> Vec<ViewTask> {
    let mut batch: Vec<ViewTask> = Vec::new();
    while batch.len() < most {
        let Some(next) = queue.front() else { break };
        let fits = batch
            .first()
            .is_none_or(|first| !first.alone && !next.alone && Arc::ptr_eq(&first.info, &next.info));
        if !fits {
            break;
        }
        batch.extend(queue.pop_front());
    }
    batch
}
