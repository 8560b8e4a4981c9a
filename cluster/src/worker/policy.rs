//! Decides what a worker does next, as pure functions of its queues, without threads, clock or channels.
//!
//! The render thread's queue and the simulated worker of `argus-lab study simulate` share this module, so the simulator
//! shows what the service does.
//!
//! # The order of work
//!
//! A worker has one render thread. It calls [`Policy::next`] whenever it is idle, and [`Policy::between`] between
//! slices of longer work. The answer is a [`Turn`]: a kind of work, and the size of its batch.
//!
//! 1. *Orders* of the coordinator, such as another scene. Later work depends on them.
//! 2. *Postponed* work, which was dequeued earlier and found no sampler.
//! 3. *Awaited samples*. Only explicit requests for samples and other workers' fetches wait for them.
//! 4. A *round*: pixels that no sample saw, because the rest of their view is finished; views from triangles; views
//!    from samples; one *slice* of background work. Each waiting kind gets one batch per round.
//! 5. *Prefetched samples*, one at a time, if nothing else waits.
//!
//! Background work uploads samples to the compositor before views need them, and renders sources. No view waits for it: it is done in
//! slices of at most [`SLICE_MS`], so a view that arrives waits for at most one slice. After a slice, waiting views
//! get three times as much time as the slice took. So background work gets at most a quarter of a busy worker's time, and still
//! finishes. If views had strict priority, an overloaded worker would never hold the samples that make its views
//! cheaper.
//!
//! Three kinds of longer work have slices: samples, whether awaited or prefetched; sources; and the first use of the
//! compositor's programs, which an order to measure causes. A source is given up for orders and awaited samples, and tried again. Between two slices, the thread does one round without
//! background work, and further rounds while views are owed time for the slice. It does none while an order for
//! another scene waits, because the views behind that order show the other scene.
//!
//! While a sampler is made in another thread, work that needs a sampler waits, and views from samples continue.
//!
//! # Where samples come from
//!
//! [`seek`] says where a worker looks for a sample that it does not hold: first at each named address, in order, then
//! by rendering. [`serve`] says how a worker answers another worker's request for a sample that it does not hold.

use std::collections::VecDeque;
use std::ops::Add;
use std::time::Duration;

use crate::core::Role;

/// Longest slice of background work, milliseconds. A view that arrives during a slice waits for its end. At 20 views
/// a second, this adds a fifth of a frame's time on average.
pub const SLICE_MS: f64 = 20.0;

/// Time that waiting views get for the time of a slice.
const OWED: u32 = 3;

/// How long a request waits for an announced fetch to begin. A worker is asked for samples that its own assignment
/// lists, and that assignment may arrive later than the request.
pub const ANNOUNCED: Duration = Duration::from_secs(1);

/// Pause before a failed prefetch is tried again.
pub const PAUSE: Duration = Duration::from_millis(500);

/// Kinds of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Orders of the coordinator.
    Order,
    /// Work that was dequeued and found no sampler.
    Postponed,
    /// Awaited samples.
    Sample,
    /// Pixels of views that no sample saw.
    Pixels,
    /// Views from triangles.
    Direct,
    /// Views from samples.
    Warped,
    /// A slice of background work.
    Background,
    /// Prefetched samples.
    Prefetch,
}

impl Kind {
    /// Views and parts of views, in the order of a round.
    const VIEWS: [Self; 3] = [Self::Pixels, Self::Direct, Self::Warped];
    /// The kinds of a round, in order.
    const ROUND: [Self; 4] = [Self::Pixels, Self::Direct, Self::Warped, Self::Background];

    /// Whether the kind is views or parts of views.
    pub fn is_views(self) -> bool {
        Self::VIEWS.contains(&self)
    }

    /// Whether it needs a sampler. Postponed work waits for nothing else.
    fn needs_sampler(self) -> bool {
        matches!(self, Self::Postponed | Self::Sample | Self::Pixels | Self::Direct | Self::Prefetch)
    }
}

/// Number of waiting results, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Waiting {
    /// [`Kind::Order`].
    pub orders: usize,
    /// An order replaces the scene.
    pub scene_changes: bool,
    /// [`Kind::Postponed`].
    pub postponed: usize,
    /// [`Kind::Sample`].
    pub samples: usize,
    /// [`Kind::Pixels`].
    pub pixels: usize,
    /// [`Kind::Direct`].
    pub direct: usize,
    /// [`Kind::Warped`].
    pub warped: usize,
    /// [`Kind::Background`], pieces of work with any number of slices each.
    pub background: usize,
    /// [`Kind::Prefetch`].
    pub prefetch: usize,
    /// A sampler is being made.
    pub makes_sampler: bool,
}

impl Waiting {
    fn of(&self, kind: Kind) -> usize {
        match kind {
            Kind::Order => self.orders,
            Kind::Postponed => self.postponed,
            Kind::Sample => self.samples,
            Kind::Pixels => self.pixels,
            Kind::Direct => self.direct,
            Kind::Warped => self.warped,
            Kind::Background => self.background,
            Kind::Prefetch => self.prefetch,
        }
    }

    fn has(&self, kind: Kind) -> bool {
        self.of(kind) > 0 && !(self.makes_sampler && kind.needs_sampler())
    }
}

impl Add for Waiting {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            orders: self.orders + other.orders,
            scene_changes: self.scene_changes || other.scene_changes,
            postponed: self.postponed + other.postponed,
            samples: self.samples + other.samples,
            pixels: self.pixels + other.pixels,
            direct: self.direct + other.direct,
            warped: self.warped + other.warped,
            background: self.background + other.background,
            prefetch: self.prefetch + other.prefetch,
            makes_sampler: self.makes_sampler || other.makes_sampler,
        }
    }
}

/// The next work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The kind.
    pub kind: Kind,
    /// Greatest number of items in the batch.
    pub most: usize,
}

/// Most items of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Views from samples. A batch shares its passes.
    pub warped: usize,
    /// Views from triangles, and pixels. Each is long, so large batches would delay other work.
    pub direct: usize,
}

impl Default for Limits {
    /// Above 64, a batch of warped views saves nothing and delays its first view.
    fn default() -> Self {
        Self { warped: 64, direct: 4 }
    }
}

/// The scheduler of a render thread.
#[derive(Debug, Clone, Default)]
pub struct Policy {
    limits: Limits,
    /// Kinds that had a turn in this round.
    done: Vec<Kind>,
    /// Time that views get before the next slice of background work.
    owed: Duration,
}

impl Policy {
    /// A scheduler with these limits. A limit of 0 counts as 1.
    pub fn new(limits: Limits) -> Self {
        let limits = Limits { warped: limits.warped.max(1), direct: limits.direct.max(1) };
        Self { limits, ..Self::default() }
    }

    /// The next work; `None` if none can be done.
    pub fn next(&mut self, waiting: &Waiting) -> Option<Turn> {
        let first = [Kind::Order, Kind::Postponed, Kind::Sample].into_iter().find(|kind| waiting.has(*kind));
        let views_wait = Kind::VIEWS.into_iter().any(|kind| waiting.has(kind));
        let kinds = if views_wait && !self.owed.is_zero() { &Kind::VIEWS[..] } else { &Kind::ROUND[..] };
        let turn = first.or_else(|| self.in_round(waiting, kinds));
        let turn = turn.or_else(|| Some(Kind::Prefetch).filter(|kind| waiting.has(*kind)));
        turn.map(|kind| self.turn(kind))
    }

    /// Records the time of a slice of background work. Waiting views are owed [`OWED`] times as much.
    pub fn had_slice(&mut self, took: Duration) {
        self.owed = took * OWED;
    }

    /// Records the time of a batch of views.
    pub fn had_views(&mut self, took: Duration) {
        self.owed = self.owed.saturating_sub(took);
    }

    /// Begins a pause between two slices of longer work.
    pub fn pause(&mut self) {
        self.done.clear();
    }

    /// The next work in a pause; `None` ends the pause. Each kind of view gets one batch, and further ones while
    /// views are owed time.
    pub fn between(&mut self, waiting: &Waiting) -> Option<Turn> {
        if waiting.scene_changes {
            return None;
        }
        let is_left = |done: &[Kind], kind: &Kind| waiting.has(*kind) && !done.contains(kind);
        let mut kind = Kind::VIEWS.into_iter().find(|kind| is_left(&self.done, kind));
        if kind.is_none() && !self.owed.is_zero() {
            self.done.clear();
            kind = Kind::VIEWS.into_iter().find(|kind| is_left(&self.done, kind));
        }
        let kind = kind?;
        self.done.push(kind);
        Some(self.turn(kind))
    }

    /// The next of these kinds in the round. The round ends when every waiting kind had a turn.
    fn in_round(&mut self, waiting: &Waiting, kinds: &[Kind]) -> Option<Kind> {
        let waits = |kind: &&Kind| waiting.has(**kind);
        let next = kinds.iter().filter(waits).find(|kind| !self.done.contains(kind));
        let kind = *next.or_else(|| {
            self.done.clear();
            kinds.iter().find(waits)
        })?;
        self.done.push(kind);
        Some(kind)
    }

    fn turn(&self, kind: Kind) -> Turn {
        let most = match kind {
            // Lists of pixels share their submissions, as views from samples do.
            Kind::Warped | Kind::Pixels => self.limits.warped,
            Kind::Direct => self.limits.direct,
            // One sample at a time where batching saves nothing: the first requester can continue while the next
            // sample is rendered. The set decides how many samples are efficient to render together.
            Kind::Sample => usize::MAX,
            Kind::Order | Kind::Postponed | Kind::Background | Kind::Prefetch => 1,
        };
        Turn { kind, most }
    }
}

/// Removes the first items of a queue, at most `most`, that can share a batch with the first item.
pub fn take_batch<T>(queue: &mut VecDeque<T>, most: usize, together: impl Fn(&T, &T) -> bool) -> VecDeque<T> {
    let Some(first) = queue.front() else { return VecDeque::new() };
    let count = queue.iter().skip(1).take_while(|next| together(first, next)).count() + 1;
    let rest = queue.split_off(count.min(most.max(1)));
    std::mem::replace(queue, rest)
}

/// The purpose of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A view of this worker.
    View {
        /// The view can do without the sample.
        dispensable: bool,
    },
    /// Later views.
    Prefetch {
        /// Other workers fetch the sample from this one, and wait for it.
        feeds_others: bool,
    },
}

/// The next step to get a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seek {
    /// Ask the address at this index.
    Ask(usize),
    /// Render it here.
    Render {
        /// No view waits for it.
        prefetch: bool,
    },
    /// Ask all addresses again, after [`PAUSE`].
    AskAgain,
    /// Give up.
    GiveUp,
}

/// The next step to get a sample, after `asked` of `addresses` were asked without success.
pub fn seek(need: Need, asked: usize, addresses: usize) -> Seek {
    match need {
        _ if asked < addresses => Seek::Ask(asked),
        Need::View { dispensable: false } => Seek::Render { prefetch: false },
        Need::View { dispensable: true } => Seek::GiveUp,
        Need::Prefetch { feeds_others } if feeds_others || addresses == 0 => Seek::Render { prefetch: true },
        Need::Prefetch { .. } => Seek::AskAgain,
    }
}

/// The answer to another worker's request for a sample that is not held here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Serve {
    /// Render it at once.
    Render,
    /// Wait for the sample, whose fetch should begin here within [`ANNOUNCED`].
    Await,
    /// Refuse.
    Refuse,
}

/// The answer to another worker's request. `samples`: this worker renders samples. `prefetch`: no view waits for the
/// sample. `awaited`: waiting for the sample failed.
pub fn serve(samples: bool, prefetch: bool, awaited: bool) -> Serve {
    match (samples, prefetch || !samples, awaited) {
        (_, true, false) => Serve::Await,
        (true, _, _) => Serve::Render,
        (false, _, _) => Serve::Refuse,
    }
}

/// Whether a worker has finished its old role's work, so that the new role can take effect. `left` is its queued work
/// and its work in progress.
pub fn may_change_role(before: Role, after: Role, left: &Waiting) -> bool {
    let samples_due = before.samples() && !after.samples() && left.direct + left.samples + left.pixels > 0;
    let views_due = before.composites() && !after.composites() && left.warped > 0;
    !(samples_due || views_due)
}

/// Number of threads that pack frames and samples, beside the render thread: all cores but one. A batch ends with all
/// of its frames at once, and more threads would delay the next batch.
pub fn threads_beside(cores: u32) -> usize {
    (cores as usize).saturating_sub(1).max(1)
}

#[cfg(test)]
mod tests;
