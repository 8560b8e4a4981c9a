//! A simulated worker: its assignment, the samples it holds, and the queue of its render thread.
//!
//! What it does next is decided by [`argus_cluster::worker::policy`], as in the real worker.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use argus_cluster::core::{Assignment, Report, Role, ViewId, WorkerId};
use argus_cluster::worker::policy::{Kind, Policy, Waiting as Left, may_change_role, take_batch};
use argus_scene::SampleId;

use super::Nanos;
use super::work::{Attempt, Task};

/// Work of the render thread.
#[derive(Debug, Clone)]
pub(super) enum Rendering {
    Sample(SampleId),
    Views(Vec<Attempt>),
    Direct(Vec<Attempt>),
}

/// The work in progress on the render thread.
#[derive(Debug, Clone)]
pub(super) struct Busy {
    pub(super) rendering: Rendering,
    pub(super) since: Nanos,
    /// Share of the time that is the cost of rendering; the rest is holding samples.
    pub(super) cost_share: f64,
    /// Threads that are still working on it.
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
    /// Slots of the workers to ask.
    pub(super) sources: Vec<usize>,
    /// Number of these that were asked in vain.
    pub(super) asked: usize,
    /// Slots of the workers to ask after all of `sources`.
    pub(super) then: Vec<usize>,
    /// Whether a view waits for the sample.
    pub(super) urgent: bool,
}

impl Fetch {
    /// The worker that is being asked.
    pub(super) fn source(&self) -> Option<usize> {
        self.sources.get(self.asked).copied()
    }
}

#[derive(Debug, Default)]
pub(super) struct Worker {
    pub(super) name: String,
    /// Its id in the cluster; `None` while it is not a member.
    pub(super) id: Option<WorkerId>,
    /// Number of process restarts, so that events for an earlier process are ignored.
    pub(super) life: u32,
    pub(super) alive: bool,
    pub(super) paused: bool,
    pub(super) leaving: bool,
    /// Factor on the time of all its work.
    pub(super) slowness: f64,
    pub(super) assignment: Option<Assignment>,
    pub(super) acting: Option<Role>,
    pub(super) applied: u64,
    pub(super) held: BTreeSet<SampleId>,
    /// Samples that it has in packed form: received ones, and those it packed.
    pub(super) packed: BTreeSet<SampleId>,
    /// Slots that wait for a sample that is being packed.
    pub(super) packing: HashMap<SampleId, Vec<usize>>,
    /// Samples that its compositor holds.
    pub(super) taken_up: BTreeSet<SampleId>,
    pub(super) fetches: HashMap<SampleId, Fetch>,
    /// Slots that wait for a sample from this worker.
    pub(super) children: HashMap<SampleId, Vec<usize>>,
    pub(super) renders: VecDeque<SampleId>,
    pub(super) prefetches: VecDeque<SampleId>,
    pub(super) waiting: BTreeMap<ViewId, Waiting>,
    pub(super) views: VecDeque<(Attempt, Vec<SampleId>)>,
    pub(super) direct: VecDeque<Attempt>,
    pub(super) policy: Policy,
    pub(super) busy: Option<Busy>,
    /// Frames that are being packed or wait for it.
    pub(super) sending: usize,
    /// Tasks in work beside rendering, and the tasks that wait.
    pub(super) beside: usize,
    pub(super) beside_waits: VecDeque<(f64, Task)>,
    pub(super) report: Report,
    /// Milliseconds and counts since the last report: samples, direct views, warped views.
    pub(super) recent: [(f64, u64); 3],
}

impl Worker {
    pub(super) fn samples(&self) -> bool {
        self.acting.is_some_and(Role::samples)
    }

    /// Whether a sample is being rendered or queued.
    pub(super) fn renders(&self, id: SampleId, prefetch: bool) -> bool {
        let now = matches!(&self.busy, Some(Busy { rendering: Rendering::Sample(now), .. }) if *now == id);
        now || self.renders.contains(&id) || (prefetch && self.prefetches.contains(&id))
    }

    /// Queues a sample to be rendered, unless it is in work or queued.
    pub(super) fn render(&mut self, id: SampleId, prefetch: bool) {
        if self.renders(id, prefetch) {
            return;
        }
        match prefetch {
            true => self.prefetches.push_back(id),
            false => {
                self.prefetches.retain(|other| *other != id);
                self.renders.push_back(id);
            }
        }
    }

    /// The render thread's queue.
    fn waiting(&self) -> Left {
        Left {
            samples: self.renders.len(),
            direct: self.direct.len(),
            warped: self.views.len(),
            prefetch: self.prefetches.len(),
            ..Left::default()
        }
    }

    /// The render thread's work in progress, counted like its queue.
    fn in_work(&self) -> Left {
        let none = Left::default();
        match self.busy.as_ref().map(|busy| &busy.rendering) {
            Some(Rendering::Sample(_)) => Left { samples: 1, ..none },
            Some(Rendering::Direct(views)) => Left { direct: views.len(), ..none },
            Some(Rendering::Views(views)) => Left { warped: views.len(), ..none },
            None => none,
        }
    }

    /// The render thread's next work, if any, and the number of samples that the compositor must hold for it first.
    pub(super) fn next(&mut self) -> Option<(Rendering, usize)> {
        if self.busy.is_some() || !self.alive {
            return None;
        }
        let turn = self.policy.next(&self.waiting())?;
        match turn.kind {
            Kind::Sample => self.renders.pop_front().map(|id| (Rendering::Sample(id), 0)),
            Kind::Prefetch => self.prefetches.pop_front().map(|id| (Rendering::Sample(id), 0)),
            Kind::Direct => {
                let views = take_batch(&mut self.direct, turn.most, |_, _| true);
                Some((Rendering::Direct(views.into()), 0))
            }
            Kind::Warped => {
                let epoch = |(_, samples): &(Attempt, Vec<SampleId>)| samples.first().map(|id| id.version);
                let batch = take_batch(&mut self.views, turn.most, |a, b| epoch(a) == epoch(b));
                let mut fresh = 0;
                let mut views = Vec::with_capacity(batch.len());
                for (view, samples) in batch {
                    fresh += samples.into_iter().filter(|id| self.taken_up.insert(*id)).count();
                    views.push(view);
                }
                Some((Rendering::Views(views), fresh))
            }
            // The simulation has none of these.
            Kind::Order | Kind::Postponed | Kind::Pixels | Kind::Background => None,
        }
    }

    /// Records work that took `ms` milliseconds, of which `cost_ms` are its own cost.
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

    /// The next report. A new role is taken up once the queue allows it.
    pub(super) fn report(&mut self) -> Report {
        if let Some(assignment) = &self.assignment {
            let before = self.acting.unwrap_or(assignment.role);
            if may_change_role(before, assignment.role, &(self.waiting() + self.in_work())) {
                self.acting = Some(assignment.role);
                self.applied = assignment.sequence;
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

    /// Ends the process: it loses all state but its name and speed.
    pub(super) fn end(&mut self) {
        let (name, life, slowness) = (std::mem::take(&mut self.name), self.life + 1, self.slowness);
        *self = Self { name, life, slowness, ..Self::default() };
    }
}
