//! How a worker fared with its views: one that fails at all that it is given rests for a while.
//!
//! One that fails fast has the shortest queue and would have every view first, so that it rests after a few failures, for
//! longer each time, and is then given one view at a time until it answers one.

use std::time::Duration;

use crate::core::event::ViewId;
use crate::core::time::Uptime;

/// Views in a row at which a worker fails before it rests; one that no worker can do is one.
const MOST_FAILURES: u32 = 3;

/// The first rest.
const FIRST_REST: Duration = Duration::from_secs(1);

/// The longest rest: each is twice as long as the one before.
const LONGEST_REST: Duration = Duration::from_secs(60);

/// How a worker has fared with what it was given last.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    failures: u32,
    /// The view that it failed at last.
    last: Option<ViewId>,
    rests_until: Option<Uptime>,
}

impl Record {
    pub(super) fn answered(&mut self) {
        *self = Self::default();
    }

    /// It failed at a view, by its own fault. What it was given before a rest says nothing new.
    pub(super) fn failed(&mut self, view_id: ViewId, now: Uptime) {
        if self.rests_until.is_some() || self.last == Some(view_id) {
            return;
        }
        self.last = Some(view_id);
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
    pub(super) fn wakes(&mut self, now: Uptime) -> bool {
        self.rests_until.take_if(|until| now >= *until).is_some()
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
        for view_id in 0..12 {
            record.failed(ViewId(view_id), at(now));
            record.failed(ViewId(view_id), at(now));
            if let Some(until) = record.rests_until {
                rests.push(until.since(at(now)).as_secs());
                record.failed(ViewId(100 + view_id), at(now));
                now = until.0.as_secs_f64();
                assert!(!record.wakes(at(now - 0.1)) && record.wakes(at(now)));
                assert!(record.is_on_trial() && !record.rests());
            }
        }
        assert_eq!(rests, [1, 2, 4, 8, 16, 32, 60, 60, 60, 60]);
        record.answered();
        record.failed(ViewId(1), at(now));
        assert!(!record.rests() && !record.is_on_trial());
    }
}
