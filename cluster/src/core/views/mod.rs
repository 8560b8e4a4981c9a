//! Views on their way: admitted or turned away, planned, given to a worker, and given to another if that one fails.
//!
//! This part reads `workers` and `samples` ([`Cluster`]) and changes neither. What follows from a view for them is
//! returned as [`Output`]s, which the machine passes on.
//!
//! `admission` keeps what clients may ask for. [`plan`] says how a view is answered whose request names that, [`planner`]
//! how one is whose request leaves it open, by the offers that `open` collects; `session_memory` weighs them against the
//! session's last view. `targets` says what becomes of requests with
//! a bound on the error. `new_view` lets views in, `dispatch` gives them to the workers that `choose` picks, and `outcome` says
//! what becomes of frames and failures.

mod admission;
mod choose;
mod cluster;
mod dispatch;
mod output;
mod new_view;
mod open;
mod open_view;
mod outcome;
mod pending;
pub mod plan;
pub mod planner;
mod session_memory;
mod survey;
mod target_search;
mod targets;

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::rig::Survey;
use argus_scene::{Plan, Version, View};

pub(super) use cluster::Cluster;
pub(super) use output::Output;
pub(super) use new_view::NewView;
pub use survey::SurveyWanted;

use super::config::Config;
use super::event::{Client, ViewId};
use super::quality::{Model, Pace};
use super::samples::NeededVersions;
use super::time::Uptime;
use admission::Admission;
use pending::{InFlight, Pending, Waiting};

/// Views a tick of demand that are looked at to see which samples would be worth their price: that changes slowly.
const MOST_BUNDLE_SURVEYS: u32 = 4;

/// What happened to views since the coordinator started.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ViewCounts {
    /// Those whose frame was relayed whole.
    pub(super) answered: u64,
    /// Those that ended with a fault other than overload.
    pub(super) failed: u64,
    /// Those turned away because of overload.
    pub(super) rejected: u64,
    /// Those sent to another worker after the first one failed.
    pub(super) retried: u64,
    /// Session cameras that a newer one overtook before they were rendered.
    pub(super) superseded: u64,
    /// Frames that were thrown away because they were not good enough for their request.
    pub(super) frames_refused: u64,
}

/// All views that were admitted and are not over, and what clients have of what they may.
#[derive(Debug)]
pub(super) struct Views {
    config: Arc<Config>,
    views: BTreeMap<ViewId, Pending>,
    admission: Admission,
    in_flight: InFlight,
    /// Views that no worker has room for yet.
    waiting: Waiting,
    /// When which view's deadline or patience is over.
    due: BTreeSet<(Uptime, ViewId)>,
    /// What calibration measured of the scene, of each kind of device; none where it was not calibrated.
    models: Vec<Arc<Model>>,
    /// How costs differ from what the models say.
    pace: Pace,
    /// Views that may still be looked at to see which samples are worth their price, in the tick that runs.
    bundle_surveys_left: Cell<u32>,
    /// Views from triangles since the last one that was looked at.
    unsurveyed: u32,
    /// No new views.
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
            bundle_surveys_left: Cell::default(),
            unsurveyed: 0,
            draining: false,
            counts: ViewCounts::default(),
            config: config.clone(),
        }
    }

    /// What calibration measured of the scene that is served.
    pub(super) fn learn_models(&mut self, models: Vec<Model>) {
        self.models = models.into_iter().map(Into::into).collect();
    }

    /// Views waiting or in work.
    pub(super) fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether that view waits or is in work.
    pub(super) fn is_open(&self, view_id: ViewId) -> bool {
        self.views.contains_key(&view_id)
    }

    /// Samples are rendered otherwise from now on: views that wait are made of the new version, unless they are pinned.
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

    /// The versions whose samples views in flight need.
    pub(super) fn needed_versions(&self) -> &NeededVersions {
        self.in_flight.needed()
    }

    /// Whether a view waits that is made from samples and from nothing else.
    pub(super) fn want_samples(&self) -> bool {
        !self.waiting.composed.is_empty()
    }

    /// Pixels that are rendered for the largest view in flight, sub-pixels counted.
    pub(super) fn largest(&self) -> u64 {
        self.views.values().map(Pending::work).max().unwrap_or(0)
    }

    /// What happened to views so far.
    pub(super) fn counts(&self) -> ViewCounts {
        self.counts
    }

    /// New views are turned away from here on.
    pub(super) fn drain(&mut self) {
        self.draining = true;
    }

    /// Whether new views are turned away since the process is about to end.
    pub(super) fn is_draining(&self) -> bool {
        self.draining
    }

    /// Whether that client may open a session now.
    ///
    /// # Errors
    /// [`Fault::Overloaded`], [`Fault::Unavailable`].
    pub(super) fn check_session(&self, client: &str) -> Result<(), Fault> {
        match self.draining {
            true => Err(Fault::Unavailable("the coordinator is shutting down".to_owned())),
            false => self.admission.check_session(client, &self.config),
        }
    }

    /// A client opened a session.
    pub(super) fn open_session(&mut self, client: &Client) {
        self.admission.open_session(client);
    }

    /// A client's session ended.
    pub(super) fn close_session(&mut self, client: &str) {
        self.admission.close_session(client);
    }

    /// Sessions that are open.
    pub(super) fn sessions(&self) -> usize {
        self.admission.sessions()
    }

    /// A session's camera was overtaken by a newer one before it was rendered.
    pub(super) fn camera_superseded(&mut self) {
        self.counts.superseded += 1;
    }

    /// A tick has passed.
    pub(super) fn tick(&mut self, now: Uptime) {
        self.bundle_surveys_left.set(MOST_BUNDLE_SURVEYS);
        self.admission.prune(now);
    }

    /// What is to be found out about a view, while no client waits for it, to see which samples would be worth their price.
    /// `None` for most views: a few a second tell enough.
    pub(super) fn bundle_survey_wanted(&self, view: &View, cluster: Cluster<'_>) -> Option<SurveyWanted> {
        let left = self.bundle_surveys_left.get().checked_sub(1)?;
        let wanted = cluster.bundle_survey_wanted(view)?;
        self.bundle_surveys_left.set(left);
        Some(wanted)
    }

    /// What a view of so many pixels, sub-pixels counted, shows is known: its bundle would have saved some time of that
    /// view, and of those like it since the last one that was looked at.
    pub(super) fn learn_bundle_survey(
        &mut self,
        pixels: u64,
        survey: &Survey,
        cluster: Cluster<'_>,
    ) -> Option<Output> {
        let saved_secs = cluster.saved_secs(pixels)?;
        let views = f64::from(std::mem::take(&mut self.unsurveyed));
        let cameras = cluster.bundle(survey)?;
        Some(Output::WouldSave { cameras, secs: views * saved_secs })
    }
}
