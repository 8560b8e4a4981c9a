//! Views: admission, planning, dispatch and retries.
//!
//! This part reads `workers` and `samples` ([`Cluster`]) and changes neither. What a view means for them is returned
//! as [`Output`]s, which the machine applies.
//!
//! `admission` holds the limits of clients, and `new_view` admits views. [`plan`] makes the plan of an explicit
//! request. [`planner`] chooses the plan of a request that leaves the way open, among the offers that `open`
//! collects, those of `frames` among them, and in the time that `load` leaves; `session_memory` compares them with the
//! session's last view. `batch` plans the views of a batch together. `targets` handles bounds on the error.
//! `dispatch` gives views to the workers that `choose` picks, and `outcome` handles frames and failures.

mod admission;
mod batch;
mod cluster;
mod dispatch;
mod estimate_request;
pub mod explicit_plan;
mod explicit_worker;
mod frames;
mod load;
mod new_view;
mod open;
mod open_view;
mod outcome;
mod output;
mod pending;
pub mod planner;
mod session_memory;
mod target_search;
mod targets;

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::rig::CoverageEstimate;
use argus_scene::{Plan, Version, View};

pub(super) use cluster::Cluster;
pub use estimate_request::EstimateRequest;
pub(super) use new_view::NewView;
pub(super) use outcome::Answer;
pub(super) use output::Output;

use super::config::Config;
use super::event::{Client, ViewId};
use super::quality::{Model, Pace};
use super::samples::NeededVersions;
use super::time::Uptime;
use admission::Admission;
use load::Load;
use pending::{InFlight, Pending, Waiting};

/// Most estimates for camera sets in a tick. Each stands for the views since the last one.
const MOST_CAMERA_SET_ESTIMATES: u32 = 8;

/// Counts of views since the coordinator started.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ViewCounts {
    /// Views whose client got the whole frame.
    pub(super) answered: u64,
    /// Views that ended with a fault other than overload.
    pub(super) failed: u64,
    /// Views refused because of overload.
    pub(super) rejected: u64,
    /// Attempts by another worker, after one failed.
    pub(super) retried: u64,
    /// Session cameras that were superseded before they were rendered.
    pub(super) superseded: u64,
    /// Frames that were rejected because of their error.
    pub(super) frames_refused: u64,
}

/// What views ask of the cluster, in processes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pressure {
    /// By all views, each by its cheapest way within its bound.
    pub(super) asked: f64,
    /// By open views, beyond what is carried.
    pub(super) lacking: f64,
    /// Whether something is lacking, and the workers that do not sample carry all views in some way: then samplers may leave views
    /// to them.
    pub(super) others_carry: bool,
}

/// All open views, and the usage of clients.
#[derive(Debug)]
pub(super) struct Views {
    config: Arc<Config>,
    views: BTreeMap<ViewId, Pending>,
    admission: Admission,
    in_flight: InFlight,
    /// Views that wait for a worker with room.
    waiting: Waiting,
    /// The times at which deadlines and patience end, in order.
    due: BTreeSet<(Uptime, ViewId)>,
    /// Calibrated models of the scene, one for each kind of device; empty without calibration.
    models: Vec<Arc<Model>>,
    /// Corrections of the models' costs.
    pace: Pace,
    /// Estimates for camera sets that are left in this tick.
    camera_set_estimates_left: Cell<u32>,
    /// Views from triangles since the last estimate for a camera set.
    without_estimate: u32,
    /// What is asked of the cluster.
    load: Load,
    /// What was asked of it, and lacking, at the last tick.
    pressure: Pressure,
    /// Whether new views are refused.
    draining: bool,
    counts: ViewCounts,
}

impl Views {
    /// No views yet.
    pub(super) fn new(config: &Arc<Config>) -> Self {
        Self {
            views: BTreeMap::new(),
            admission: Admission::default(),
            in_flight: InFlight::default(),
            waiting: Waiting::default(),
            due: BTreeSet::new(),
            models: Vec::new(),
            pace: Pace::new(config.smoothing),
            camera_set_estimates_left: Cell::default(),
            without_estimate: 0,
            load: Load::default(),
            pressure: Pressure::default(),
            draining: false,
            counts: ViewCounts::default(),
            config: config.clone(),
        }
    }

    /// Sets the calibrated models of the scene.
    pub(super) fn learn_models(&mut self, models: Vec<Model>) {
        self.models = models.into_iter().map(Into::into).collect();
    }

    /// Number of views waiting or in work.
    pub(super) fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether a view is waiting or in work.
    pub(super) fn is_open(&self, view_id: ViewId) -> bool {
        self.views.contains_key(&view_id)
    }

    /// Moves waiting views to a new version, since samples are rendered differently from now on. Pinned views stay.
    pub(in crate::core) fn move_waiting(&mut self, version: Version) {
        for view in self.views.values_mut().filter(|view| view.worker.is_none() && !view.pinned) {
            self.in_flight.subtract(view);
            if let Plan::Warp(warp) = &mut view.plan {
                warp.samples.iter_mut().for_each(|id| id.version = version.number);
            }
            view.version = version;
            self.in_flight.add(view);
        }
    }

    /// The versions whose samples are needed by views in flight.
    pub(super) fn needed_versions(&self) -> &NeededVersions {
        self.in_flight.needed()
    }

    /// Whether a view waits that can only be made from samples.
    pub(super) fn want_samples(&self) -> bool {
        !self.waiting.composed.is_empty()
    }

    /// Pixels of the largest view in flight, with sub-pixels.
    pub(super) fn largest(&self) -> u64 {
        self.views.values().map(Pending::work).max().unwrap_or(0)
    }

    /// The counts so far.
    pub(super) fn counts(&self) -> ViewCounts {
        self.counts
    }

    /// Refuses new views from now on.
    pub(super) fn drain(&mut self) {
        self.draining = true;
    }

    /// Whether new views are refused because the process shuts down.
    pub(super) fn is_draining(&self) -> bool {
        self.draining
    }

    /// Checks whether a client may open a session.
    ///
    /// # Errors
    /// [`Fault::Overloaded`], [`Fault::Unavailable`].
    pub(super) fn check_session(&self, client: &str) -> Result<(), Fault> {
        match self.draining {
            true => Err(Fault::Unavailable("the coordinator is shutting down".to_owned())),
            false => self.admission.check_session(client, &self.config),
        }
    }

    /// Counts a session that a client opened.
    pub(super) fn open_session(&mut self, client: &Client) {
        self.admission.open_session(client);
    }

    /// Uncounts a session that ended.
    pub(super) fn close_session(&mut self, client: &str) {
        self.admission.close_session(client);
    }

    /// Number of open sessions.
    pub(super) fn sessions(&self) -> usize {
        self.admission.sessions()
    }

    /// Counts a superseded camera of a session.
    pub(super) fn camera_superseded(&mut self) {
        self.counts.superseded += 1;
    }

    /// Ends a tick.
    pub(super) fn tick(&mut self, cluster: Cluster<'_>, now: Uptime) -> Pressure {
        self.camera_set_estimates_left.set(MOST_CAMERA_SET_ESTIMATES);
        self.admission.prune(now);
        let lacking = self.load.lacking(cluster.answering(), now);
        let others_carry = lacking > 0.0 && self.load.is_carried_somehow(cluster.without_samplers(), now);
        self.pressure = Pressure { asked: self.load.asked(now), lacking, others_carry };
        self.pressure
    }

    /// What was asked of the cluster, and lacking, at the last tick.
    pub(super) fn pressure(&self) -> Pressure {
        self.pressure
    }

    /// The estimate that tells which camera set would have served a view. `None` for most views: a few per tick
    /// are enough.
    pub(super) fn camera_set_estimate_wanted(
        &self,
        view: &View,
        cluster: Cluster<'_>,
    ) -> Option<EstimateRequest> {
        let left = self.camera_set_estimates_left.get().checked_sub(1)?;
        let wanted = cluster.camera_set_estimate_wanted(view)?;
        self.camera_set_estimates_left.set(left);
        Some(wanted)
    }

    /// Processes an estimate for a camera set. `pixels` counts sub-pixels. The camera set would have saved time for this view
    /// and for the similar ones since the last estimate.
    pub(super) fn learn_camera_set_estimate(
        &mut self,
        pixels: u64,
        estimate: &CoverageEstimate,
        cluster: Cluster<'_>,
    ) -> Option<Output> {
        let saved_secs = cluster.saved_secs(pixels)?;
        let views = f64::from(std::mem::take(&mut self.without_estimate));
        let cameras = cluster.camera_set(estimate)?;
        Some(Output::WouldSave { cameras, secs: views * saved_secs })
    }
}
