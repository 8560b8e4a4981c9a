//! Cancellation by callers that give up: a batch is cancelled when no caller waits for any of its results.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use argus_scene::Cancel;
use parking_lot::Mutex;

/// The cancellation of a batch. The last waiting caller triggers it.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) cancel: Cancel,
    waiting: AtomicUsize,
}

#[derive(Debug, Default)]
struct State {
    gone: bool,
    batch: Option<Arc<Batch>>,
}

/// The caller's side. Dropping it means that the caller gave up.
#[derive(Debug)]
pub(super) struct Claim(Arc<Mutex<State>>);

/// The render thread's side.
#[derive(Debug)]
pub(super) struct Claimed(Arc<Mutex<State>>);

/// The two sides of one result.
pub(super) fn claim() -> (Claim, Claimed) {
    let state = Arc::new(Mutex::default());
    (Claim(Arc::clone(&state)), Claimed(state))
}

impl Claimed {
    /// Joins a batch. Returns false, without joining, if the caller gave up.
    pub(super) fn join(&self, batch: &Arc<Batch>) -> bool {
        let mut state = self.0.lock();
        if state.gone {
            return false;
        }
        batch.waiting.fetch_add(1, Ordering::AcqRel);
        state.batch = Some(Arc::clone(batch));
        true
    }

    /// Whether the caller gave up.
    pub(super) fn is_gone(&self) -> bool {
        self.0.lock().gone
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.gone = true;
        if let Some(batch) = state.batch.take()
            && batch.waiting.fetch_sub(1, Ordering::AcqRel) == 1
        {
            batch.cancel.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_is_cancelled_when_its_last_caller_gives_up() {
        let batch = Arc::new(Batch::default());
        let (first, first_claimed) = claim();
        let (second, second_claimed) = claim();
        let (early, early_claimed) = claim();
        drop(early);
        assert!(first_claimed.join(&batch) && second_claimed.join(&batch));
        assert!(!early_claimed.join(&batch) && early_claimed.is_gone());
        drop(first);
        assert!(!batch.cancel.is_cancelled());
        drop(second);
        assert!(batch.cancel.is_cancelled());
    }
}
