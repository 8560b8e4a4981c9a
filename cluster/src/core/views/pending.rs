//! Views that were admitted: what each one is, the queues in which those wait that no worker has room for yet, and how
//! many there are of each kind.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_scene::{Camera, Holes, Plan, Prediction, SampleId, Version};

use super::open_view::OpenView;
use super::target_search::TargetSearch;
use crate::core::event::{Client, ViewId, WorkerId};
use crate::core::samples::NeededVersions;
use crate::core::time::Uptime;
use crate::core::workers::WorkKind;

/// An admitted view.
#[derive(Debug, Clone)]
pub(super) struct Pending {
    pub(super) client: Client,
    pub(super) camera: Camera,
    /// How many the frame has.
    pub(super) pixels: u64,
    pub(super) version: Version,
    /// How it is answered; of a view whose way is open, how it was last decided to be.
    pub(super) plan: Plan,
    /// What the planner goes by, if the request leaves the way open.
    pub(super) open: Option<Box<OpenView>>,
    /// What is expected of its frame.
    pub(super) expected: Option<Prediction>,
    /// The search for a frame within a bound.
    pub(super) target_search: Option<Box<TargetSearch>>,
    /// Its plan was pinned: what it lacks says nothing of the plans made here.
    pub(super) pinned: bool,
    /// Pinned kind of device; empty: any.
    pub(super) device: String,
    /// When its answer is worthless, and how long that was when it was asked.
    pub(super) deadline: (Uptime, Duration),
    pub(super) requested: Uptime,
    /// When it is looked at next, to see whether its time is over.
    pub(super) due: Uptime,
    pub(super) attempt: u32,
    pub(super) worker: Option<WorkerId>,
    pub(super) tried: BTreeSet<WorkerId>,
}

/// Lines whose first view holds the others up.
pub(super) const BLOCKING_QUEUES: usize = 3;

/// Views that no worker has room for yet. Tickets ascend with arrival, so the least is the oldest.
#[derive(Debug, Clone, Default)]
pub(super) struct Waiting {
    pub(super) composed: BTreeSet<ViewId>,
    pub(super) direct: BTreeSet<ViewId>,
    /// Those that any worker can answer, in one way or another.
    pub(super) open: BTreeSet<ViewId>,
    /// Those that only certain workers can answer: they hold nobody up.
    pub(super) bound: BTreeSet<ViewId>,
}

impl Waiting {
    pub(super) fn insert(&mut self, view_id: ViewId, view: &Pending) {
        let queue = match (view.is_bound(), view.open.is_some(), view.is_direct()) {
            (true, ..) => &mut self.bound,
            (_, true, _) => &mut self.open,
            (.., true) => &mut self.direct,
            _ => &mut self.composed,
        };
        queue.insert(view_id);
    }

    /// The oldest view that waits, leaving out the queues that are `full`; and its queue.
    pub(super) fn first(&self, full: &[bool; BLOCKING_QUEUES]) -> Option<(ViewId, usize)> {
        let queues = [&self.direct, &self.composed, &self.open];
        let first = |queue: usize| queues[queue].first().map(|view_id| (*view_id, queue));
        (0..BLOCKING_QUEUES).filter(|queue| !full[*queue]).filter_map(first).min()
    }

    pub(super) fn remove(&mut self, view_id: ViewId) {
        for queue in [&mut self.composed, &mut self.direct, &mut self.open, &mut self.bound] {
            queue.remove(&view_id);
        }
    }
}

/// Views in flight of each kind, and the versions whose samples they need, each with how many need it.
#[derive(Debug, Clone, Default)]
pub(super) struct InFlight {
    pub(super) direct: usize,
    pub(super) composed: usize,
    /// Those whose way is open.
    pub(super) open: usize,
    needed: NeededVersions,
}

impl InFlight {
    pub(super) fn add(&mut self, view: &Pending) {
        *self.kind(view) += 1;
        if let Some(version) = view.sampled_version() {
            self.needed.add(version);
        }
    }

    pub(super) fn subtract(&mut self, view: &Pending) {
        *self.kind(view) -= 1;
        if let Some(version) = view.sampled_version() {
            self.needed.subtract(version);
        }
    }

    fn kind(&mut self, view: &Pending) -> &mut usize {
        match (view.open.is_some(), view.is_direct()) {
            (true, _) => &mut self.open,
            (_, true) => &mut self.direct,
            _ => &mut self.composed,
        }
    }

    /// The versions whose samples views in flight need.
    pub(super) fn needed(&self) -> &NeededVersions {
        &self.needed
    }
}

/// What is rendered for a pixel.
pub(super) fn sub_pixels(plan: &Plan) -> u64 {
    match plan {
        Plan::Direct { samples_per_pixel } => u64::from(*samples_per_pixel),
        Plan::Warp(warp) => u64::from(warp.supersampling).pow(2),
    }
}

impl Pending {
    /// Its frame was not good enough: another is made, by whomever.
    pub(super) fn begin_again(&mut self, plan: Plan, expected: Prediction, target_search: Box<TargetSearch>) {
        (self.plan, self.expected, self.target_search) = (plan, Some(expected), Some(target_search));
        (self.worker, self.tried) = (None, BTreeSet::new());
    }

    /// Attempts that failed, or are in work: without those whose frame was thrown away.
    pub(super) fn attempts(&self) -> u32 {
        self.attempt - self.target_search.as_ref().map_or(0, |target_search| target_search.thrown_away())
    }

    /// Whether not just anybody can answer it.
    pub(super) fn is_bound(&self) -> bool {
        !self.device.is_empty() || !self.tried.is_empty()
    }

    /// What it is counted as where its request says how it is answered.
    pub(super) fn kind(&self) -> WorkKind {
        if self.is_direct() { WorkKind::Direct } else { WorkKind::Views }
    }

    pub(super) fn is_direct(&self) -> bool {
        matches!(self.plan, Plan::Direct { .. })
    }

    /// What is rendered for it: pixels with their sub-pixels.
    pub(super) fn work(&self) -> u64 {
        self.pixels.saturating_mul(sub_pixels(&self.plan))
    }

    pub(super) fn traces_holes(&self) -> bool {
        matches!(&self.plan, Plan::Warp(warp) if warp.holes == Holes::Trace)
    }

    /// The cameras whose samples its plan names.
    pub(super) fn cameras(&self) -> Vec<u64> {
        self.samples().iter().map(|id| id.camera).collect()
    }

    /// Number of the version whose samples it needs, if it needs any.
    pub(super) fn sampled_version(&self) -> Option<u64> {
        self.samples().first().map(|id| id.version)
    }

    pub(super) fn samples(&self) -> &[SampleId] {
        match &self.plan {
            Plan::Direct { .. } => &[],
            Plan::Warp(warp) => &warp.samples,
        }
    }
}
