//! Samples: where they are, which are rendered, and how they reach compositors.
//!
//! This part reads `workers` and nothing of views: what views requested, used and lacked are arguments. Its decisions
//! are returned: prefetch lists, where a worker finds a view's samples, how many samples are to be rendered.
//!
//! `locations` tracks which workers hold which sample, `directory` which one renders it, and `distribution` how it
//! reaches other workers. `cameras` chooses the rig's cameras for a viewpoint. `placement` decides where explicit views lack samples,
//! `copies` which ones get a second copy, and `refine` makes the prefetch lists. `versions` tracks which version is
//! served, and `moments` what follows from it.

mod cameras;
mod copies;
mod directory;
mod distribution;
mod find;
mod locations;
mod moments;
mod needed;
mod placement;
mod recent_use;
mod refine;
mod versions;

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use argus_scene::rig::VisibilityQuery;
use argus_scene::{Camera, FaceMask, SampleId, SampleSetInfo, Version, Visibility};

pub(super) use cameras::MOST_SAMPLES;
pub(super) use find::Access;
pub(super) use locations::{Reported, SampleLocations};
pub(super) use needed::NeededVersions;
pub(super) use placement::Placement;

use super::config::Config;
use super::event::{Source, WorkerId};
use super::market::Pool;
use super::time::Uptime;
use super::workers::{SampleCounts, Worker, Workers};
use cameras::Cameras;
use directory::Directory;
use distribution::DistributionTrees;
use recent_use::RecentUse;
use versions::Versions;

/// The samples of one sample set.
#[derive(Debug)]
pub(super) struct Samples {
    config: Arc<Config>,
    /// The sample set, in the served version.
    set: Arc<SampleSetInfo>,
    cameras: Cameras,
    locations: SampleLocations,
    directory: Directory,
    trees: DistributionTrees,
    placement: Placement,
    recent: RecentUse,
    /// Sources that views are warped from.
    pool: Pool,
    versions: Versions,
    /// By camera: a worker that composes from the last version's sample and lacks the next one's.
    slow_workers: BTreeMap<u64, WorkerId>,
    /// Whether prefetch lists may have changed.
    changed: bool,
}

impl Samples {
    /// Starts without samples, at the set's version.
    pub(super) fn new(config: &Arc<Config>, set: Arc<SampleSetInfo>) -> Self {
        let every = (set.epoch_secs > 0.0).then_some(config.epoch);
        let versions = Versions::new(set.version, every, config.epoch_interest, config.epoch_patience)
            .with_plans(config.refresh_views);
        let mut samples = Self {
            config: config.clone(),
            set,
            cameras: Cameras::default(),
            locations: SampleLocations::default(),
            directory: Directory::default(),
            trees: DistributionTrees::default(),
            placement: Placement::default(),
            recent: RecentUse::default(),
            pool: Pool::default(),
            versions,
            slow_workers: BTreeMap::new(),
            changed: false,
        };
        if let Some(visibility) = config.visibility {
            samples.see_by(visibility);
        }
        samples
    }

    /// Sets the ray queries by which cameras are chosen; `None`: by distance.
    pub(super) fn plan_by(&mut self, sight: Option<Arc<dyn VisibilityQuery>>) {
        self.cameras = Cameras::new(sight);
    }

    /// Sets the visibility backend of all samples. If workers joined with samples of another backend, samples are of
    /// a new version from now on, which is returned.
    pub(super) fn see_by(&mut self, visibility: Visibility) -> Option<Version> {
        let others_exist = visibility != self.set.visibility && self.locations.holds_any();
        self.set = Arc::new(SampleSetInfo { visibility, ..(*self.set).clone() });
        others_exist.then(|| self.renew())
    }

    /// The sample set, in the served version.
    pub(super) fn set(&self) -> &Arc<SampleSetInfo> {
        &self.set
    }

    /// The ray queries by which cameras are chosen, if there are any.
    pub(super) fn sight(&self) -> Option<&dyn VisibilityQuery> {
        self.cameras.sight()
    }

    /// Which workers hold which sample.
    pub(super) fn locations(&self) -> &SampleLocations {
        &self.locations
    }

    /// Samples at refinements of the rig.
    pub(super) fn placement(&self) -> &Placement {
        &self.placement
    }

    /// The sample of a camera in the served version.
    pub(super) fn served(&self, camera: u64) -> SampleId {
        SampleId { version: self.set.version.number, camera }
    }

    /// The best samples of a version for a viewpoint, best first.
    pub(super) fn sample_ids(&self, camera: &Camera, count: usize, version: u64) -> Vec<SampleId> {
        self.sample_ids_among(camera, count, version, self.placement.usable())
    }

    /// The best samples of a version for a viewpoint, among the rig's own cameras and these refinements.
    pub(super) fn sample_ids_among(
        &self,
        camera: &Camera,
        count: usize,
        version: u64,
        refined: &[u64],
    ) -> Vec<SampleId> {
        let indices = self.cameras.best(&self.set.rig, camera, count, refined).into_iter();
        self.set.with_reflection_probes(indices.map(|camera| SampleId { version, camera }).collect())
    }

    /// Whether a sampler must still render a sample of such a camera.
    pub(super) fn has_to_render(&self, sampler: WorkerId, such: impl Fn(u64) -> bool) -> bool {
        let mut to_render = self.locations.to_render();
        to_render.any(|id| such(id.camera) && self.directory.is_owner(sampler, id))
    }

    /// Whether a worker still renders samples of its prefetch list, for which no view waits.
    pub(super) fn is_refining(&self, worker: &Worker) -> bool {
        let lacks = |source: &Source| !self.locations.faces(source.id, worker.id()).contains(source.faces);
        worker.assigned().prefetch.iter().any(|source| source.addresses.is_empty() && lacks(source))
    }

    /// The level of the rig's cameras that serve a viewpoint.
    pub(super) fn own_level(&self, camera: &Camera) -> i32 {
        self.cameras.own_level(&self.set.rig, camera)
    }

    /// Whether a plan for a viewer with this own level could be made without a sample. Refinements are used if they are held,
    /// and are rendered when no view waits. In a moving scene they come with each version like all samples.
    pub(super) fn is_dispensable(&self, id: SampleId, own_level: i32) -> bool {
        self.set.epoch_secs == 0.0 && self.set.rig.level(id.camera) > Some(own_level.max(0) as u32)
    }

    /// The samples that each worker would lose by another role.
    pub(super) fn sample_counts(&self) -> HashMap<WorkerId, SampleCounts> {
        let held = self.locations.holdings().map(|(worker, held)| (worker, SampleCounts { held, owned: 0 }));
        let mut sample_counts: HashMap<WorkerId, SampleCounts> = held.collect();
        for (worker, owned) in self.directory.owned() {
            sample_counts.entry(worker).or_default().owned = owned;
        }
        sample_counts
    }

    /// Whether prefetch lists may have changed.
    pub(super) fn has_changed(&self) -> bool {
        self.changed
    }

    /// Processes the samples that a worker reports, and those that it reported before. Returns whether there are new
    /// ones.
    pub(super) fn reported(&mut self, worker: WorkerId, held: Reported<'_>, before: Reported<'_>) -> bool {
        let news = self.locations.reported(worker, held, before);
        self.changed |= news;
        news
    }

    /// Records that a view that needs these samples was sent to a worker.
    pub(super) fn begin(&mut self, worker: WorkerId, samples: impl Iterator<Item = SampleId>) {
        self.locations.begin(worker, samples);
    }

    /// Records that a view left a worker. A worker that answered it holds its samples.
    pub(super) fn end(&mut self, worker: WorkerId, samples: &[(SampleId, FaceMask)], answered: bool) {
        self.locations.end(worker, samples, answered);
    }

    /// Forgets a lost worker and its samples.
    pub(super) fn forget(&mut self, worker: WorkerId) {
        self.locations.forget(worker);
        self.trees.forget(worker);
        self.pool.forget(worker);
    }

    /// Learns the holes of a view that used the samples of these cameras.
    pub(super) fn learn_holes(&mut self, camera: &Camera, used: &[u64], uncovered: u64, pixels: u64) {
        let rig = (&self.set.rig, self.cameras.sight());
        self.placement.learn(rig, camera, used, uncovered, pixels);
    }

    /// Closes a tick: places samples where views lack them, and forgets unneeded ones. Returns the number of samples to render.
    pub(super) fn tick(&mut self, workers: &Workers, ticks: f64, now: Uptime) -> usize {
        let placed = self.place(workers, ticks);
        self.directory.prune(&self.locations, now);
        self.changed = true;
        placed
    }

    /// Sources that views are warped from.
    pub(super) fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Sources that views are warped from, to be changed.
    pub(super) fn pool_mut(&mut self) -> &mut Pool {
        &mut self.pool
    }
}
