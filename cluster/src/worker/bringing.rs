//! Samples that the newest assignment wants at hand, and the tasks that bring them.

use std::collections::BTreeMap;

use argus_scene::{FaceMask, SampleId};
use parking_lot::Mutex;
use tokio::sync::{Semaphore, watch};
use tokio::task::AbortHandle;

/// Samples that are fetched at the same time: the others' views come first.
const FETCHES: usize = 2;

/// What an assignment says of a sample that it wants at hand.
#[derive(Debug, Clone)]
pub(super) struct Told {
    pub(super) id: SampleId,
    /// The faces that are wanted.
    pub(super) faces: FaceMask,
    /// Where the sample is; none for one that is rendered here.
    pub(super) addresses: Vec<String>,
}

/// A sample on its way here, or here.
pub(super) struct Bringing {
    /// Tells the task what is wanted by now, and where it is.
    pub(super) told: watch::Sender<Told>,
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
