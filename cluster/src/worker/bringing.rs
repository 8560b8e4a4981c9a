//! Samples that the newest assignment wants at hand, and the tasks that bring them.

use std::collections::BTreeMap;

use argus_scene::SampleId;
use parking_lot::Mutex;
use tokio::sync::{Semaphore, watch};
use tokio::task::AbortHandle;

/// Samples that are fetched at the same time: the others' views come first.
const FETCHES: usize = 2;

/// A sample on its way here, or here.
pub(super) struct Bringing {
    /// Tells the task where the sample is.
    pub(super) told: watch::Sender<Vec<String>>,
    /// Ends the task, which may be over.
    pub(super) task: AbortHandle,
}

/// What the newest assignment wants at hand.
pub(super) struct Ahead {
    pub(super) wanted: Mutex<BTreeMap<SampleId, Bringing>>,
    pub(super) turns: Semaphore,
}

impl Default for Ahead {
    fn default() -> Self {
        Self { wanted: Mutex::default(), turns: Semaphore::new(FETCHES) }
    }
}
