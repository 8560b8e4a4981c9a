//! Whether the render thread's devices work, as others see it.

use std::sync::atomic::{AtomicUsize, Ordering};

use parking_lot::Mutex;

/// Failures in a row after which the process is not ready: one is a device that was lost, and made again.
const MOST_FAILURES: u32 = 3;

/// Filled by the render thread.
#[derive(Debug, Default)]
pub(super) struct Health {
    /// In a row, with what was said of the last one.
    failures: Mutex<(u32, String)>,
    /// Samples that the compositor holds.
    held: AtomicUsize,
}

impl Health {
    /// Something was rendered.
    pub(super) fn works(&self) {
        let mut failures = self.failures.lock();
        if failures.0 > 0 {
            *failures = Default::default();
        }
    }

    /// The device was lost, or a role could not be made on it.
    pub(super) fn failed(&self, reason: &str) {
        let mut failures = self.failures.lock();
        *failures = (failures.0.saturating_add(1), reason.to_owned());
    }

    /// # Errors
    /// Why nothing more will come of it, as far as that can be known.
    pub(super) fn check(&self) -> Result<(), String> {
        let failures = self.failures.lock();
        match failures.0 < MOST_FAILURES {
            true => Ok(()),
            false => Err(format!("the device failed {} times in a row: {}", failures.0, failures.1)),
        }
    }

    pub(super) fn holds(&self, samples: usize) {
        self.held.store(samples, Ordering::Relaxed);
    }

    pub(super) fn held(&self) -> usize {
        self.held.load(Ordering::Relaxed)
    }
}
