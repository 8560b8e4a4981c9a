//! A simulated worker: what it was told, what it has, what waits for its render thread.
//!
//! It does what `argus_cluster::worker` does, in the same order: samples first, then batches of views and of direct
//! views in turn, last samples ahead of demand.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use argus_cluster::core::{Assignment, Report, Role, Ticket, WorkerId};
use argus_scene::SampleId;

use super::Nanos;
use super::world::Task;

/// Most views in one batch, and most direct ones: as a worker's configuration has it.
const MOST_VIEWS: usize = 64;
const MOST_DIRECT: usize = 4;

/// One attempt at a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attempt {
    pub(super) ticket: Ticket,
    pub(super) attempt: u32,
}

/// What the render thread does.
#[derive(Debug, Clone)]
pub(super) enum Rendering {
    Sample(SampleId),
    Views(Vec<Attempt>),
    Direct(Vec<Attempt>),
}

/// What the render thread is at.
#[derive(Debug, Clone)]
pub(super) struct Busy {
    pub(super) rendering: Rendering,
    pub(super) since: Nanos,
    /// How much of it is the cost of what is rendered; the rest is taking samples up.
    pub(super) cost_share: f64,
    /// Threads that are still at it.
    pub(super) threads: u32,
}

/// A view that waits for samples.
#[derive(Debug, Clone)]
pub(super) struct Waiting {
    pub(super) view: Attempt,
    pub(super) samples: Vec<SampleId>,
    pub(super) missing: BTreeSet<SampleId>,
}

/// A sample that is being fetched.
#[derive(Debug, Clone, Default)]
pub(super) struct Fetch {
    /// Slots of the workers to ask, the one that was asked first.
    pub(super) sources: VecDeque<usize>,
    /// … all of them.
    pub(super) all: Vec<usize>,
    /// Whether a view waits for it.
    pub(super) urgent: bool,
}

#[derive(Debug, Default)]
pub(super) struct Worker {
    pub(super) name: String,
    /// Its joining; `None` while it is not part of the cluster.
    pub(super) id: Option<WorkerId>,
    /// Counts its processes, so that what an earlier one began is told apart.
    pub(super) life: u32,
    pub(super) alive: bool,
    pub(super) paused: bool,
    pub(super) leaving: bool,
    /// How much longer everything takes it than others.
    pub(super) slowness: f64,
    pub(super) told: Option<Assignment>,
    pub(super) acting: Option<Role>,
    pub(super) applied: u64,
    pub(super) held: BTreeSet<SampleId>,
    /// What it has as it goes over the wire: what it received, and what it packed.
    pub(super) packed: BTreeSet<SampleId>,
    /// Who waits for a sample that is being packed.
    pub(super) packing: HashMap<SampleId, Vec<usize>>,
    /// What its compositor has taken up.
    pub(super) taken_up: BTreeSet<SampleId>,
    pub(super) fetches: HashMap<SampleId, Fetch>,
    /// Who waits for a sample from here.
    pub(super) children: HashMap<SampleId, Vec<usize>>,
    pub(super) renders: VecDeque<SampleId>,
    pub(super) renders_ahead: VecDeque<SampleId>,
    pub(super) waiting: BTreeMap<Ticket, Waiting>,
    pub(super) views: VecDeque<(Attempt, Vec<SampleId>)>,
    pub(super) direct: VecDeque<Attempt>,
    pub(super) direct_had_its_turn: bool,
    pub(super) busy: Option<Busy>,
    /// Frames that are being packed, or wait for it.
    pub(super) sending: usize,
    /// Work beside rendering: how much is at it, and what waits.
    pub(super) beside: usize,
    pub(super) beside_waits: VecDeque<(f64, Task)>,
    pub(super) report: Report,
    /// Milliseconds and counts since the last report: samples, direct views, views.
    pub(super) recent: [(f64, u64); 3],
}

impl Worker {
    pub(super) fn samples(&self) -> bool {
        self.acting.is_some_and(Role::samples)
    }

    /// Whether a sample is being rendered, or waits for that.
    pub(super) fn renders(&self, id: SampleId, ahead: bool) -> bool {
        let now = matches!(&self.busy, Some(Busy { rendering: Rendering::Sample(now), .. }) if *now == id);
        now || self.renders.contains(&id) || (ahead && self.renders_ahead.contains(&id))
    }

    /// What the render thread does next, if there is anything, and how many samples the compositor has to take up
    /// for it.
    pub(super) fn next(&mut self) -> Option<(Rendering, usize)> {
        if self.busy.is_some() || !self.alive {
            return None;
        }
        if let Some(id) = self.renders.pop_front() {
            return Some((Rendering::Sample(id), 0));
        }
        let direct_turn = self.views.is_empty() || !self.direct_had_its_turn;
        if direct_turn && !self.direct.is_empty() {
            self.direct_had_its_turn = true;
            let count = self.direct.len().min(MOST_DIRECT);
            return Some((Rendering::Direct(self.direct.drain(..count).collect()), 0));
        }
        self.direct_had_its_turn = false;
        if self.views.is_empty() {
            return self.renders_ahead.pop_front().map(|id| (Rendering::Sample(id), 0));
        }
        // Views of one epoch only.
        let epoch = self.views[0].1.first().map(|id| id.epoch);
        let same = |view: &&(Attempt, Vec<SampleId>)| view.1.first().map(|id| id.epoch) == epoch;
        let count = self.views.iter().take_while(same).count().min(MOST_VIEWS);
        let mut fresh = 0;
        let mut batch = Vec::with_capacity(count);
        for (view, samples) in self.views.drain(..count) {
            fresh += samples.into_iter().filter(|id| self.taken_up.insert(*id)).count();
            batch.push(view);
        }
        Some((Rendering::Views(batch), fresh))
    }

    /// Something was rendered that took `ms` of it, `own_ms` of which is its cost.
    pub(super) fn measure(&mut self, rendering: &Rendering, ms: f64, cost_ms: f64) {
        let (kind, count) = match rendering {
            Rendering::Sample(_) => (0, 1),
            Rendering::Direct(views) => (1, views.len() as u64),
            Rendering::Views(views) => (2, views.len() as u64),
        };
        self.recent[kind].0 += cost_ms;
        self.recent[kind].1 += count;
        let report = &mut self.report;
        match kind {
            0 => report.samples_rendered += count,
            1 => report.views_direct += count,
            _ => report.views_composed += count,
        }
        match kind {
            2 => report.compositing_busy_ms += ms,
            _ => report.sampling_busy_ms += ms,
        }
    }

    /// What it reports now. A role is taken up once what the one before gave it is done.
    pub(super) fn report(&mut self) -> Report {
        if let Some(told) = &self.told {
            let before = self.acting.unwrap_or(told.role);
            let sampling =
                self.busy.as_ref().is_some_and(|busy| !matches!(busy.rendering, Rendering::Views(_)));
            let samples_due = before.samples()
                && !told.role.samples()
                && (sampling || !self.renders.is_empty() || !self.direct.is_empty());
            let composing =
                self.busy.as_ref().is_some_and(|busy| matches!(busy.rendering, Rendering::Views(_)));
            let views_due = before.composites()
                && !told.role.composites()
                && (composing || !self.views.is_empty() || !self.waiting.is_empty());
            if !(samples_due || views_due) {
                self.acting = Some(told.role);
                self.applied = told.sequence;
            }
        }
        let [sample, direct, view] = &mut self.recent;
        let mean = |recent: &mut (f64, u64), before: Option<f64>| match std::mem::take(recent) {
            (_, 0) => before,
            (ms, count) => Some(ms / count as f64),
        };
        self.report.sample_ms = mean(sample, self.report.sample_ms);
        self.report.direct_ms = mean(direct, self.report.direct_ms);
        self.report.view_ms = mean(view, self.report.view_ms);
        self.report.applied = self.applied;
        self.report.held = self.held.iter().copied().collect();
        self.report.leaving = self.leaving;
        self.report.clone()
    }

    /// Its process ends, and with it all it had.
    pub(super) fn end(&mut self) {
        let (name, life, slowness) = (std::mem::take(&mut self.name), self.life + 1, self.slowness);
        *self = Self { name, life, slowness, ..Self::default() };
    }
}
