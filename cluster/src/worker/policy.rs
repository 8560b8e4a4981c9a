//! What a worker does next, as a pure function of what waits: no threads, no clock, no channels.
//!
//! The queue of the real render thread and the simulated worker of `argus study simulate` both ask this module, so that
//! what the simulator shows is what the service does.
//!
//! # The order of work
//!
//! A worker has one render thread. It asks [`Policy::next`] whenever it has nothing to do, and [`Policy::between`] in the
//! pauses of work that pauses. The answer is a [`Turn`]: one kind of work, and how many items of it make a batch.
//!
//! 1. *Orders* of the coordinator, such as another scene: what follows them must be done their way.
//! 2. *Postponed* work: it was taken earlier and found no sampler.
//! 3. *Awaited samples*. Only requests that insist on samples wait for them, and fetches of other workers.
//! 4. A *round*: pixels that no sample saw, since all else of their view is done; views from triangles; views from
//!    samples; one *slice* of background work. Each kind gets one batch a round, if any of it waits.
//! 5. *Samples ahead of demand*, one at a time, if nothing else waits.
//!
//! No view waits for background work: samples that the compositor takes up before a view asks for them. It is done in slices of
//! [`SLICE_MS`] at most, so a view that arrives waits for one slice at most. After a slice, views that wait have
//! as long, so that a busy worker gives background work half of its time at most, and that work still ends. With views strictly
//! first, a worker that is too busy would never hold the samples that make its views cheaper.
//!
//! Two kinds of longer work pause between slices: a sample, whether or not a request waits for it, and the first use of the
//! compositor's programs, which an order to measure begins. In a pause the thread does one round without the slice of
//! background work, and further ones while views are owed time for the slice before. It does none while an order for another
//! scene waits: views behind that order are not this scene's.
//!
//! While a sampler is made in a thread of its own, what needs one waits, and views from samples go on.
//!
//! # Where samples come from
//!
//! [`seek`] says where a worker seeks a sample that it does not hold: at each of the addresses that it was told, in their order,
//! then by rendering it. [`serve`] says what becomes of another worker's request for a sample that is not here.

use std::collections::VecDeque;
use std::ops::Add;
use std::time::Duration;

use crate::core::Role;

/// Longest slice of background work, milliseconds. A view that arrives in the midst of one waits for its end: at
/// 20 views a second that adds a fifth of a frame's time on the mean.
pub const SLICE_MS: f64 = 20.0;

/// A worker that is asked for a sample which it was told to bring waits so long for the bringing to begin: whoever sent the
/// other worker here has told this one, too, or is about to.
pub const ANNOUNCED: Duration = Duration::from_secs(1);

/// A sample for views to come that could not be had is sought again after this long.
pub const PAUSE: Duration = Duration::from_millis(500);

/// Kinds of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Orders of the coordinator, one at a time.
    Order,
    /// Work that was taken before it turned out that there is no sampler yet.
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
    /// Samples ahead of demand.
    Prefetch,
}

impl Kind {
    /// Kinds of views and of their parts, in the order of a round.
    const VIEWS: [Self; 3] = [Self::Pixels, Self::Direct, Self::Warped];
    /// Kinds of a round, in their order.
    const ROUND: [Self; 4] = [Self::Pixels, Self::Direct, Self::Warped, Self::Background];

    /// Whether it is views, or parts of views.
    pub fn is_views(self) -> bool {
        Self::VIEWS.contains(&self)
    }

    /// Whether a sampler does it. Postponed work waits for nothing else.
    fn needs_sampler(self) -> bool {
        matches!(self, Self::Postponed | Self::Sample | Self::Pixels | Self::Direct | Self::Prefetch)
    }
}

/// How much waits, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Waiting {
    /// [`Kind::Order`].
    pub orders: usize,
    /// One of the orders is for another scene.
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
    /// [`Kind::Background`], pieces of work of any number of slices.
    pub background: usize,
    /// [`Kind::Prefetch`].
    pub prefetch: usize,
    /// A sampler is in the making.
    pub sampler_is_coming: bool,
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
        self.of(kind) > 0 && !(self.sampler_is_coming && kind.needs_sampler())
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
            sampler_is_coming: self.sampler_is_coming || other.sampler_is_coming,
        }
    }
}

/// What is done next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The kind.
    pub kind: Kind,
    /// Most items of a batch.
    pub most: usize,
}

/// Most items of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Views from samples: a batch gains by sharing its passes.
    pub warped: usize,
    /// Views from triangles, and pixels: each is long, so few keep other work prompt.
    pub direct: usize,
}

impl Default for Limits {
    /// Beyond 64 a batch of warped views gains nothing and makes its first view wait for its last.
    fn default() -> Self {
        Self { warped: 64, direct: 4 }
    }
}

/// The order of a worker's work, and how far its round is.
#[derive(Debug, Clone, Default)]
pub struct Policy {
    limits: Limits,
    /// Kinds that had their turn in this round.
    had: Vec<Kind>,
    /// Time that views have before the next slice of background work.
    owed: Duration,
}

impl Policy {
    /// At the beginning of a round. A limit of 0 counts as 1.
    pub fn new(limits: Limits) -> Self {
        let limits = Limits { warped: limits.warped.max(1), direct: limits.direct.max(1) };
        Self { limits, ..Self::default() }
    }

    /// What is done next; `None` if nothing can be.
    pub fn next(&mut self, waiting: &Waiting) -> Option<Turn> {
        let first = [Kind::Order, Kind::Postponed, Kind::Sample].into_iter().find(|kind| waiting.has(*kind));
        let views_wait = Kind::VIEWS.into_iter().any(|kind| waiting.has(kind));
        let kinds = if views_wait && !self.owed.is_zero() { &Kind::VIEWS[..] } else { &Kind::ROUND[..] };
        let turn = first.or_else(|| self.in_round(waiting, kinds));
        let turn = turn.or_else(|| Some(Kind::Prefetch).filter(|kind| waiting.has(*kind)));
        turn.map(|kind| self.turn(kind))
    }

    /// A slice of background work took this long: waiting views are owed as much time.
    pub fn had_slice(&mut self, took: Duration) {
        self.owed = took;
    }

    /// A batch of views took this long.
    pub fn had_views(&mut self, took: Duration) {
        self.owed = self.owed.saturating_sub(took);
    }

    /// Begins a pause between two slices of longer work.
    pub fn pause(&mut self) {
        self.had.clear();
    }

    /// What is done next in a pause; `None` ends it. Each kind of view gets one batch, and further ones while views are owed time.
    pub fn between(&mut self, waiting: &Waiting) -> Option<Turn> {
        if waiting.scene_changes {
            return None;
        }
        let is_left = |had: &[Kind], kind: &Kind| waiting.has(*kind) && !had.contains(kind);
        let mut kind = Kind::VIEWS.into_iter().find(|kind| is_left(&self.had, kind));
        if kind.is_none() && !self.owed.is_zero() {
            self.had.clear();
            kind = Kind::VIEWS.into_iter().find(|kind| is_left(&self.had, kind));
        }
        let kind = kind?;
        self.had.push(kind);
        Some(self.turn(kind))
    }

    /// The next of these kinds in the round; a round ends when what waits has had its turn.
    fn in_round(&mut self, waiting: &Waiting, kinds: &[Kind]) -> Option<Kind> {
        let waits = |kind: &&Kind| waiting.has(**kind);
        let next = kinds.iter().filter(waits).find(|kind| !self.had.contains(kind));
        let kind = *next.or_else(|| {
            self.had.clear();
            kinds.iter().find(waits)
        })?;
        self.had.push(kind);
        Some(kind)
    }

    fn turn(&self, kind: Kind) -> Turn {
        let most = match kind {
            Kind::Warped => self.limits.warped,
            Kind::Direct | Kind::Pixels => self.limits.direct,
            // One at a time where that costs no more: who waits for the first of many begins while the next is rendered. How
            // many samples it pays to render together is their set's to say.
            Kind::Sample => usize::MAX,
            Kind::Order | Kind::Postponed | Kind::Background | Kind::Prefetch => 1,
        };
        Turn { kind, most }
    }
}

/// Takes the first items of a queue, `most` at most, that can be done together with the very first one.
pub fn take_batch<T>(queue: &mut VecDeque<T>, most: usize, together: impl Fn(&T, &T) -> bool) -> VecDeque<T> {
    let Some(first) = queue.front() else { return VecDeque::new() };
    let count = queue.iter().skip(1).take_while(|next| together(first, next)).count() + 1;
    let rest = queue.split_off(count.min(most.max(1)));
    std::mem::replace(queue, rest)
}

/// What a sample is sought for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A view of this worker.
    View {
        /// The view can do without.
        dispensable: bool,
    },
    /// Views to come.
    Prefetch {
        /// Other workers are fed from here, and wait until this one has it.
        feeds_others: bool,
    },
}

/// Where a sample is sought next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seek {
    /// At the address of that position.
    Ask(usize),
    /// It is rendered here; ahead of demand where no view waits for it.
    Render {
        /// No view waits for it.
        prefetch: bool,
    },
    /// At all addresses once more, after [`PAUSE`].
    AskAgain,
    /// Nowhere.
    GiveUp,
}

/// Where a sample is sought next, after `asked` of `addresses` have been asked in vain.
pub fn seek(need: Need, asked: usize, addresses: usize) -> Seek {
    match need {
        _ if asked < addresses => Seek::Ask(asked),
        Need::View { dispensable: false } => Seek::Render { prefetch: false },
        Need::View { dispensable: true } => Seek::GiveUp,
        Need::Prefetch { feeds_others } if feeds_others || addresses == 0 => Seek::Render { prefetch: true },
        Need::Prefetch { .. } => Seek::AskAgain,
    }
}

/// What becomes of another worker's request for a sample that is not here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Serve {
    /// It is rendered at once.
    Render,
    /// The request waits for the sample, which should be on its way here, for [`ANNOUNCED`] at most.
    Await,
    /// The request fails.
    Refuse,
}

/// What becomes of another worker's request. `samples`: samples are this worker's work; `ahead`: no view waits for it there;
/// `awaited`: the sample was awaited here in vain.
pub fn serve(samples: bool, prefetch: bool, awaited: bool) -> Serve {
    match (samples, prefetch || !samples, awaited) {
        (_, true, false) => Serve::Await,
        (true, _, _) => Serve::Render,
        (false, _, _) => Serve::Refuse,
    }
}

/// Whether a worker has done what its old role gave it, so that it may act in the new one. `left`: what waits or is in work.
pub fn may_change_role(before: Role, told: Role, left: &Waiting) -> bool {
    let samples_due = before.samples() && !told.samples() && left.direct + left.samples + left.pixels > 0;
    let views_due = before.composites() && !told.composites() && left.warped > 0;
    !(samples_due || views_due)
}

/// Threads that pack frames and samples beside the render thread of a worker: as many as leave that thread its core. A
/// batch ends with all of its frames at once, and as many threads would keep the next batch waiting.
pub fn threads_beside(cores: u32) -> usize {
    (cores as usize).saturating_sub(1).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kinds of all turns until nothing waits, each turn taking one item away.
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
    fn orders_come_first_and_samples_ahead_of_demand_last() {
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
    fn while_a_sampler_is_made_only_what_needs_none_is_done() {
        use Kind::{Background, Order, Warped};
        let waiting = Waiting { sampler_is_coming: true, ..Waiting::default() };
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
    fn after_a_background_slice_a_busy_worker_renders_views_for_as_long() {
        let ms = Duration::from_millis;
        let mut policy = Policy::default();
        let busy = Waiting { direct: 9, background: 9, ..Waiting::default() };
        let mut spent = (ms(0), ms(0));
        for _ in 0..60 {
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
        assert_eq!(spent.0, spent.1);
        // What is owed holds nothing up where no view waits.
        policy.had_slice(ms(20));
        assert_eq!(policy.next(&Waiting { direct: 0, ..busy }).unwrap().kind, Kind::Background);
        // The same in the pauses of a sample.
        policy.had_slice(ms(20));
        policy.pause();
        let mut batches = 0;
        while policy.between(&busy).is_some() {
            policy.had_views(ms(10));
            batches += 1;
        }
        assert_eq!(batches, 2);
    }

    #[test]
    fn a_batch_is_the_front_of_a_queue_as_far_as_it_can_be_done_together() {
        let queue = || VecDeque::from([1, 3, 5, 2, 7]);
        let odd = |a: &i32, b: &i32| a % 2 == b % 2;
        let mut rest = queue();
        assert_eq!(take_batch(&mut rest, 9, odd), [1, 3, 5]);
        assert_eq!(rest, [2, 7]);
        assert_eq!(take_batch(&mut queue(), 2, odd), [1, 3]);
        assert_eq!(take_batch(&mut queue(), 0, odd), [1], "a batch of none would never end");
        assert!(take_batch(&mut VecDeque::new(), 4, odd).is_empty());
    }

    #[test]
    fn a_sample_is_sought_at_every_address_before_it_is_rendered() {
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
    fn a_request_for_a_sample_ahead_of_demand_waits_before_it_makes_work() {
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
    fn a_role_changes_when_what_the_old_one_gave_is_done() {
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
