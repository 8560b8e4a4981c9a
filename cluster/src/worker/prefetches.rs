//! State of the prefetched samples of the newest assignment: one task per sample, and a limit on parallel fetches.

use std::collections::BTreeMap;

use argus_scene::{FaceMask, SampleId};
use parking_lot::{Mutex, MutexGuard};
use tokio::sync::{AcquireError, Semaphore, SemaphorePermit, watch};
use tokio::task::AbortHandle;

/// Greatest number of parallel fetches. It is low because other workers' views come first.
const FETCHES: usize = 2;

/// A sample that an assignment wants held.
#[derive(Debug, Clone)]
pub(super) struct WantedSample {
    pub(super) id: SampleId,
    /// The wanted faces.
    pub(super) faces: FaceMask,
    /// Addresses of workers that have the sample; empty if this worker renders it.
    pub(super) addresses: Vec<String>,
}

/// The task that prefetches a sample. The task may have ended.
pub(super) struct Prefetch {
    /// Sends changes of the wanted faces and of the addresses to the task.
    pub(super) wanted: watch::Sender<WantedSample>,
    /// Aborts the task.
    pub(super) task: AbortHandle,
}

/// The prefetches of the newest assignment, by sample.
pub(super) struct Prefetches {
    tasks: Mutex<BTreeMap<SampleId, Prefetch>>,
    turns: Semaphore,
}

impl Default for Prefetches {
    fn default() -> Self {
        Self { tasks: Mutex::default(), turns: Semaphore::new(FETCHES) }
    }
}

impl Prefetches {
    /// Locks the tasks.
    pub(super) fn tasks(&self) -> MutexGuard<'_, BTreeMap<SampleId, Prefetch>> {
        self.tasks.lock()
    }

    /// Waits until another fetch may run. The permit ends the fetch's turn.
    pub(super) async fn turn(&self) -> Result<SemaphorePermit<'_>, AcquireError> {
        self.turns.acquire().await
    }
}
