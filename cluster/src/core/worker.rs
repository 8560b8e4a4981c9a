//! What the core knows of one worker.

use std::collections::{BTreeMap, BTreeSet};

use argus_scene::SampleId;

use super::event::{Assignment, Hello, Report, Role, Source, Ticket, WorkerId};
use super::silence::Rhythm;
use super::suspicion::Record;
use super::time::Uptime;
use super::whereabouts::Whereabouts;

/// A worker that joined and was not lost.
#[derive(Debug, Clone)]
pub(super) struct Worker {
    pub(super) id: WorkerId,
    pub(super) hello: Hello,
    pub(super) last_report: Uptime,
    /// How late its reports were lately.
    pub(super) rhythm: Rhythm,
    /// The newest report; a default one until the first.
    pub(super) report: Report,
    /// What it did before the newest assignment that it has not acknowledged; `None` until its first role
    /// took effect.
    acting: Option<Role>,
    /// What it was told last.
    assigned: Assignment,
    /// Sequence of the first assignment that told it its role, and the set that it serves.
    role_told: u64,
    /// Sequence of the first assignment that told it the set that samples are rendered of; `None` until it was told.
    set_told: Option<u64>,
    /// Sequence of the assignment that told it to measure; `None` until one did.
    measure_told: Option<u64>,
    /// Views sent to it and not answered, each with the milliseconds of rendering that are predicted of it.
    pub(super) views: BTreeMap<Ticket, f64>,
    /// Views ever sent to it: whose turn it is among equals.
    pub(super) dispatched: u64,
    /// What it said it holds, and what it must hold because it used it.
    held: BTreeSet<SampleId>,
    /// Whether that is what its newest report says.
    held_as_reported: bool,
    /// Samples that views in its queue need, with how many need each: it will hold them.
    fetching: BTreeMap<SampleId, usize>,
    /// Busy milliseconds when the current tick began.
    pub(super) busy_at_tick_ms: f64,
    /// It has been silent for too long (`silence`), or does not get on with what it does.
    pub(super) suspected: bool,
    /// How it has fared with its views.
    pub(super) record: Record,
}

impl Worker {
    pub(super) fn new(id: WorkerId, hello: Hello, role: Role, knows_set: bool, now: Uptime) -> Self {
        Self {
            id,
            hello,
            last_report: now,
            rhythm: Rhythm::default(),
            report: Report::default(),
            acting: None,
            assigned: Assignment {
                sequence: 1,
                role,
                ahead: Vec::new(),
                kept_from: 0,
                measure_ways: false,
                suspected: Vec::new(),
            },
            role_told: 1,
            set_told: knows_set.then_some(1),
            measure_told: None,
            views: BTreeMap::new(),
            dispatched: 0,
            held: BTreeSet::new(),
            held_as_reported: true,
            fetching: BTreeMap::new(),
            busy_at_tick_ms: 0.0,
            suspected: false,
            record: Record::default(),
        }
    }

    /// Whether it has the scene and a role, and stays.
    pub(super) fn is_ready(&self) -> bool {
        self.acting.is_some() && !self.report.leaving
    }

    /// What it was told last.
    pub(super) fn assigned(&self) -> &Assignment {
        &self.assigned
    }

    /// Whether it is still on its way to the role it was told.
    pub(super) fn is_changing(&self) -> bool {
        self.acting.is_some_and(|acting| acting != self.assigned.role)
    }

    /// The role it counts for; `None` while it starts.
    pub(super) fn role(&self) -> Option<Role> {
        self.acting.map(|_| self.assigned.role)
    }

    /// Whether it was heard of lately, gets on, and does not rest from failures.
    pub(super) fn seems_well(&self) -> bool {
        !(self.suspected || self.record.rests())
    }

    /// Whether it can be given something: it is ready and seems well. One view is enough to find out whether one that
    /// failed works again.
    pub(super) fn answers(&self) -> bool {
        self.is_ready() && self.seems_well() && (!self.record.is_on_trial() || self.views.is_empty())
    }

    /// Whether it has the set that samples are rendered of.
    pub(super) fn knows_set(&self) -> bool {
        self.set_told.is_some_and(|told| self.report.applied >= told)
    }

    /// Whether it takes new samples and direct views: on the way to another role, only what both include.
    pub(super) fn takes_samples(&self) -> bool {
        let samples = self.acting.is_some_and(Role::samples) && self.assigned.role.samples();
        self.answers() && self.knows_set() && samples
    }

    /// Whether it takes new views to reconstruct.
    pub(super) fn takes_views(&self) -> bool {
        let composites = self.acting.is_some_and(Role::composites) && self.assigned.role.composites();
        self.answers() && self.knows_set() && composites
    }

    /// Tells it another role; what to send it. A role that gives nothing up counts at once.
    pub(super) fn assign(&mut self, role: Role) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.role = role;
        self.role_told = self.assigned.sequence;
        if let Some(acting) = self.acting
            && !role.gives_up_something_of(acting)
        {
            self.acting = Some(role);
        }
        self.assigned.clone()
    }

    /// Tells it to measure what views from samples cost and, while that is open, each way to see triangles; what to send it.
    pub(super) fn measure(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_ways = true;
        self.measure_told = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Whether it was ever told to measure.
    pub(super) fn has_been_told_to_measure(&self) -> bool {
        self.measure_told.is_some()
    }

    /// Whether it measures right now, so that views had better go elsewhere.
    pub(super) fn is_measuring(&self) -> bool {
        self.measure_told.is_some_and(|told| self.report.applied < told)
    }

    /// Tells it of which set samples are rendered; what to send it. It goes on with views from triangles, and takes
    /// others once it says that it has the set.
    pub(super) fn serve_set(&mut self) -> Assignment {
        self.assigned.sequence += 1;
        self.assigned.measure_ways = false;
        self.set_told = Some(self.assigned.sequence);
        self.assigned.clone()
    }

    /// Tells it what to have at hand, of which epochs, and whom not to wait for; what to send it, if that is news.
    pub(super) fn order_ahead(
        &mut self,
        ahead: Vec<Source>,
        kept_from: u64,
        suspected: &[String],
    ) -> Option<Assignment> {
        let told = &mut self.assigned;
        if told.ahead == ahead && told.kept_from == kept_from && told.suspected == suspected {
            return None;
        }
        told.sequence += 1;
        told.ahead = ahead;
        told.kept_from = kept_from;
        told.suspected = suspected.to_vec();
        Some(told.clone())
    }

    /// Takes a report in. Whether it has samples that it was not known to have.
    pub(super) fn take_report(&mut self, report: Report, now: Uptime, whereabouts: &mut Whereabouts) -> bool {
        self.rhythm.reported(now.since(self.last_report));
        self.last_report = now;
        self.suspected = false;
        // A later assignment of the same role says so too.
        let acknowledged = report.applied >= self.role_told && self.acting != Some(self.assigned.role);
        if acknowledged {
            self.acting = Some(self.assigned.role);
        }
        let mut news = false;
        if !self.held_as_reported || self.report.held != report.held {
            let held: BTreeSet<SampleId> = report.held.iter().copied().collect();
            self.held.difference(&held).for_each(|&id| whereabouts.lost(id, self.id));
            for &id in held.difference(&self.held) {
                whereabouts.gained(id, self.id);
                news = true;
            }
            self.held = held;
            self.held_as_reported = true;
        }
        self.report = report;
        // Later assignments do not repeat it.
        self.assigned.measure_ways &= self.is_measuring();
        news
    }

    /// It is gone, and what it had and wanted with it.
    pub(super) fn vanish(&self, whereabouts: &mut Whereabouts) {
        self.held.iter().for_each(|&id| whereabouts.lost(id, self.id));
        self.fetching.keys().for_each(|&id| whereabouts.unwanted(id, self.id));
    }

    /// Whether it has a sample.
    pub(super) fn has(&self, id: SampleId) -> bool {
        self.held.contains(&id)
    }

    /// How many samples it has.
    pub(super) fn holdings(&self) -> usize {
        self.held.len()
    }

    /// Milliseconds it has been busy since its process started.
    pub(super) fn busy_ms(&self) -> f64 {
        self.report.sampling_busy_ms + self.report.compositing_busy_ms
    }

    /// Milliseconds of rendering that are predicted of the views in its queue.
    pub(super) fn queued_ms(&self) -> f64 {
        self.views.values().sum()
    }

    /// Whether it was told to render samples that nobody waits for, and lacks some of them.
    pub(super) fn is_refining(&self) -> bool {
        self.assigned
            .ahead
            .iter()
            .any(|source| source.addresses.is_empty() && !self.held.contains(&source.id))
    }

    /// How many of `samples` it neither holds nor is about to.
    pub(super) fn missing(&self, samples: &[SampleId]) -> usize {
        samples.iter().filter(|id| !self.held.contains(id) && !self.fetching.contains_key(id)).count()
    }

    /// A view was sent to it.
    pub(super) fn begin(
        &mut self,
        ticket: Ticket,
        predicted_ms: f64,
        samples: &[SampleId],
        whereabouts: &mut Whereabouts,
    ) {
        self.views.insert(ticket, predicted_ms);
        self.dispatched += 1;
        for &id in samples {
            let count = self.fetching.entry(id).or_default();
            *count += 1;
            if *count == 1 {
                whereabouts.wanted(id, self.id);
            }
        }
    }

    /// A view it had is answered, failed or taken back; having answered it, it holds what the view needed.
    pub(super) fn end(
        &mut self,
        ticket: Ticket,
        samples: &[SampleId],
        answered: bool,
        whereabouts: &mut Whereabouts,
    ) {
        if self.views.remove(&ticket).is_none() {
            return;
        }
        for &id in samples {
            if answered && self.held.insert(id) {
                self.held_as_reported = false;
                whereabouts.gained(id, self.id);
            }
            if let Some(count) = self.fetching.get_mut(&id) {
                *count -= 1;
                if *count == 0 {
                    self.fetching.remove(&id);
                    whereabouts.unwanted(id, self.id);
                }
            }
        }
    }
}
