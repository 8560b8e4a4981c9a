//! Versions of the sample set: which one is served, what each shows, and which ones are prepared.
//!
//! The coordinator issues versions and numbers them. Each shows a state of the scene: its time. Epochs count
//! multiples of Δt of the coordinator's uptime, so the scene moves at its own pace however long rendering takes. On
//! slow samplers, versions skip epochs: the motion is coarser, never slower. At any time one version is *served*: new
//! plans use its samples, and a frame is of one version alone. Meanwhile the next version is prepared: the recently
//! used cameras are rendered ahead of demand. It is served once all of these samples exist.
//!
//! So nothing starves. Views never wait for the next version, since they are answered in the served one. The next
//! version waits for samples that were fixed when it was issued, not for those of later viewpoints. While one version
//! is distributed to compositors, samplers render the one after it. If no sample comes for [`Versions::patience`],
//! since a sampler was lost or is busy with what views wait for, the version is served as it is, and missing samples
//! are rendered on demand.
//!
//! A version that is no longer served is kept until the next change, and while a view that was planned in it is in
//! work. While no view arrives, no version is issued; the next view starts one of its own time.
//!
//! In a still scene, light rises: a version in better light is issued once all workers have that light ready
//! ([`LightLevel`]), for the cameras in use. It is prepared and served like a version of the next epoch.
//!
//! Two versions may show the same state: samples that are rendered differently from now on get a version of their
//! own, so that no view mixes both.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use argus_scene::{LightLevel, SceneState, Version};

use crate::core::time::Uptime;

/// Most cameras that a version is prepared for: the most recently used.
const MOST_CAMERAS: usize = 4096;

/// A version, and the cameras that it was prepared for.
#[derive(Debug, Clone, Default)]
struct Prepared {
    version: Version,
    cameras: BTreeSet<u64>,
}

/// Most versions in preparation: while one is distributed to compositors, the next is rendered.
const MOST_UPCOMING: usize = 2;

/// A version in preparation.
#[derive(Debug, Clone)]
struct Upcoming {
    prepared: Prepared,
    /// Number of its samples that exist.
    there: usize,
    /// The time of the last progress.
    progressed: Uptime,
}

/// The versions of one sample set.
#[derive(Debug, Clone)]
pub(super) struct Versions {
    /// Δt; `None` in a still scene, where all versions show the first one's state.
    every: Option<Duration>,
    /// A camera is of interest for this long after a plan used it.
    interest: Duration,
    /// Longest wait of a version for its next sample.
    patience: Duration,
    served: Prepared,
    begins_in_direct_light: bool,
    /// The previously served version.
    before: Prepared,
    /// Older versions that views in work need.
    past: Vec<Prepared>,
    /// Versions in preparation, oldest first.
    upcoming: VecDeque<Upcoming>,
    /// Number of the next version.
    next: u64,
    /// The time of issue of the newest version.
    issued: Uptime,
    /// The last use of each camera by a plan.
    used: BTreeMap<u64, Uptime>,
    /// Least number of plans between two versions.
    plans_each: u64,
    /// Plans since the newest version was issued.
    plans: u64,
}

impl Versions {
    /// Starts at a first version.
    pub(super) fn new(
        first: Version,
        every: Option<Duration>,
        interest: Duration,
        patience: Duration,
    ) -> Self {
        let first = Prepared { version: first, cameras: BTreeSet::new() };
        Self {
            every: every.filter(|every| !every.is_zero()),
            interest,
            patience,
            next: first.version.number + 1,
            begins_in_direct_light: first.version.state.light == LightLevel::Direct,
            served: first.clone(),
            before: first,
            past: Vec::new(),
            upcoming: VecDeque::new(),
            issued: Uptime::default(),
            used: BTreeMap::new(),
            plans_each: 0,
            plans: 0,
        }
    }

    /// Issues each version only after this many plans, like the cluster paper, which samples the scene anew for every
    /// V views, whatever time they take.
    pub(super) fn with_plans(self, plans_each: u64) -> Self {
        // The first one is issued at once, so that it is prepared while the initial version is served.
        Self { plans_each, plans: plans_each, ..self }
    }

    /// The version of new plans.
    pub(super) fn served(&self) -> Version {
        self.served.version
    }

    /// The oldest kept version.
    pub(super) fn oldest(&self) -> Version {
        self.before.version
    }

    /// The prepared and kept versions, with their cameras.
    pub(super) fn prepared(&self) -> impl Iterator<Item = (Version, u64)> {
        self.all().flat_map(|one| one.cameras.iter().map(|camera| (one.version, *camera)))
    }

    /// All versions that are kept or in preparation, oldest first, each once.
    pub(super) fn live(&self) -> Vec<Version> {
        let mut live: Vec<Version> = self.all().map(|one| one.version).collect();
        live.dedup();
        live
    }

    fn all(&self) -> impl Iterator<Item = &Prepared> {
        let upcoming = self.upcoming.iter().map(|upcoming| &upcoming.prepared);
        self.past.iter().chain([&self.before, &self.served]).chain(upcoming)
    }

    /// Drops the versions before the last change, except those that views in work need.
    pub(super) fn retire(&mut self, is_needed: impl Fn(u64) -> bool) {
        self.past.retain(|one| is_needed(one.version.number));
    }

    /// Serves a new version of the present state, since samples are rendered differently from now on. Samples of
    /// older versions can no longer be rendered, so none of these is kept.
    pub(super) fn renew(&mut self) {
        let version = self.issue(self.served.version.state);
        self.served.version = version;
        self.before = self.served.clone();
        self.past.clear();
        self.upcoming.clear();
    }

    /// Issues the next version, which shows this state. Each level of light that it skips uses up a number as well. So a
    /// still scene's version in full light has the same number in every cluster that measures no backend, and a pin to it
    /// holds in all of them.
    fn issue(&mut self, state: SceneState) -> Version {
        let risen = (state.light as u64).saturating_sub(self.newest().state.light as u64);
        let number = self.next + risen.saturating_sub(1);
        self.next = number + 1;
        Version { number, state }
    }

    /// Whether the scene moves.
    pub(super) fn moves(&self) -> bool {
        self.every.is_some()
    }

    /// Whether further versions will be served: the scene moves, or better light will come.
    pub(super) fn changes(&self) -> bool {
        self.moves() || !self.upcoming.is_empty() || self.light_rises()
    }

    /// Whether a version in better light will be issued. Light that does not begin at the lowest level stays as it is.
    fn light_rises(&self) -> bool {
        self.begins_in_direct_light && !self.moves() && self.newest().state.light.next().is_some()
    }

    /// The newest version, which may be in preparation.
    fn newest(&self) -> Version {
        self.upcoming.back().map_or(self.served.version, |upcoming| upcoming.prepared.version)
    }

    /// Serves a version of the present epoch for a new view, after a pause without views. Returns whether the version
    /// changed.
    pub(super) fn wake(&mut self, now: Uptime) -> bool {
        self.forget(now);
        if !self.upcoming.is_empty() || !self.used.is_empty() {
            return false;
        }
        let at = self.at(now);
        if at <= self.served.version.state.epoch {
            return false;
        }
        self.issued = now;
        let version = self.issue(SceneState { epoch: at, ..self.served.version.state });
        self.serve(Prepared { version, cameras: BTreeSet::new() });
        true
    }

    /// Records that a plan uses these cameras.
    pub(super) fn used(&mut self, cameras: impl IntoIterator<Item = u64>, now: Uptime) {
        if self.every.is_some() {
            self.plans += 1;
            self.used.extend(cameras.into_iter().map(|camera| (camera, now)));
        }
    }

    /// Whether plans named a camera lately.
    pub(super) fn is_used(&self, camera: u64) -> bool {
        self.used.contains_key(&camera)
    }

    /// Serves the next version if its samples exist (`is_there` of version and camera). Issues another one when its
    /// time has come, or when workers have better light ready, and the one before it is rendered (`is_rendered`). It is
    /// for the cameras in use and those of `beside`. Returns whether anything changed, and the number of ordered
    /// samples.
    pub(super) fn advance(
        &mut self,
        (now, light): (Uptime, LightLevel),
        beside: impl IntoIterator<Item = u64>,
        mut is_there: impl FnMut(Version, u64) -> bool,
        is_rendered: impl Fn(Version, u64) -> bool,
    ) -> (bool, usize) {
        let mut changed = false;
        while let Some(upcoming) = self.upcoming.front_mut() {
            let Prepared { version, cameras } = &upcoming.prepared;
            let there = cameras.iter().filter(|&&camera| is_there(*version, camera)).count();
            if there > upcoming.there {
                upcoming.progressed = now;
            }
            upcoming.there = there;
            if there < cameras.len() && now.since(upcoming.progressed) < self.patience {
                break;
            }
            let prepared = std::mem::take(&mut upcoming.prepared);
            self.upcoming.pop_front();
            self.serve(prepared);
            if let Some(next) = self.upcoming.front_mut() {
                next.progressed = now;
            }
            changed = true;
        }
        let newest = self.upcoming.back().map(|upcoming| &upcoming.prepared);
        let in_work = newest
            .is_some_and(|Prepared { version, cameras }| !cameras.iter().all(|&c| is_rendered(*version, c)));
        if in_work || self.upcoming.len() >= MOST_UPCOMING {
            return (changed, 0);
        }
        let next = match self.every {
            Some(every) => self.next_epoch(now, every),
            None => self.next_light(light),
        };
        let Some(state) = next else { return (changed, 0) };
        let cameras: BTreeSet<u64> = self.used.keys().copied().chain(beside).collect();
        let ordered = cameras.len();
        let version = self.issue(state);
        let upcoming = Upcoming { prepared: Prepared { version, cameras }, there: 0, progressed: now };
        self.upcoming.push_back(upcoming);
        self.issued = now;
        (true, ordered)
    }

    /// The state of the next version in a moving scene, if its time has come. Late epochs are skipped.
    fn next_epoch(&mut self, now: Uptime, every: Duration) -> Option<SceneState> {
        let newest = self.newest().state;
        self.forget(now);
        let epoch = self.at(now);
        if epoch <= newest.epoch || now.since(self.issued) < every || self.used.is_empty() {
            return None;
        }
        if self.plans < self.plans_each {
            return None;
        }
        self.plans = (self.plans - self.plans_each).min(self.plans_each);
        Some(SceneState { epoch, ..newest })
    }

    /// The state of the next version in a still scene, if workers have better light than the newest one shows.
    fn next_light(&self, light: LightLevel) -> Option<SceneState> {
        let newest = self.newest().state;
        (self.light_rises() && light > newest.light).then_some(SceneState { light, ..newest })
    }

    fn serve(&mut self, prepared: Prepared) {
        let before = std::mem::replace(&mut self.served, prepared);
        self.past.push(std::mem::replace(&mut self.before, before));
    }

    /// The epoch at a time.
    fn at(&self, now: Uptime) -> u64 {
        let Some(every) = self.every else { return 0 };
        u64::try_from(now.since(Uptime::default()).as_nanos() / every.as_nanos().max(1)).unwrap_or(u64::MAX)
    }

    /// Forgets cameras that were not used for long.
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

    fn versions() -> Versions {
        Versions::new(Version::default(), Some(DT), Duration::from_secs(1), Duration::from_secs(5))
    }

    /// The epochs of prepared versions, with their cameras.
    fn prepared(versions: &Versions) -> Vec<(u64, u64)> {
        versions.prepared().map(|(version, camera)| (version.state.epoch, camera)).collect()
    }

    fn ms(ms: u64) -> Uptime {
        Uptime(Duration::from_millis(ms))
    }

    #[test]
    fn a_still_scene_has_one_epoch() {
        let mut still =
            Versions::new(Version::default(), None, Duration::from_secs(1), Duration::from_secs(5));
        still.used([1, 2], ms(0));
        assert!(!still.wake(ms(5000)));
        assert_eq!(still.advance((ms(10_000), LightLevel::Full), [], |_, _| true, |_, _| false), (false, 0));
        assert_eq!((still.served().state.epoch, still.prepared().count()), (0, 0));
        assert_eq!(
            Versions::new(Version::default(), Some(Duration::ZERO), DT, DT).advance(
                (ms(10_000), LightLevel::Full),
                [],
                |_, _| true,
                |_, _| false
            ),
            (false, 0)
        );
    }

    #[test]
    fn an_epoch_is_served_once_all_of_its_samples_exist() {
        let mut versions = versions();
        versions.used([7, 9], ms(0));
        assert_eq!(
            versions.advance((ms(99), LightLevel::Full), [], |_, _| false, |_, _| false),
            (false, 0),
            "the time of the epoch has not come"
        );
        assert_eq!(versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false), (true, 2));
        assert_eq!(prepared(&versions), [(1, 7), (1, 9)]);
        assert_eq!(
            versions.advance(
                (ms(140), LightLevel::Full),
                [],
                |v, camera| (v.state.epoch, camera) == (1, 7),
                |_, _| false
            ),
            (false, 0)
        );
        assert_eq!(versions.served().state.epoch, 0);
        assert_eq!(
            versions.advance((ms(150), LightLevel::Full), [], |v, _| v.state.epoch == 1, |_, _| false),
            (true, 0)
        );
        assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
        assert_eq!(
            versions.advance((ms(199), LightLevel::Full), [], |_, _| true, |_, _| false),
            (false, 0),
            "no sooner than Δt after the last"
        );
        assert_eq!(versions.advance((ms(200), LightLevel::Full), [3], |_, _| false, |_, _| false), (true, 3));
        let kept = [(1, 7), (1, 9), (2, 3), (2, 7), (2, 9)];
        assert_eq!(prepared(&versions), kept, "the served epoch's stay");
    }

    #[test]
    fn slow_samplers_make_motion_coarser_and_not_slower() {
        let mut versions = versions();
        let mut served = Vec::new();
        for now in (0..4000).step_by(10) {
            versions.used([1], ms(now));
            // A sample takes 700 ms.
            let issued = versions.issued;
            if versions
                .advance(
                    (ms(now), LightLevel::Full),
                    [],
                    |_, _| ms(now).since(issued) >= Duration::from_millis(700),
                    |_, _| false,
                )
                .0
            {
                served.push((now, versions.served().state.epoch));
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
    fn while_one_epoch_is_distributed_only_the_next_is_rendered() {
        let mut versions = versions();
        versions.used([1], ms(0));
        assert_eq!(versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false), (true, 1));
        assert_eq!(
            versions.advance((ms(250), LightLevel::Full), [], |_, _| false, |_, _| false),
            (false, 0),
            "it is being rendered"
        );
        assert_eq!(
            versions.advance((ms(260), LightLevel::Full), [], |_, _| false, |_, _| true),
            (true, 1),
            "and now on its way"
        );
        assert_eq!(versions.advance((ms(400), LightLevel::Full), [], |_, _| false, |_, _| true), (false, 0));
        assert_eq!(prepared(&versions), [(1, 1), (2, 1)]);
        assert!(versions.advance((ms(450), LightLevel::Full), [], |v, _| v.state.epoch == 1, |_, _| false).0);
        assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
    }

    #[test]
    fn an_epoch_per_number_of_plans_is_issued_after_that_number() {
        let mut versions = versions().with_plans(3);
        versions.used([1], ms(100));
        versions.used([1], ms(200));
        assert_eq!(
            versions.advance((ms(300), LightLevel::Full), [], |_, _| true, |_, _| true),
            (true, 1),
            "the first one before any view"
        );
        assert_eq!(
            versions.advance((ms(420), LightLevel::Full), [], |_, _| true, |_, _| true),
            (true, 0),
            "two plans: none is issued"
        );
        versions.used([1], ms(430));
        assert_eq!(versions.advance((ms(440), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 1));
        assert_eq!(versions.advance((ms(600), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
        (0..30).for_each(|i| versions.used([1], ms(600 + i)));
        assert_eq!(versions.advance((ms(700), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 1));
        // Of nine missed epochs, one is made up for.
        let issued = (0..20)
            .filter(|i| {
                versions.advance((ms(750 + i * 20), LightLevel::Full), [], |_, _| true, |_, _| true).1 > 0
            })
            .count();
        assert_eq!(issued, 1);
    }

    #[test]
    fn new_viewpoints_do_not_hold_an_epoch_up() {
        let mut versions = versions();
        versions.used([0], ms(0));
        let mut changes = 0;
        for now in (100..3000).step_by(50) {
            versions.used([now], ms(now));
            // The samples wanted at the time of issue exist 50 ms later; later ones never do.
            changes += u64::from(
                versions
                    .advance(
                        (ms(now), LightLevel::Full),
                        [],
                        |v, camera| camera <= v.state.epoch * 100,
                        |_, _| false,
                    )
                    .0,
            );
        }
        assert!(
            changes > 25 && versions.served().state.epoch >= 27,
            "{changes}, epoch {}",
            versions.served().state.epoch
        );
    }

    #[test]
    fn an_epoch_whose_samples_never_come_is_served_when_patience_ends() {
        let mut versions = versions();
        versions.used([1, 2], ms(0));
        versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false);
        assert_eq!(
            versions.advance((ms(4000), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false),
            (false, 0)
        );
        assert_eq!(
            versions.advance((ms(8900), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false),
            (false, 0),
            "one came at 4 s"
        );
        assert!(versions.advance((ms(9000), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false).0);
        assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
    }

    #[test]
    fn without_views_no_epoch_is_issued_and_the_next_view_starts_one() {
        let mut versions = versions();
        assert_eq!(versions.advance((ms(700), LightLevel::Full), [], |_, _| true, |_, _| false), (false, 0));
        assert!(versions.wake(ms(750)));
        assert_eq!(versions.served().state.epoch, 7);
        versions.used([1], ms(750));
        assert!(!versions.wake(ms(790)), "a view came just now");
        assert_eq!(versions.advance((ms(850), LightLevel::Full), [], |_, _| true, |_, _| false), (true, 1));
        assert_eq!(versions.advance((ms(900), LightLevel::Full), [], |_, _| true, |_, _| false), (true, 0));
        assert_eq!(versions.served().state.epoch, 8);
        assert_eq!(
            versions.advance((ms(1800), LightLevel::Full), [], |_, _| true, |_, _| false),
            (false, 0),
            "the last view was a second ago"
        );
        assert!(versions.wake(ms(60_050)));
        assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (600, 8));
    }

    #[test]
    fn a_new_version_of_the_same_state_is_served_at_once() {
        let mut still =
            Versions::new(Version::default(), None, Duration::from_secs(1), Duration::from_secs(5));
        still.renew();
        assert_eq!((still.served(), still.oldest()), (Version::of_epoch(1, 0), Version::of_epoch(1, 0)));
        assert_eq!(still.live(), [Version::of_epoch(1, 0)], "older samples cannot be rendered again");

        let mut moving = versions();
        moving.used([7], ms(0));
        assert!(moving.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| true).0);
        assert!(moving.advance((ms(200), LightLevel::Full), [], |_, _| true, |_, _| false).0);
        let served = moving.served();
        moving.renew();
        assert_eq!(moving.served().state, served.state);
        assert!(moving.served().number > served.number, "{:?}", moving.served());
        let cameras: BTreeSet<u64> = moving.prepared().map(|(_, camera)| camera).collect();
        assert_eq!(cameras, BTreeSet::from([7]), "it is got ready for the same cameras");
        // Numbers ascend, whatever the versions show.
        moving.used([7], ms(300));
        assert!(moving.advance((ms(400), LightLevel::Full), [], |_, _| false, |_, _| false).0);
        let numbers: Vec<u64> = moving.live().iter().map(|version| version.number).collect();
        assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
    }

    #[test]
    fn better_light_is_a_version_that_is_served_once_its_samples_exist() {
        let first = Version { number: 0, state: SceneState { epoch: 0, light: LightLevel::Direct } };
        let mut still = Versions::new(first, None, Duration::from_secs(1), Duration::from_secs(5));
        let served = |versions: &Versions| (versions.served().number, versions.served().state.light);
        assert!(still.changes());
        assert_eq!(still.advance((ms(10), LightLevel::Direct), [3], |_, _| false, |_, _| false), (false, 0));
        assert_eq!(
            still.advance((ms(20), LightLevel::Coarse), [3, 4], |_, _| false, |_, _| false),
            (true, 2)
        );
        assert_eq!(prepared(&still), [(0, 3), (0, 4)]);
        assert_eq!(served(&still), (0, LightLevel::Direct), "its samples are being rendered");
        // Full light is ready meanwhile.
        assert_eq!(still.advance((ms(30), LightLevel::Full), [3], |_, _| false, |_, _| false), (false, 0));
        assert_eq!(still.advance((ms(40), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
        assert_eq!(served(&still), (1, LightLevel::Coarse));
        assert_eq!(still.advance((ms(41), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
        assert_eq!(served(&still), (2, LightLevel::Full), "no camera is in use");
        assert!(!still.changes(), "no better light will come");
        assert_eq!(still.advance((ms(50), LightLevel::Full), [3], |_, _| true, |_, _| true), (false, 0));
    }

    #[test]
    fn light_that_is_ready_at_once_skips_the_coarse_version() {
        let first = Version { number: 0, state: SceneState { epoch: 0, light: LightLevel::Direct } };
        let mut still = Versions::new(first, None, Duration::from_secs(1), Duration::from_secs(5));
        still.advance((ms(10), LightLevel::Full), [], |_, _| false, |_, _| false);
        still.advance((ms(20), LightLevel::Full), [], |_, _| false, |_, _| false);
        assert_eq!(still.served().state.light, LightLevel::Full);
        assert_eq!(still.served().number, 2, "full light has its number even if coarse light was skipped");
    }

    #[test]
    fn light_that_begins_coarse_stays_so() {
        let first = Version { number: 0, state: SceneState { epoch: 0, light: LightLevel::Coarse } };
        for every in [None, Some(DT)] {
            let mut versions = Versions::new(first, every, Duration::from_secs(1), Duration::from_secs(5));
            versions.used([1], ms(0));
            versions.advance((ms(500), LightLevel::Full), [], |_, _| true, |_, _| true);
            versions.advance((ms(600), LightLevel::Full), [], |_, _| true, |_, _| true);
            assert_eq!(versions.served().state.light, LightLevel::Coarse);
            assert_eq!(versions.changes(), every.is_some());
        }
    }
}
