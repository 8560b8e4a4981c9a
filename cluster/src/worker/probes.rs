//! Results of a worker's probes, and their schedule.

use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::core::Probed;

/// Least time between two probes of a worker.
const INTERVAL: Duration = Duration::from_secs(2);

/// The probes of a worker.
#[derive(Debug, Default)]
pub(super) struct Probes(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    is_probing: bool,
    last: Option<Instant>,
    probed: Probed,
}

impl Probes {
    /// Sums of all probes since the worker started.
    pub(super) fn found(&self) -> Probed {
        self.0.lock().probed
    }

    /// Forgets all probes, which were of another scene.
    pub(super) fn forget(&self) {
        self.0.lock().probed = Probed::default();
    }

    /// Begins a probe and returns its number. Returns `None` if one is in progress or the last one was recent.
    pub(super) fn begin(&self, now: Instant) -> Option<u64> {
        let mut state = self.0.lock();
        let rests = state.last.is_some_and(|last| now < last + INTERVAL);
        (!rests && !std::mem::replace(&mut state.is_probing, true)).then_some(state.probed.count)
    }

    /// Ends the probe. `None`: it has no result.
    pub(super) fn end(&self, found: Option<Probed>) {
        let mut state = self.0.lock();
        (state.is_probing, state.last) = (false, Some(Instant::now()));
        if let Some(found) = found {
            state.probed = state.probed + found;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_probe_runs_at_a_time_and_the_next_one_waits_for_the_interval() {
        let (probes, now) = (Probes::default(), Instant::now());
        assert_eq!(probes.begin(now), Some(0));
        assert_eq!(probes.begin(now), None);
        probes.end(Some(Probed { count: 1, error: 0.5, predicted: 0.25 }));
        assert_eq!(probes.begin(now + INTERVAL / 2), None);
        assert_eq!(probes.begin(now + 2 * INTERVAL), Some(1));
        probes.end(None);
        assert_eq!(probes.found(), Probed { count: 1, error: 0.5, predicted: 0.25 });
    }
}
