//! A worker's failures at views: a worker that only fails is paused (circuit breaker).
//!
//! A worker that fails fast has the shortest queue and would get every view first. So it pauses after a few failures,
//! for twice as long each time. After a pause it gets one view at a time until it answers one.

use std::time::Duration;

use crate::core::event::ViewId;
use crate::core::time::Uptime;

/// Failed views in a row before a worker pauses. The same view counts once, since it may be at fault.
const MOST_FAILURES: u32 = 3;

/// The first pause.
const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// The longest pause. Each is twice as long as the previous one.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// A worker's recent failures.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    failures: u32,
    /// The latest view that failed.
    last: Option<ViewId>,
    paused_until: Option<Uptime>,
}

impl Record {
    pub(super) fn answered(&mut self) {
        *self = Self::default();
    }

    /// Records a failure that is the worker's fault. Failures of views from before a pause are ignored.
    pub(super) fn failed(&mut self, view_id: ViewId, now: Uptime) {
        if self.paused_until.is_some() || self.last == Some(view_id) {
            return;
        }
        self.last = Some(view_id);
        self.failures = self.failures.saturating_add(1);
        if let Some(pauses) = self.failures.checked_sub(MOST_FAILURES) {
            let pause = FIRST_PAUSE.saturating_mul(1 << pauses.min(16)).min(LONGEST_PAUSE);
            self.paused_until = Some(now.after(pause));
        }
    }

    pub(super) fn is_paused(&self) -> bool {
        self.paused_until.is_some()
    }

    /// Whether it must still prove that it works again.
    pub(super) fn is_on_trial(&self) -> bool {
        self.failures >= MOST_FAILURES
    }

    /// Ends a pause that is over; whether it did.
    pub(super) fn wakes(&mut self, now: Uptime) -> bool {
        self.paused_until.take_if(|until| now >= *until).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    #[test]
    fn pauses_double_and_an_answer_ends_them() {
        let mut record = Record::default();
        let mut now = 0.0;
        let mut pauses = Vec::new();
        for view_id in 0..12 {
            record.failed(ViewId(view_id), at(now));
            record.failed(ViewId(view_id), at(now));
            if let Some(until) = record.paused_until {
                pauses.push(until.since(at(now)).as_secs());
                record.failed(ViewId(100 + view_id), at(now));
                now = until.0.as_secs_f64();
                assert!(!record.wakes(at(now - 0.1)) && record.wakes(at(now)));
                assert!(record.is_on_trial() && !record.is_paused());
            }
        }
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 60, 60, 60, 60]);
        record.answered();
        record.failed(ViewId(1), at(now));
        assert!(!record.is_paused() && !record.is_on_trial());
    }
}
