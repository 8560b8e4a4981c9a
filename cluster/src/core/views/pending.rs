//! Admitted views: their state, the queues of those that wait for a worker, and counts by kind.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_scene::{Camera, FaceMask, Holes, Plan, Prediction, SampleId, Version};

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
    /// Pixels of the frame.
    pub(super) pixels: u64,
    pub(super) version: Version,
    /// The plan; if the way is open, the latest one.
    pub(super) plan: Plan,
    /// The level of the rig's cameras that serve it. Samples of finer levels are refinements, which it can do without.
    pub(super) own_level: i32,
    /// What the planner needs to know, if the request leaves the way open.
    pub(super) open: Option<Box<OpenView>>,
    /// The prediction for its frame.
    pub(super) expected: Option<Prediction>,
    /// The search for a frame within a bound.
    pub(super) target_search: Option<Box<TargetSearch>>,
    /// Whether the plan was pinned. Its holes then say nothing about plans made here.
    pub(super) pinned: bool,
    /// The pinned kind of device; empty: any.
    pub(super) device: String,
    /// The deadline, and the duration from the request to it.
    pub(super) deadline: (Uptime, Duration),
    pub(super) requested: Uptime,
    /// The next time to check whether its deadline or patience has ended.
    pub(super) due: Uptime,
    pub(super) attempt: u32,
    pub(super) worker: Option<WorkerId>,
    pub(super) tried: BTreeSet<WorkerId>,
}

/// Number of queues whose first view blocks the others.
pub(super) const BLOCKING_QUEUES: usize = 3;

/// Views that wait for a worker with room. Ids ascend with arrival, so the least is the oldest.
#[derive(Debug, Clone, Default)]
pub(super) struct Waiting {
    pub(super) composed: BTreeSet<ViewId>,
    pub(super) direct: BTreeSet<ViewId>,
    /// Views that leave the way open, which any worker can answer.
    pub(super) open: BTreeSet<ViewId>,
    /// Views that only certain workers can answer. They block no other view.
    pub(super) bound: BTreeSet<ViewId>,
}

impl Waiting {
    pub(super) fn insert(&mut self, view_id: ViewId, view: &Pending) {
        let queue = match (view.is_bound(), view.open.is_some(), !view.needs_samples()) {
            (true, ..) => &mut self.bound,
            (_, true, _) => &mut self.open,
            (.., true) => &mut self.direct,
            _ => &mut self.composed,
        };
        queue.insert(view_id);
    }

    /// The oldest view in the queues that are not `full`, and the index of its queue.
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

/// Counts of views in flight by kind, and of the versions whose samples they need.
#[derive(Debug, Clone, Default)]
pub(super) struct InFlight {
    pub(super) direct: usize,
    pub(super) composed: usize,
    /// Views that leave the way open.
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
        match (view.open.is_some(), !view.needs_samples()) {
            (true, _) => &mut self.open,
            (_, true) => &mut self.direct,
            _ => &mut self.composed,
        }
    }

    /// The versions whose samples are needed by views in flight.
    pub(super) fn needed(&self) -> &NeededVersions {
        &self.needed
    }
}

impl Pending {
    /// Starts anew with another plan, since the frame was rejected. Any worker may answer.
    pub(super) fn begin_again(&mut self, plan: Plan, expected: Prediction, target_search: Box<TargetSearch>) {
        (self.plan, self.expected, self.target_search) = (plan, Some(expected), Some(target_search));
        (self.worker, self.tried) = (None, BTreeSet::new());
    }

    /// Attempts that failed or are in work, without those whose frame was rejected.
    pub(super) fn attempts(&self) -> u32 {
        self.attempt - self.target_search.as_ref().map_or(0, |target_search| target_search.thrown_away())
    }

    /// Whether only certain workers can answer it.
    pub(super) fn is_bound(&self) -> bool {
        !self.device.is_empty() || !self.tried.is_empty()
    }

    /// The kind of demand of an explicit view.
    pub(super) fn kind(&self) -> WorkKind {
        if self.needs_samples() { WorkKind::Views } else { WorkKind::Direct }
    }

    pub(super) fn is_direct(&self) -> bool {
        matches!(self.plan, Plan::Direct { .. })
    }

    /// Whether it needs samples of the set. A view that is warped from frames needs triangles alone.
    pub(super) fn needs_samples(&self) -> bool {
        self.plan.needs_samples()
    }

    /// Pixels of the view in full, with sub-pixels.
    pub(super) fn full_work(&self) -> u64 {
        let per_pixel = match &self.plan {
            Plan::Direct { samples_per_pixel, .. } => *samples_per_pixel,
            Plan::Warp(warp) => warp.supersampling.saturating_mul(warp.supersampling),
        };
        self.pixels.saturating_mul(per_pixel.into())
    }

    /// Pixels to render, with sub-pixels.
    pub(super) fn work(&self) -> u64 {
        self.plan.sub_pixels(self.pixels)
    }

    pub(super) fn traces_holes(&self) -> bool {
        matches!(&self.plan, Plan::Warp(warp) if warp.holes == Holes::Trace)
    }

    /// The cameras of its plan's samples.
    pub(super) fn cameras(&self) -> Vec<u64> {
        self.samples().iter().map(|id| id.camera).collect()
    }

    /// The version of its samples, if it needs samples.
    pub(super) fn sampled_version(&self) -> Option<u64> {
        self.samples().first().map(|id| id.version)
    }

    /// The samples that its plan names, with the faces that it uses.
    pub(super) fn faces(&self) -> Vec<(SampleId, FaceMask)> {
        match &self.plan {
            Plan::Direct { .. } => Vec::new(),
            Plan::Warp(warp) => warp.samples.iter().map(|id| (*id, warp.faces.of(id.camera))).collect(),
        }
    }

    pub(super) fn samples(&self) -> &[SampleId] {
        match &self.plan {
            Plan::Direct { .. } => &[],
            Plan::Warp(warp) => &warp.samples,
        }
    }
}
