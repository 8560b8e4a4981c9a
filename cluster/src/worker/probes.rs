//! Results of a worker's probes, until they are reported.

use parking_lot::Mutex;

use crate::core::ProbeResult;

/// The probes of a worker. One runs at a time.
#[derive(Debug, Default)]
pub(super) struct Probes(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    is_probing: bool,
    /// Results that are not reported yet.
    results: Vec<ProbeResult>,
}

impl Probes {
    /// Takes the results that are not reported yet.
    pub(super) fn take(&self) -> Vec<ProbeResult> {
        std::mem::take(&mut self.0.lock().results)
    }

    /// Forgets the results, which are of another scene or another coordinator's views.
    pub(super) fn forget(&self) {
        self.0.lock().results.clear();
    }

    /// Begins a probe. Returns whether none was in progress.
    pub(super) fn begin(&self) -> bool {
        !std::mem::replace(&mut self.0.lock().is_probing, true)
    }

    /// Ends the probe. `None`: it was given up.
    pub(super) fn end(&self, result: Option<ProbeResult>) {
        let mut state = self.0.lock();
        state.is_probing = false;
        state.results.extend(result);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::ViewId;

    #[test]
    fn one_probe_runs_at_a_time_and_each_result_is_reported_once() {
        let probes = Probes::default();
        let result = ProbeResult { view_id: ViewId(3), attempt: 1, excess: vec![0.5] };
        assert!(probes.begin() && !probes.begin());
        probes.end(Some(result.clone()));
        assert!(probes.begin());
        probes.end(None);
        assert_eq!((probes.take(), probes.take()), (vec![result], Vec::new()));
    }
}
