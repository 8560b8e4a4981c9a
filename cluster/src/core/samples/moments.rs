//! What follows from the served version: which samples are prepared, which pins can be repeated, what may be
//! forgotten.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{
    FaceMask, FaceMasks, InvalidField, Plan, SampleId, SampleSetInfo, SceneState, Version, View,
};

use super::{NeededVersions, Samples};
use crate::core::event::WorkerId;
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// Samplers that may compose prefetch other samplers' samples only up to this number, over all versions.
const MOST_HELPED: usize = 64;

/// The result of advancing the versions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::core) struct Advanced {
    /// Whether another version is served or prepared.
    pub(in crate::core) changed: bool,
    /// Number of samples to render for the issued version.
    pub(in crate::core) ordered: usize,
}

impl Samples {
    /// Whether further versions will be served: the scene moves, or better light will come.
    pub(in crate::core) fn versions_change(&self) -> bool {
        self.versions.changes()
    }

    /// Serves a version of the present epoch for a new view, after a pause without views.
    pub(in crate::core) fn wake(&mut self, now: Uptime, needed: &NeededVersions) {
        if self.versions.wake(now) {
            self.serve_version(needed);
        }
    }

    /// Serves the next version once it is ready, and issues the one after it.
    pub(in crate::core) fn advance(
        &mut self,
        workers: &Workers,
        needed: &NeededVersions,
        now: Uptime,
    ) -> Advanced {
        if !self.versions.changes() {
            return Advanced::default();
        }
        let served = self.versions.served().number;
        // In a moving scene the versions know which cameras are in use.
        let used = self.recent.cameras().filter(|_| !self.versions.moves());
        let beside: Vec<u64> = self.placement.placed().chain(used).collect();
        let prepared = beside.iter().map(|&camera| (camera, self.faces_prepared(camera)));
        let prepared: FaceMasks = prepared.collect();
        let (locations, slow_workers) = (&self.locations, &mut self.slow_workers);
        let is_there = |version: Version, camera| {
            let next = SampleId { version: version.number, camera };
            let last = SampleId { version: served, ..next };
            let faces = prepared.of(camera);
            if locations.holders_of(next, faces).next().is_none() {
                return false;
            }
            // Workers that compose from the last version's sample got this one's.
            let waits = |worker: &WorkerId| {
                workers.get(*worker).is_some_and(Worker::takes_views)
                    && !locations.faces(last, *worker).is_empty()
                    && !locations.faces(next, *worker).contains(faces)
            };
            // Starts with the worker that waited the last time, since it probably still waits.
            if slow_workers.get(&camera).is_some_and(waits) {
                return false;
            }
            let waiting = locations.holders_of(last, FaceMask::NONE).find(waits);
            waiting.map(|worker| slow_workers.insert(camera, worker));
            waiting.is_none()
        };
        let is_rendered = |version: Version, camera| {
            let next = SampleId { version: version.number, camera };
            locations.holders_of(next, prepared.of(camera)).next().is_some()
        };
        let time_and_light = (now, workers.light());
        let (changed, ordered) = self.versions.advance(time_and_light, beside, is_there, is_rendered);
        if changed {
            self.serve_version(needed);
        }
        Advanced { changed, ordered }
    }

    /// Serves a version with other transforms of nodes. `kept`: the revisions that can still be shown. Returns the number of samples
    /// that show the state before.
    pub(in crate::core) fn move_nodes(
        &mut self,
        revision: u64,
        kept: impl IntoIterator<Item = u64>,
        needed: &NeededVersions,
    ) -> u64 {
        let stale = self.locations.held_of(self.versions.served().number);
        self.versions.move_nodes(revision, kept);
        self.serve_version(needed);
        stale
    }

    fn serve_version(&mut self, needed: &NeededVersions) {
        let version = self.versions.served();
        self.changed = true;
        if self.set.version != version {
            self.slow_workers.clear();
            self.set = Arc::new(SampleSetInfo { version, ..(*self.set).clone() });
            self.directory.retire(self.kept_from(needed));
        }
    }

    /// The oldest version whose samples workers keep.
    pub(super) fn kept_from(&self, needed: &NeededVersions) -> u64 {
        let oldest = self.versions.oldest().number;
        needed.oldest().map_or(oldest, |number| number.min(oldest))
    }

    /// The versions whose samples may be in assignments and orders.
    pub(in crate::core) fn live_versions(&self) -> Vec<Version> {
        self.versions.live()
    }

    /// Samples of prepared versions, each with the workers that compose from the same camera's sample already: they
    /// get it before views need it. So do samplers that may compose, since each renders only a part of the samples.
    pub(super) fn prepared(&self, workers: &Workers) -> Vec<(SampleId, Vec<WorkerId>)> {
        let served = self.versions.served().number;
        let few = self.versions.prepared().take(MOST_HELPED + 1).count() <= MOST_HELPED;
        let helpers = || workers.queues().samplers().iter().map(|entry| entry.worker);
        let helpers: BTreeSet<WorkerId> =
            if self.config.samplers_composite && few { helpers().collect() } else { BTreeSet::new() };
        let with_readers = |(version, camera): (Version, u64)| {
            let id = SampleId { version: version.number, camera };
            let last = SampleId { version: served, ..id };
            let of = |id| self.locations.holders_of(id, FaceMask::NONE);
            let holders = of(id).chain(of(last));
            let reads = |worker: &WorkerId| workers.get(*worker).is_some_and(Worker::takes_views);
            let readers: BTreeSet<WorkerId> = holders.filter(reads).chain(helpers.iter().copied()).collect();
            (id, readers.into_iter().collect())
        };
        self.versions.prepared().map(with_readers).collect()
    }

    /// Number of refinements that can be rendered in every epoch with a share of the samplers' time; unlimited in a
    /// still scene.
    pub(super) fn refinements_an_epoch(&self, share: f64, samplers: usize, sample_secs: f64) -> usize {
        if !self.versions.moves() || !(sample_secs > 0.0) {
            return usize::MAX;
        }
        (share * samplers as f64 * self.config.epoch.as_secs_f64() / sample_secs) as usize
    }

    /// Checks that a pinned state can be repeated. A view from triangles depends on its time alone. A view from
    /// samples needs those of a version that is still kept and shows that time.
    ///
    /// # Errors
    /// [`Fault::Pin`].
    pub(in crate::core) fn check_version(&self, view: &View) -> Result<(), Fault> {
        let Some(pin) = &view.pin else { return Ok(()) };
        // Versions between the two were skipped.
        let kept = [self.versions.oldest(), self.versions.served()];
        let are = |what: &str, numbers: [u64; 2]| match numbers {
            [older, served] if older < served => format!("{what}s {older} and {served} are"),
            [_, served] => format!("{what} {served} is"),
        };
        let epochs = kept.map(|version| version.state.epoch);
        let pinned = pin.state;
        let revisions = self.versions.revisions();
        if !revisions.contains(&pinned.revision) {
            let (asked, newest) = (pinned.revision, revisions.back().copied().unwrap_or_default());
            return Err(Fault::Pin(format!(
                "revision {asked} of the nodes' transforms is not kept here, the newest of {} is {newest}; set the \
                 transforms again, and pin the frame that shows them",
                revisions.len()
            )));
        }
        let direct = self.versions.moves() && !pin.plan.needs_samples();
        if !direct && !epochs.contains(&pinned.epoch) {
            let epochs = are("epoch", epochs);
            return Err(Fault::Pin(format!("epoch {} is not served here, {epochs}", pinned.epoch)));
        }
        let Plan::Warp(warp) = &pin.plan else { return Ok(()) };
        let shows = |number| kept.iter().find(|version| version.number == number).map(|v| v.state);
        match warp.samples.first().map(|id| (id.version, shows(id.version))) {
            Some((number, None)) => {
                let versions = are("version", kept.map(|version| version.number));
                Err(Fault::Pin(format!("version {number} is not served here, {versions}")))
            }
            Some((number, Some(SceneState { epoch, .. }))) if epoch != pinned.epoch => {
                let reason = format!("of version {number} show epoch {epoch}, not epoch {}", pinned.epoch);
                Err(InvalidField::new("pin.plan.warp.samples", reason).into())
            }
            Some((number, Some(SceneState { revision, .. }))) if revision != pinned.revision => {
                let reason =
                    format!("of version {number} show revision {revision}, not revision {}", pinned.revision);
                Err(InvalidField::new("pin.plan.warp.samples", reason).into())
            }
            Some((number, Some(SceneState { light, .. }))) if light != pinned.light => {
                let reason = format!("of version {number} show {light} light, not {} light", pinned.light);
                Err(InvalidField::new("pin.plan.warp.samples", reason).into())
            }
            _ => Ok(()),
        }
    }

    /// Serves a new version of the same state for samples that are rendered differently, since older ones may exist.
    /// Workers need no preparation for it.
    pub(super) fn renew(&mut self) -> Version {
        self.versions.renew();
        let version = self.versions.served();
        self.set = Arc::new(SampleSetInfo { version, ..(*self.set).clone() });
        self.slow_workers.clear();
        self.changed = true;
        version
    }
}
