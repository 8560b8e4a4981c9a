//! Whom nothing new is given while others can have it: workers that are silent (`silence`), that do not get on, or that
//! fail at all that they are given.
//!
//! A worker keeps its role and its samples throughout: all three pass, and being wrong costs the time of a view. One that
//! fails fast has the shortest queue and would have every view first, so that it rests after a few failures, for longer
//! each time, and is then given one view at a time until it answers one.

use std::time::Duration;

use super::event::{Action, Report, Ticket, WorkerId};
use super::machine::Core;
use super::pending::Pending;
use super::time::Uptime;
use super::worker::Worker;

/// Of a piece of work's expected time, what it may take: costs are means, and a machine may be busy with something else.
const PATIENCE: f64 = 10.0;

/// Views in a row at which a worker fails before it rests; one that no worker can do is one.
const MOST_FAILURES: u32 = 3;

/// The first rest, …
const FIRST_REST: Duration = Duration::from_secs(1);

/// … and the longest: each is twice as long as the one before.
const LONGEST_REST: Duration = Duration::from_secs(60);

/// How a worker has fared with what it was given last.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    failures: u32,
    /// The view that it failed at last.
    last: Option<Ticket>,
    rests_until: Option<Uptime>,
}

impl Record {
    pub(super) fn answered(&mut self) {
        *self = Self::default();
    }

    /// It failed at a view, by its own fault. What it was given before a rest says nothing new.
    pub(super) fn failed(&mut self, ticket: Ticket, now: Uptime) {
        if self.rests_until.is_some() || self.last == Some(ticket) {
            return;
        }
        self.last = Some(ticket);
        self.failures = self.failures.saturating_add(1);
        if let Some(rests) = self.failures.checked_sub(MOST_FAILURES) {
            let rest = FIRST_REST.saturating_mul(1 << rests.min(16)).min(LONGEST_REST);
            self.rests_until = Some(now.after(rest));
        }
    }

    pub(super) fn rests(&self) -> bool {
        self.rests_until.is_some()
    }

    /// Whether it has yet to show that it works again.
    pub(super) fn is_on_trial(&self) -> bool {
        self.failures >= MOST_FAILURES
    }

    /// Whether a rest ends now.
    fn wakes(&mut self, now: Uptime) -> bool {
        self.rests_until.take_if(|until| now >= *until).is_some()
    }
}

impl Core {
    /// Suspects workers that have been silent for too long, and gives others the views of all who are suspected. Ends the
    /// rests that are over.
    pub(super) fn suspect(&mut self, now: Uptime, actions: &mut Vec<Action>) {
        self.notice_silence(now);
        for worker in self.workers.values_mut() {
            if worker.record.wakes(now) {
                self.lines.update(worker);
                self.to_refine = true;
            }
        }
        // Where nobody else can have it a view stays, until somebody can; so does one that has gone round already.
        let can = |w: &Worker, v: &Pending| {
            w.answers() && (v.device_kind.is_empty() || w.hello.device == v.device_kind)
        };
        let elsewhere = |v: &Pending| self.workers.values().any(|w| can(w, v));
        let moves = |ticket: &Ticket| {
            self.views.get(ticket).is_some_and(|view| self.may_be_retried(view) && elsewhere(view))
        };
        let suspected = self.workers.values().filter(|w| w.suspected);
        let views: Vec<Ticket> = suspected.flat_map(|w| w.views.keys().copied()).filter(moves).collect();
        views.into_iter().for_each(|ticket| self.retry(ticket, now, actions));
    }

    /// Whether a worker that goes on reporting is stuck: its render thread has been at one piece of work for far longer
    /// than that takes, and another worker can have its views.
    pub(super) fn is_stuck(&self, worker: &Worker, report: &Report) -> bool {
        let piece = Duration::try_from_secs_f64(report.piece_ms * 1e-3).unwrap_or_default();
        piece >= self.config.stuck_after
            && self.workers.values().any(|other| other.id != worker.id && other.answers())
            && piece >= self.longest_piece(worker)
    }

    /// How long a worker's thread may be at one piece of work: all of its views are one batch at the most, and larger views
    /// than are usual take longer.
    fn longest_piece(&self, worker: &Worker) -> Duration {
        let costs = &self.costs;
        let sample = costs.sample.value().or(costs.direct.value());
        let direct = costs.direct.value().or(sample).unwrap_or(0.0);
        let view = costs.view.value();
        let of = |pending: &Pending| {
            let (cost, usual) = match pending.is_direct() {
                true => (direct, costs.direct_pixels.value()),
                false => (view.unwrap_or(0.0), costs.view_pixels.value()),
            };
            cost * usual.map_or(1.0, |usual| (pending.work() as f64 / usual).max(1.0))
        };
        let views: f64 = worker.views.keys().filter_map(|ticket| self.views.get(ticket)).map(of).sum();
        // Whoever samples also traces what others have no samples of.
        let rays = self.views.values().map(Pending::work).max().unwrap_or(0) as f64;
        let rays = costs.ray.value().unwrap_or(0.0) * rays;
        let samples = sample.unwrap_or(0.0) * self.set.sampling.batch() as f64;
        let expected = Duration::try_from_secs_f64(PATIENCE * (views + rays + samples));
        let unmeasured =
            sample.is_none() || (view.is_none() && worker.role().is_some_and(|role| role.composites()));
        expected.unwrap_or(Duration::MAX).max(self.config.stuck_after).max(if unmeasured {
            self.config.first_of_its_kind
        } else {
            Duration::ZERO
        })
    }

    /// A worker failed at a view by its own fault.
    pub(super) fn blame(&mut self, id: Option<WorkerId>, ticket: Ticket, now: Uptime) {
        if let Some(worker) = id.and_then(|id| self.workers.get_mut(&id)) {
            worker.record.failed(ticket, now);
            self.to_refine |= worker.record.rests();
            self.lines.update(worker);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    #[test]
    fn rests_double_and_an_answer_ends_them() {
        let mut record = Record::default();
        let mut now = 0.0;
        let mut rests = Vec::new();
        for ticket in 0..12 {
            record.failed(Ticket(ticket), at(now));
            record.failed(Ticket(ticket), at(now));
            if let Some(until) = record.rests_until {
                rests.push(until.since(at(now)).as_secs());
                record.failed(Ticket(100 + ticket), at(now));
                now = until.0.as_secs_f64();
                assert!(!record.wakes(at(now - 0.1)) && record.wakes(at(now)));
                assert!(record.is_on_trial() && !record.rests());
            }
        }
        assert_eq!(rests, [1, 2, 4, 8, 16, 32, 60, 60, 60, 60]);
        record.answered();
        record.failed(Ticket(1), at(now));
        assert!(!record.rests() && !record.is_on_trial());
    }
}
