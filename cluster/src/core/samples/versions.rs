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
    /// Revisions of the nodes' transforms that can still be shown, oldest first.
    revisions: VecDeque<u64>,
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
            revisions: VecDeque::from([0]),
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

    /// Serves a version with other transforms of nodes from now on: views do not wait until samples show them. Versions in
    /// preparation would show earlier ones, and are dropped. `kept`: the revisions that can still be shown.
    pub(super) fn move_nodes(&mut self, revision: u64, kept: impl IntoIterator<Item = u64>) {
        let version = self.issue(SceneState { revision, ..self.served.version.state });
        self.upcoming.clear();
        self.serve(Prepared { version, cameras: BTreeSet::new() });
        self.revisions = kept.into_iter().collect();
    }

    /// The revisions of the nodes' transforms that can still be shown, oldest first.
    pub(super) fn revisions(&self) -> &VecDeque<u64> {
        &self.revisions
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
mod tests;
