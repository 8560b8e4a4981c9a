//! The worker's status as its reports tell it: role, newest assignment in effect, and whether it is leaving.

use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::Notify;

use crate::core::{Report, Role};
use crate::worker::queue::BackendCosts;

/// The status of a worker.
pub(in crate::worker) struct WorkerStatus {
    state: Mutex<State>,
    /// Requests an early report.
    news: Arc<Notify>,
}

#[derive(Default)]
struct State {
    role: Option<Role>,
    /// Sequence number of the newest assignment in effect; 0 before a coordinator's first one.
    applied: u64,
    /// The coordinator that assigned the role is connected.
    is_led: bool,
    leaving: bool,
    /// Costs that the newest assignment asked for; empty if it asked for none.
    backend_costs: BackendCosts,
}

impl WorkerStatus {
    /// No role.
    pub(super) fn new(news: Arc<Notify>) -> Self {
        Self { state: Mutex::default(), news }
    }

    /// The role in effect.
    pub(in crate::worker) fn role(&self) -> Option<Role> {
        self.state.lock().role
    }

    /// An assignment took effect. Requests a report.
    pub(in crate::worker) fn set_role(&self, role: Role, applied: u64) {
        let mut state = self.state.lock();
        (state.role, state.applied, state.is_led) = (Some(role), applied, applied > 0);
        drop(state);
        self.news.notify_one();
    }

    /// A coordinator was joined. The role stays in effect until its first assignment. Requests a report.
    pub(in crate::worker) fn join_coordinator(&self) {
        let mut state = self.state.lock();
        (state.applied, state.is_led) = (0, false);
        drop(state);
        self.news.notify_one();
    }

    /// The coordinator is gone. Its assignment stays in effect.
    pub(in crate::worker) fn lose_coordinator(&self) {
        self.state.lock().is_led = false;
    }

    /// Whether a coordinator is connected and has assigned the role.
    pub(in crate::worker) fn is_led(&self) -> bool {
        self.state.lock().is_led
    }

    /// The worker leaves soon. Requests a report, which says so.
    pub(in crate::worker) fn leave(&self) {
        self.state.lock().leaving = true;
        self.news.notify_one();
    }

    /// Whether the worker leaves soon.
    pub(in crate::worker) fn is_leaving(&self) -> bool {
        self.state.lock().leaving
    }

    /// Reports these costs until the next assignment.
    pub(in crate::worker) fn set_backend_costs(&self, costs: BackendCosts) {
        self.state.lock().backend_costs = costs;
    }

    /// A report with the status alone.
    pub(super) fn report(&self) -> Report {
        let state = self.state.lock();
        Report {
            applied: state.applied,
            leaving: state.leaving,
            backend_costs: state.backend_costs.clone(),
            ..Report::default()
        }
    }
}
