//! Scene time: which epoch views are made of, and which one is got ready.
//!
//! Epochs count multiples of Δt of the coordinator's uptime, so that the scene moves at its own pace however long
//! rendering takes: on slow samplers an epoch is followed by one that is several numbers higher, and the motion is
//! coarser, never slower. At any time one epoch is *served*: plans that are made now name its samples, and a frame
//! is of that epoch alone. While it is served the next one is got ready: the cameras that plans named lately are
//! rendered anew, ahead of demand. Only when all of these samples are there is that epoch served.
//!
//! So nothing starves: views never wait for the next epoch, since they are answered in the one that is there;
//! and the next epoch waits for a set of samples that was settled when it was issued, not for those that new
//! viewpoints ask for meanwhile. While one epoch is on its way to those who compose, samplers render the one after it.
//! If nothing comes for [`Epochs::patience`], a sampler being lost or busy with
//! what views wait for, the epoch is served as it is, and what it lacks is rendered on demand.
//!
//! An epoch that is no longer served is kept until the next change, and for as long as a view that was planned in
//! it is in work. While nobody looks no epoch is issued: the next view begins the one of its own time.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use crate::core::time::Uptime;

/// Cameras that an epoch is got ready for, at most: those used last.
const MOST_CAMERAS: usize = 4096;

/// An epoch, and the cameras of the rig that it was got ready for.
#[derive(Debug, Clone, Default)]
struct Moment {
    epoch: u64,
    cameras: BTreeSet<u64>,
}

/// Epochs that are got ready at the same time: while one is on its way to those who compose, the next is rendered.
const MOST_UPCOMING: usize = 2;

/// An epoch that is got ready.
#[derive(Debug, Clone)]
struct Upcoming {
    moment: Moment,
    /// How many of its cameras' samples are there.
    there: usize,
    /// When there were fewer of them last.
    progressed: Uptime,
}

/// The epochs of one scene.
#[derive(Debug, Clone)]
pub(super) struct Epochs {
    /// Δt; `None` where the scene stands still, and then epoch 0 is served for ever.
    every: Option<Duration>,
    /// A camera is of interest for this long after a plan named it.
    interest: Duration,
    /// How long an epoch waits for its next sample.
    patience: Duration,
    served: Moment,
    /// The one that was served before.
    before: Moment,
    /// Older ones that views in work were planned in.
    past: Vec<Moment>,
    /// Those that are got ready, oldest first.
    upcoming: VecDeque<Upcoming>,
    /// When the newest epoch was issued.
    issued: Uptime,
    /// When plans named which cameras last.
    used: BTreeMap<u64, Uptime>,
    /// An epoch is issued only after so many plans since the last one.
    plans_each: u64,
    /// Plans since the newest epoch was issued.
    plans: u64,
}

impl Epochs {
    /// From epoch 0 on.
    pub(super) fn new(every: Option<Duration>, interest: Duration, patience: Duration) -> Self {
        Self {
            every: every.filter(|every| !every.is_zero()),
            interest,
            patience,
            served: Moment::default(),
            before: Moment::default(),
            past: Vec::new(),
            upcoming: VecDeque::new(),
            issued: Uptime::default(),
            used: BTreeMap::new(),
            plans_each: 0,
            plans: 0,
        }
    }

    /// Each epoch is issued only after so many plans: the ticks of the cluster paper, which samples the scene anew for
    /// every V views, whatever time they take.
    pub(super) fn with_plans(self, plans_each: u64) -> Self {
        // The first is issued at once: while one is served, the next is on its way.
        Self { plans_each, plans: plans_each, ..self }
    }

    /// The one that plans are made of.
    pub(super) fn served(&self) -> u64 {
        self.served.epoch
    }

    /// The oldest one whose samples are still kept for views that name them.
    pub(super) fn oldest(&self) -> u64 {
        self.before.epoch
    }

    /// What was got ready, and what is: epochs with their cameras.
    pub(super) fn prepared(&self) -> impl Iterator<Item = (u64, u64)> {
        let upcoming = self.upcoming.iter().map(|upcoming| &upcoming.moment);
        let moments = self.past.iter().chain([&self.before, &self.served]).chain(upcoming);
        moments.flat_map(|moment| moment.cameras.iter().map(|camera| (moment.epoch, *camera)))
    }

    /// Lets go of what was served before the last change, but for epochs that views in work need.
    pub(super) fn retire(&mut self, is_needed: impl Fn(u64) -> bool) {
        self.past.retain(|moment| is_needed(moment.epoch));
    }

    /// Whether the scene moves at all.
    pub(super) fn moves(&self) -> bool {
        self.every.is_some()
    }

    /// Somebody looks: after a pause, the epoch of this moment is served at once. Whether it is another one.
    pub(super) fn wake(&mut self, now: Uptime) -> bool {
        self.forget(now);
        if !self.upcoming.is_empty() || !self.used.is_empty() {
            return false;
        }
        let at = self.at(now);
        if at <= self.served.epoch {
            return false;
        }
        self.issued = now;
        self.serve(Moment { epoch: at, cameras: BTreeSet::new() });
        true
    }

    /// A plan names these cameras.
    pub(super) fn used(&mut self, cameras: impl IntoIterator<Item = u64>, now: Uptime) {
        if self.every.is_some() {
            self.plans += 1;
            self.used.extend(cameras.into_iter().map(|camera| (camera, now)));
        }
    }

    /// Serves the next epoch if its samples are there (`is_there` of epoch and camera), and issues another one when its
    /// time has come and the one before it is rendered (`is_rendered`), for the cameras in use and those of `beside`.
    /// Whether anything changed; how many samples were ordered.
    pub(super) fn advance(
        &mut self,
        now: Uptime,
        beside: impl IntoIterator<Item = u64>,
        mut is_there: impl FnMut(u64, u64) -> bool,
        is_rendered: impl Fn(u64, u64) -> bool,
    ) -> (bool, usize) {
        let mut changed = false;
        while let Some(upcoming) = self.upcoming.front_mut() {
            let Moment { epoch, cameras } = &upcoming.moment;
            let there = cameras.iter().filter(|&&camera| is_there(*epoch, camera)).count();
            if there > upcoming.there {
                upcoming.progressed = now;
            }
            upcoming.there = there;
            if there < cameras.len() && now.since(upcoming.progressed) < self.patience {
                break;
            }
            let moment = std::mem::take(&mut upcoming.moment);
            self.upcoming.pop_front();
            self.serve(moment);
            if let Some(next) = self.upcoming.front_mut() {
                next.progressed = now;
            }
            changed = true;
        }
        let Some(every) = self.every else { return (changed, 0) };
        let newest = self.upcoming.back().map(|upcoming| &upcoming.moment);
        let in_work =
            newest.is_some_and(|Moment { epoch, cameras }| !cameras.iter().all(|&c| is_rendered(*epoch, c)));
        if in_work || self.upcoming.len() >= MOST_UPCOMING {
            return (changed, 0);
        }
        let last = newest.map_or(self.served.epoch, |newest| newest.epoch);
        self.forget(now);
        let epoch = self.at(now);
        if epoch <= last || now.since(self.issued) < every || self.used.is_empty() {
            return (changed, 0);
        }
        if self.plans < self.plans_each {
            return (changed, 0);
        }
        // What came late is not caught up with.
        self.plans = (self.plans - self.plans_each).min(self.plans_each);
        let cameras: BTreeSet<u64> = self.used.keys().copied().chain(beside).collect();
        let ordered = cameras.len();
        let upcoming = Upcoming { moment: Moment { epoch, cameras }, there: 0, progressed: now };
        self.upcoming.push_back(upcoming);
        self.issued = now;
        (true, ordered)
    }

    fn serve(&mut self, moment: Moment) {
        let before = std::mem::replace(&mut self.served, moment);
        self.past.push(std::mem::replace(&mut self.before, before));
    }

    /// The epoch of a moment.
    fn at(&self, now: Uptime) -> u64 {
        let Some(every) = self.every else { return 0 };
        u64::try_from(now.since(Uptime::default()).as_nanos() / every.as_nanos().max(1)).unwrap_or(u64::MAX)
    }

    /// Lets go of cameras that nobody has used for long.
    fn forget(&mut self, now: Uptime) {
        self.used.retain(|_, used| now.since(*used) < self.interest);
        if self.used.len() > MOST_CAMERAS {
            let mut times: Vec<Uptime> = self.used.values().copied().collect();
            times.sort_unstable();
            let limit = times[times.len() - MOST_CAMERAS];
            self.used.retain(|_, used| *used >= limit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: Duration = Duration::from_millis(100);

    fn epochs() -> Epochs {
        Epochs::new(Some(DT), Duration::from_secs(1), Duration::from_secs(5))
    }

    fn ms(ms: u64) -> Uptime {
        Uptime(Duration::from_millis(ms))
    }

    #[test]
    fn a_scene_that_stands_still_has_one_epoch() {
        let mut still = Epochs::new(None, Duration::from_secs(1), Duration::from_secs(5));
        still.used([1, 2], ms(0));
        assert!(!still.wake(ms(5000)));
        assert_eq!(still.advance(ms(10_000), [], |_, _| true, |_, _| false), (false, 0));
        assert_eq!((still.served(), still.prepared().count()), (0, 0));
        assert_eq!(
            Epochs::new(Some(Duration::ZERO), DT, DT).advance(ms(10_000), [], |_, _| true, |_, _| false),
            (false, 0)
        );
    }

    #[test]
    fn an_epoch_is_served_once_all_of_its_samples_are_there() {
        let mut epochs = epochs();
        epochs.used([7, 9], ms(0));
        assert_eq!(epochs.advance(ms(99), [], |_, _| false, |_, _| false), (false, 0), "not before its time");
        assert_eq!(epochs.advance(ms(100), [], |_, _| false, |_, _| false), (true, 2));
        assert_eq!(epochs.prepared().collect::<Vec<_>>(), [(1, 7), (1, 9)]);
        assert_eq!(
            epochs.advance(ms(140), [], |epoch, camera| (epoch, camera) == (1, 7), |_, _| false),
            (false, 0)
        );
        assert_eq!(epochs.served(), 0);
        assert_eq!(epochs.advance(ms(150), [], |epoch, _| epoch == 1, |_, _| false), (true, 0));
        assert_eq!((epochs.served(), epochs.oldest()), (1, 0));
        assert_eq!(
            epochs.advance(ms(199), [], |_, _| true, |_, _| false),
            (false, 0),
            "no sooner than Δt after the last"
        );
        assert_eq!(epochs.advance(ms(200), [3], |_, _| false, |_, _| false), (true, 3));
        let kept = [(1, 7), (1, 9), (2, 3), (2, 7), (2, 9)];
        assert_eq!(epochs.prepared().collect::<Vec<_>>(), kept, "the served epoch's stay");
    }

    #[test]
    fn slow_samplers_make_motion_coarser_and_not_slower() {
        let mut epochs = epochs();
        let mut served = Vec::new();
        for now in (0..4000).step_by(10) {
            epochs.used([1], ms(now));
            // A sample takes 700 ms.
            let issued = epochs.issued;
            if epochs
                .advance(
                    ms(now),
                    [],
                    |_, _| ms(now).since(issued) >= Duration::from_millis(700),
                    |_, _| false,
                )
                .0
            {
                served.push((now, epochs.served()));
            }
        }
        served.dedup_by_key(|(_, epoch)| *epoch);
        for (now, epoch) in &served[1..] {
            let late = now - epoch * 100;
            assert!((700..=810).contains(&late), "epoch {epoch} is served at {now} ms");
        }
        assert!(served.len() >= 5, "{served:?}");
    }

    #[test]
    fn while_one_epoch_is_on_its_way_the_next_is_rendered_and_no_third() {
        let mut epochs = epochs();
        epochs.used([1], ms(0));
        assert_eq!(epochs.advance(ms(100), [], |_, _| false, |_, _| false), (true, 1));
        assert_eq!(
            epochs.advance(ms(250), [], |_, _| false, |_, _| false),
            (false, 0),
            "it is being rendered"
        );
        assert_eq!(epochs.advance(ms(260), [], |_, _| false, |_, _| true), (true, 1), "and now on its way");
        assert_eq!(epochs.advance(ms(400), [], |_, _| false, |_, _| true), (false, 0));
        assert_eq!(epochs.prepared().collect::<Vec<_>>(), [(1, 1), (2, 1)]);
        assert!(epochs.advance(ms(450), [], |epoch, _| epoch == 1, |_, _| false).0);
        assert_eq!((epochs.served(), epochs.oldest()), (1, 0));
    }

    #[test]
    fn an_epoch_for_every_so_many_plans_is_issued_after_them_and_no_sooner() {
        let mut epochs = epochs().with_plans(3);
        epochs.used([1], ms(100));
        epochs.used([1], ms(200));
        assert_eq!(
            epochs.advance(ms(300), [], |_, _| true, |_, _| true),
            (true, 1),
            "the first one ahead of views"
        );
        assert_eq!(
            epochs.advance(ms(420), [], |_, _| true, |_, _| true),
            (true, 0),
            "two plans: none is issued"
        );
        epochs.used([1], ms(430));
        assert_eq!(epochs.advance(ms(440), [], |_, _| true, |_, _| true), (true, 1));
        assert_eq!(epochs.advance(ms(600), [], |_, _| true, |_, _| true), (true, 0));
        (0..30).for_each(|i| epochs.used([1], ms(600 + i)));
        assert_eq!(epochs.advance(ms(700), [], |_, _| true, |_, _| true), (true, 1));
        // Of nine epochs that were missed, one is made up for.
        let issued =
            (0..20).filter(|i| epochs.advance(ms(750 + i * 20), [], |_, _| true, |_, _| true).1 > 0).count();
        assert_eq!(issued, 1);
    }

    #[test]
    fn new_viewpoints_do_not_hold_an_epoch_up() {
        let mut epochs = epochs();
        epochs.used([0], ms(0));
        let mut changes = 0;
        for now in (100..3000).step_by(50) {
            epochs.used([now], ms(now));
            // What was of interest when the epoch was issued is there 50 ms later; later comers never are.
            changes +=
                u64::from(epochs.advance(ms(now), [], |epoch, camera| camera <= epoch * 100, |_, _| false).0);
        }
        assert!(changes > 25 && epochs.served() >= 27, "{changes}, epoch {}", epochs.served());
    }

    #[test]
    fn an_epoch_whose_samples_never_come_is_served_when_patience_ends() {
        let mut epochs = epochs();
        epochs.used([1, 2], ms(0));
        epochs.advance(ms(100), [], |_, _| false, |_, _| false);
        assert_eq!(epochs.advance(ms(4000), [], |_, camera| camera == 1, |_, _| false), (false, 0));
        assert_eq!(
            epochs.advance(ms(8900), [], |_, camera| camera == 1, |_, _| false),
            (false, 0),
            "one came at 4 s"
        );
        assert!(epochs.advance(ms(9000), [], |_, camera| camera == 1, |_, _| false).0);
        assert_eq!((epochs.served(), epochs.oldest()), (1, 0));
    }

    #[test]
    fn while_nobody_looks_nothing_is_issued_and_the_next_view_sees_its_own_time() {
        let mut epochs = epochs();
        assert_eq!(epochs.advance(ms(700), [], |_, _| true, |_, _| false), (false, 0));
        assert!(epochs.wake(ms(750)));
        assert_eq!(epochs.served(), 7);
        epochs.used([1], ms(750));
        assert!(!epochs.wake(ms(790)), "it is looked at");
        assert_eq!(epochs.advance(ms(850), [], |_, _| true, |_, _| false), (true, 1));
        assert_eq!(epochs.advance(ms(900), [], |_, _| true, |_, _| false), (true, 0));
        assert_eq!(epochs.served(), 8);
        assert_eq!(
            epochs.advance(ms(1800), [], |_, _| true, |_, _| false),
            (false, 0),
            "the last view was a second ago"
        );
        assert!(epochs.wake(ms(60_050)));
        assert_eq!((epochs.served(), epochs.oldest()), (600, 8));
    }
}
