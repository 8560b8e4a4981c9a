//! Views: admission, planning, dispatch and retries.
//!
//! This part reads `workers` and `samples` ([`Cluster`]) and changes neither. What a view means for them is returned
//! as [`Output`]s, which the machine applies.
//!
//! `admission` holds the limits of clients, and `new_view` admits views. [`plan`] makes the plan of an explicit
//! request. A request that leaves the way open gets the offer that [`super::market`] decides, among those that `open` collects.
//! `market` holds what decisions learn: prices, errors and accounts. `targets` handles bounds on the error.
//! `dispatch` gives views to the workers that `choose` picks, and `outcome` handles frames and failures.

mod admission;
mod cluster;
mod dispatch;
pub mod explicit_plan;
mod explicit_worker;
mod market;
mod new_view;
mod open;
mod open_view;
mod outcome;
mod output;
mod pending;
mod target_search;
mod targets;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use argus_proto::{Fault, v1};
use argus_scene::{Plan, Version};

pub(super) use cluster::Cluster;
pub(super) use new_view::NewView;
pub(super) use outcome::Answer;
pub(super) use output::Output;

use super::config::Config;
use super::event::{Client, ProbeResult, ViewId};
use super::market::Coming;
use super::quality::{Model, Pace};
use super::samples::NeededVersions;
use super::time::Uptime;
use admission::Admission;
use market::Market;
use pending::{InFlight, Pending, Waiting};

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
    /// Prices, errors, accounts and purchases.
    market: Market,
    /// Seconds of one process that all views asked for in a second, each from triangles, at the last tick.
    asked: f64,
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
            market: Market::new(config.smoothing),
            asked: 0.0,
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
    pub(super) fn tick(&mut self, cluster: Cluster<'_>, now: Uptime) {
        self.admission.prune(now);
        self.market.meet(cluster.workers);
        self.market.tick(cluster.answering() as u32);
        self.asked = self.market.time.asked_secs(now);
    }

    /// Seconds of one process that all views asked for in a second, each from triangles, at the last tick.
    pub(super) fn asked(&self) -> f64 {
        self.asked
    }

    /// Learns the first prices of workers.
    pub(super) fn meet(&mut self, cluster: Cluster<'_>) {
        self.market.meet(cluster.workers);
    }

    /// Learns from what a worker reported of its purchases and probes.
    pub(super) fn learn(&mut self, done: &[(Coming, f64)], probes: &[ProbeResult]) {
        done.iter().for_each(|(coming, secs)| self.market.learn_purchase(coming, *secs));
        probes.iter().for_each(|probe| self.market.learn_probe(probe));
    }

    /// The next source to buy, if one is worth its price.
    pub(super) fn purchase(&mut self, cluster: Cluster<'_>, now: Uptime) -> Option<Coming> {
        self.market.purchase(cluster, now)
    }

    /// A snapshot of the market, for people.
    pub(super) fn market_status(&self, cluster: Cluster<'_>, now: Uptime) -> v1::Market {
        self.market.status(cluster, now)
    }
}

#[cfg(test)]
impl Views {
    /// Sets K, for tests.
    pub(super) fn set_most_purchases(&mut self, most: u32) {
        self.market.set_most_purchases(most);
    }
}
