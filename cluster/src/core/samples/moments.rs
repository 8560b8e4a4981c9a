//! The version that is served, in what the rest of the core decides: whose samples are got ready, which pins can be
//! repeated, what may be forgotten.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{InvalidField, Plan, SampleId, SampleSetInfo, Version, View};

use super::{NeededVersions, Samples};
use crate::core::event::WorkerId;
use crate::core::time::Uptime;
use crate::core::workers::{Worker, Workers};

/// Samplers that may compose are sent what others render only where that is no more than this, all versions together.
const MOST_HELPED: usize = 64;

/// What became of the versions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::core) struct Advanced {
    /// Another version is served, or got ready.
    pub(in crate::core) changed: bool,
    /// Samples that are to be rendered for the version that was issued.
    pub(in crate::core) ordered: usize,
}

impl Samples {
    /// Whether the scene moves at all.
    pub(in crate::core) fn scene_moves(&self) -> bool {
        self.versions.moves()
    }

    /// A view is asked for: after a pause, it sees the scene as it is now.
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
        if !self.versions.moves() {
            return Advanced::default();
        }
        let (locations, laggards) = (&self.locations, &mut self.laggards);
        let served = self.versions.served().number;
        let is_there = |version: Version, camera| {
            let next = SampleId { version: version.number, camera };
            let last = SampleId { version: served, ..next };
            if !locations.is_held(next) {
                return false;
            }
            // Whoever composes from the last version's sample composes from this one's: it has been sent there.
            let waits = |worker: &WorkerId| {
                workers.get(*worker).is_some_and(Worker::takes_views)
                    && locations.has(last, *worker)
                    && !locations.has(next, *worker)
            };
            // The one that was seen to wait the last time probably still does.
            if laggards.get(&camera).is_some_and(waits) {
                return false;
            }
            let waiting = locations.holders(last).find(waits);
            waiting.map(|worker| laggards.insert(camera, worker));
            waiting.is_none()
        };
        let refined: Vec<u64> = self.placement.placed().collect();
        let is_rendered =
            |version: Version, camera| locations.is_held(SampleId { version: version.number, camera });
        let (changed, ordered) = self.versions.advance(now, refined, is_there, is_rendered);
        if changed {
            self.serve_version(needed);
        }
        Advanced { changed, ordered }
    }

    fn serve_version(&mut self, needed: &NeededVersions) {
        let version = self.versions.served();
        self.changed = true;
        if self.set.version != version {
            self.laggards.clear();
            self.set = Arc::new(SampleSetInfo { version, ..(*self.set).clone() });
            self.directory.retire(self.kept_from(needed));
        }
    }

    /// Samples of versions with a lower number are of no use to any worker.
    pub(super) fn kept_from(&self, needed: &NeededVersions) -> u64 {
        let oldest = self.versions.oldest().number;
        needed.oldest().map_or(oldest, |number| number.min(oldest))
    }

    /// What the versions show whose samples workers may be told of.
    pub(in crate::core) fn live_versions(&self) -> Vec<Version> {
        self.versions.live()
    }

    /// Samples that are got ready, and those that were and stay a while, each with the workers that compose from the
    /// same camera's already, or did: they shall have it before views ask for it. So shall samplers that may compose,
    /// each of which renders but a part of them.
    pub(super) fn prepared(&self, workers: &Workers) -> Vec<(SampleId, Vec<WorkerId>)> {
        let served = self.versions.served().number;
        let few = self.versions.prepared().take(MOST_HELPED + 1).count() <= MOST_HELPED;
        let helpers = || workers.queues().samplers().iter().map(|entry| entry.worker);
        let helpers: BTreeSet<WorkerId> =
            if self.config.samplers_composite && few { helpers().collect() } else { BTreeSet::new() };
        let with_readers = |(version, camera): (Version, u64)| {
            let id = SampleId { version: version.number, camera };
            let last = SampleId { version: served, ..id };
            let holders = self.locations.holders(id).chain(self.locations.holders(last));
            let reads = |worker: &WorkerId| workers.get(*worker).is_some_and(Worker::takes_views);
            let readers: BTreeSet<WorkerId> = holders.filter(reads).chain(helpers.iter().copied()).collect();
            (id, readers.into_iter().collect())
        };
        self.versions.prepared().map(with_readers).collect()
    }

    /// How many refinements can be rendered anew in every epoch with a share of the samplers' time; any number
    /// where the scene stands still.
    pub(super) fn refinements_an_epoch(&self, share: f64, samplers: usize, sample_secs: f64) -> usize {
        if !self.versions.moves() || !(sample_secs > 0.0) {
            return usize::MAX;
        }
        (share * samplers as f64 * self.config.epoch.as_secs_f64() / sample_secs) as usize
    }

    /// Whether what a pin shows can be repeated: a view from triangles is a function of its time alone, one from samples needs
    /// those of a version that is still kept and shows that time.
    ///
    /// # Errors
    /// [`Fault::Pin`].
    pub(in crate::core) fn check_version(&self, view: &View) -> Result<(), Fault> {
        let Some(pin) = &view.pin else { return Ok(()) };
        // Versions between the two were passed over.
        let kept = [self.versions.oldest(), self.versions.served()];
        let are = |what: &str, numbers: [u64; 2]| match numbers {
            [older, served] if older < served => format!("{what}s {older} and {served} are"),
            [_, served] => format!("{what} {served} is"),
        };
        let epochs = kept.map(|version| version.state.epoch);
        let direct = self.versions.moves() && matches!(pin.plan, Plan::Direct { .. });
        if !direct && !epochs.contains(&pin.epoch) {
            let epochs = are("epoch", epochs);
            return Err(Fault::Pin(format!("epoch {} is not served here, {epochs}", pin.epoch)));
        }
        let Plan::Warp(warp) = &pin.plan else { return Ok(()) };
        let shows = |number| kept.iter().find(|version| version.number == number).map(|v| v.state.epoch);
        match warp.samples.first().map(|id| (id.version, shows(id.version))) {
            Some((number, None)) => {
                let versions = are("version", kept.map(|version| version.number));
                Err(Fault::Pin(format!("version {number} is not served here, {versions}")))
            }
            Some((number, Some(epoch))) if epoch != pin.epoch => {
                let reason = format!("of version {number} show epoch {epoch}, not epoch {}", pin.epoch);
                Err(InvalidField::new("pin.plan.warp.samples", reason).into())
            }
            _ => Ok(()),
        }
    }

    /// Serves samples that are rendered otherwise as a new version of the same state, since samples of the present one may
    /// exist. No worker has to get ready for it.
    pub(super) fn renew(&mut self) -> Version {
        self.versions.renew();
        let version = self.versions.served();
        self.set = Arc::new(SampleSetInfo { version, ..(*self.set).clone() });
        self.laggards.clear();
        self.changed = true;
        version
    }
}
