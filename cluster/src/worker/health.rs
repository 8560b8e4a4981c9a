//! Failures of the render thread's devices, for the readiness check, and what the devices hold.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use argus_scene::{CellPages, CellReport};
use parking_lot::Mutex;

/// Consecutive failures after which the process is not ready. A single lost device is recreated.
const MOST_FAILURES: u32 = 3;

/// Device failures, recorded by the render thread.
#[derive(Default)]
pub(super) struct Health {
    /// Number of consecutive failures, and the reason of the last one.
    failures: Mutex<(u32, String)>,
    /// Number of samples that the compositor holds.
    held: AtomicUsize,
    /// The sampler's light cells.
    cells: Mutex<Option<CellReport>>,
    /// Their pages.
    cell_pages: Mutex<Option<Arc<dyn CellPages>>>,
}

impl Health {
    /// Records a success.
    pub(super) fn works(&self) {
        let mut failures = self.failures.lock();
        if failures.0 > 0 {
            *failures = Default::default();
        }
    }

    /// Records that the device was lost or a role could not be created.
    pub(super) fn failed(&self, reason: &str) {
        let mut failures = self.failures.lock();
        *failures = (failures.0.saturating_add(1), reason.to_owned());
    }

    /// Checks that the devices work.
    ///
    /// # Errors
    /// The last failure, after several consecutive ones.
    pub(super) fn check(&self) -> Result<(), String> {
        let failures = self.failures.lock();
        match failures.0 < MOST_FAILURES {
            true => Ok(()),
            false => Err(format!("the device failed {} times in a row: {}", failures.0, failures.1)),
        }
    }

    /// Records the number of samples that the compositor holds.
    pub(super) fn holds(&self, samples: usize) {
        self.held.store(samples, Ordering::Relaxed);
    }

    /// Records the sampler's light cells.
    pub(super) fn has_cells(&self, cells: Option<CellReport>, pages: Option<Arc<dyn CellPages>>) {
        (*self.cells.lock(), *self.cell_pages.lock()) = (cells, pages);
    }

    /// The pages of those cells; `None` without any.
    pub(super) fn cell_pages(&self) -> Option<Arc<dyn CellPages>> {
        self.cell_pages.lock().clone()
    }

    /// The sampler's light cells; `None` without any.
    pub(super) fn cells(&self) -> Option<CellReport> {
        *self.cells.lock()
    }

    /// Number of samples that the compositor holds.
    pub(super) fn held(&self) -> usize {
        self.held.load(Ordering::Relaxed)
    }
}
