//! Fetches in progress. Callers that need the same sample at the same time share one fetch.

use std::collections::HashMap;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Sample, SampleId};
use futures::FutureExt;
use futures::future::{BoxFuture, Shared, WeakShared};
use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::sync::futures::Notified;

/// A fetch of a sample.
pub(super) type Fetch = BoxFuture<'static, Result<Arc<Sample>, Fault>>;

/// The purpose of a fetch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Purpose {
    /// A view of this worker.
    View,
    /// Another worker. The planes must be in host memory.
    OtherWorker,
    /// Later views.
    Prefetch,
}

/// Fetches in progress, by sample and purpose. A fetch is dropped when its last caller gives up.
#[derive(Default)]
pub(super) struct Fetches {
    in_progress: Mutex<HashMap<(SampleId, Purpose), WeakShared<Fetch>>>,
    /// Notifies when a fetch begins.
    begun: Notify,
}

impl Fetches {
    /// Joins the fetch of this sample and purpose, or starts it.
    pub(super) fn join(&self, key: (SampleId, Purpose), start: impl FnOnce() -> Fetch) -> Shared<Fetch> {
        let mut in_progress = self.in_progress.lock();
        if let Some(fetch) = in_progress.get(&key).and_then(WeakShared::upgrade)
            && fetch.peek().is_none()
        {
            return fetch;
        }
        in_progress.retain(|_, fetch| fetch.upgrade().is_some_and(|fetch| fetch.peek().is_none()));
        let fetch = start().shared();
        in_progress.extend(fetch.downgrade().map(|weak| (key, weak)));
        drop(in_progress);
        self.begun.notify_waiters();
        fetch
    }

    /// Completes when a fetch begins after this call.
    pub(super) fn begun(&self) -> Notified<'_> {
        self.begun.notified()
    }

    /// The fetch of a sample for one of these purposes, if one is in progress.
    pub(super) fn find(&self, id: SampleId, purposes: &[Purpose]) -> Option<Shared<Fetch>> {
        let in_progress = self.in_progress.lock();
        purposes.iter().find_map(|purpose| {
            let fetch = in_progress.get(&(id, *purpose)).and_then(WeakShared::upgrade)?;
            fetch.peek().is_none().then_some(fetch)
        })
    }
}
