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
//! Background work uploads samples to the compositor before views need them. No view waits for it: it is done in
//! slices of at most [`SLICE_MS`], so a view that arrives waits for at most one slice. After a slice, waiting views
//! get three times as much time as the slice took. So background work gets at most a quarter of a busy worker's time, and still
//! finishes. If views had strict priority, an overloaded worker would never hold the samples that make its views
//! cheaper.
//!
//! Two kinds of longer work have slices: samples, whether awaited or prefetched, and the first use of the
//! compositor's programs, which an order to measure causes. Between two slices, the thread does one round without
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
            Kind::Warped => self.limits.warped,
            Kind::Direct | Kind::Pixels => self.limits.direct,
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
mod tests {
    use super::*;

    /// The kinds of all turns until nothing waits. Each turn removes one item.
    fn all(mut waiting: Waiting) -> Vec<Kind> {
        let mut policy = Policy::default();
        let mut kinds = Vec::new();
        while let Some(turn) = policy.next(&waiting) {
            let count = match turn.kind {
                Kind::Order => &mut waiting.orders,
                Kind::Postponed => &mut waiting.postponed,
                Kind::Sample => &mut waiting.samples,
                Kind::Pixels => &mut waiting.pixels,
                Kind::Direct => &mut waiting.direct,
                Kind::Warped => &mut waiting.warped,
                Kind::Background => &mut waiting.background,
                Kind::Prefetch => &mut waiting.prefetch,
            };
            *count -= 1;
            kinds.push(turn.kind);
        }
        kinds
    }

    #[test]
    fn orders_precede_all_work_and_prefetched_samples_follow_it() {
        let waiting = Waiting {
            orders: 1,
            postponed: 1,
            samples: 1,
            pixels: 1,
            direct: 1,
            warped: 1,
            background: 1,
            prefetch: 1,
            ..Waiting::default()
        };
        let order = [
            Kind::Order,
            Kind::Postponed,
            Kind::Sample,
            Kind::Pixels,
            Kind::Direct,
            Kind::Warped,
            Kind::Background,
            Kind::Prefetch,
        ];
        assert_eq!(all(waiting), order);
        assert_eq!(all(Waiting::default()), []);
    }

    #[test]
    fn no_kind_of_view_starves_another_and_views_do_not_starve_background_work() {
        use Kind::{Background, Direct, Warped};
        let waiting = Waiting { direct: 3, warped: 2, background: 2, ..Waiting::default() };
        assert_eq!(all(waiting), [Direct, Warped, Background, Direct, Warped, Background, Direct]);
    }

    #[test]
    fn a_view_waits_for_one_slice_of_background_work_at_most() {
        let mut policy = Policy::default();
        let background = Waiting { background: 9, prefetch: 1, ..Waiting::default() };
        assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
        assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
        for kind in [Kind::Warped, Kind::Direct, Kind::Pixels] {
            let with_view = match kind {
                Kind::Warped => Waiting { warped: 1, ..background },
                Kind::Direct => Waiting { direct: 1, ..background },
                _ => Waiting { pixels: 1, ..background },
            };
            assert_eq!(policy.next(&with_view).unwrap().kind, kind);
            assert_eq!(policy.next(&background).unwrap().kind, Kind::Background);
        }
    }

    #[test]
    fn while_a_sampler_is_made_only_work_without_it_is_done() {
        use Kind::{Background, Order, Warped};
        let waiting = Waiting { makes_sampler: true, ..Waiting::default() };
        let some = Waiting { samples: 2, pixels: 1, direct: 1, postponed: 1, prefetch: 1, ..waiting };
        assert_eq!(all(some), []);
        assert_eq!(all(Waiting { orders: 1, warped: 1, background: 1, ..some }), [Order, Warped, Background]);
    }

    #[test]
    fn between_two_slices_of_a_sample_each_kind_of_view_gets_one_batch() {
        let mut policy = Policy::default();
        let waiting = Waiting { direct: 9, warped: 9, background: 1, samples: 1, ..Waiting::default() };
        policy.pause();
        assert_eq!(policy.between(&waiting).unwrap(), Turn { kind: Kind::Direct, most: 4 });
        assert_eq!(policy.between(&waiting).unwrap(), Turn { kind: Kind::Warped, most: 64 });
        assert_eq!(policy.between(&waiting), None);
        policy.pause();
        assert!(policy.between(&waiting).is_some());
        policy.pause();
        assert_eq!(policy.between(&Waiting { scene_changes: true, orders: 1, ..waiting }), None);
    }

    #[test]
    fn a_busy_worker_renders_views_for_three_times_as_long_as_its_background_slices() {
        let ms = Duration::from_millis;
        let mut policy = Policy::default();
        let busy = Waiting { direct: 9, background: 9, ..Waiting::default() };
        let mut spent = (ms(0), ms(0));
        for _ in 0..65 {
            match policy.next(&busy).unwrap().kind {
                Kind::Background => {
                    policy.had_slice(ms(20));
                    spent.0 += ms(20);
                }
                _ => {
                    policy.had_views(ms(5));
                    spent.1 += ms(5);
                }
            }
        }
        assert_eq!((spent.0 * OWED, spent.0), (spent.1, ms(100)));
        // Owed time delays nothing if no view waits.
        policy.had_slice(ms(20));
        assert_eq!(policy.next(&Waiting { direct: 0, ..busy }).unwrap().kind, Kind::Background);
        // Owed time also extends the pauses of a sample.
        policy.had_slice(ms(20));
        policy.pause();
        let mut batches = 0;
        while policy.between(&busy).is_some() {
            policy.had_views(ms(10));
            batches += 1;
        }
        assert_eq!(batches, 6);
    }

    #[test]
    fn a_batch_is_the_longest_front_of_a_queue_that_can_share_it() {
        let queue = || VecDeque::from([1, 3, 5, 2, 7]);
        let odd = |a: &i32, b: &i32| a % 2 == b % 2;
        let mut rest = queue();
        assert_eq!(take_batch(&mut rest, 9, odd), [1, 3, 5]);
        assert_eq!(rest, [2, 7]);
        assert_eq!(take_batch(&mut queue(), 2, odd), [1, 3]);
        assert_eq!(take_batch(&mut queue(), 0, odd), [1], "an empty batch would never end");
        assert!(take_batch(&mut VecDeque::new(), 4, odd).is_empty());
    }

    #[test]
    fn every_address_is_asked_before_a_sample_is_rendered() {
        let view = Need::View { dispensable: false };
        assert_eq!([seek(view, 0, 2), seek(view, 1, 2)], [Seek::Ask(0), Seek::Ask(1)]);
        assert_eq!(seek(view, 2, 2), Seek::Render { prefetch: false });
        assert_eq!(seek(Need::View { dispensable: true }, 2, 2), Seek::GiveUp);
        let prefetch = |feeds_others| Need::Prefetch { feeds_others };
        assert_eq!(seek(prefetch(false), 0, 0), Seek::Render { prefetch: true });
        assert_eq!(seek(prefetch(false), 1, 1), Seek::AskAgain);
        assert_eq!(seek(prefetch(true), 1, 1), Seek::Render { prefetch: true });
    }

    #[test]
    fn a_request_for_a_prefetched_sample_waits_before_it_causes_rendering() {
        assert_eq!(serve(true, false, false), Serve::Render);
        assert_eq!([serve(true, true, false), serve(true, true, true)], [Serve::Await, Serve::Render]);
        for prefetch in [false, true] {
            assert_eq!(
                [serve(false, prefetch, false), serve(false, prefetch, true)],
                [Serve::Await, Serve::Refuse]
            );
        }
    }

    #[test]
    fn a_role_changes_once_the_old_roles_work_is_done() {
        let direct = Waiting { direct: 1, ..Waiting::default() };
        let warped = Waiting { warped: 1, ..Waiting::default() };
        assert!(!may_change_role(Role::Sampler, Role::Compositor, &direct));
        assert!(may_change_role(Role::Sampler, Role::Compositor, &warped));
        assert!(!may_change_role(Role::Both, Role::Sampler, &warped));
        assert!(
            may_change_role(Role::Both, Role::Both, &direct)
                && may_change_role(Role::Sampler, Role::Both, &direct)
        );
        assert_eq!([0, 1, 2, 8].map(threads_beside), [1, 1, 1, 7]);
    }
}
