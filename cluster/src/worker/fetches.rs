//! Fetches of samples under way, so that those who need the same sample at the same time share one fetch.

use std::collections::HashMap;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{Sample, SampleId};
use futures::FutureExt;
use futures::future::{BoxFuture, Shared, WeakShared};
use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::sync::futures::Notified;

pub(super) type Fetch = BoxFuture<'static, Result<Arc<Sample>, Fault>>;

/// What a sample is fetched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Purpose {
    /// A view of this process.
    View,
    /// Another process: its planes must be in host memory.
    OtherWorker,
    /// Views to come.
    Prefetch,
}

/// Fetches under way, by sample and purpose. A fetch whose last waiter gives up is dropped with it.
#[derive(Default)]
pub(super) struct Fetches {
    under_way: Mutex<HashMap<(SampleId, Purpose), WeakShared<Fetch>>>,
    /// Rings when another one begins.
    begun: Notify,
}

impl Fetches {
    /// Joins the fetch of that sample, or starts it.
    pub(super) fn join(&self, key: (SampleId, Purpose), start: impl FnOnce() -> Fetch) -> Shared<Fetch> {
        let mut under_way = self.under_way.lock();
        if let Some(fetch) = under_way.get(&key).and_then(WeakShared::upgrade)
            && fetch.peek().is_none()
        {
            return fetch;
        }
        under_way.retain(|_, fetch| fetch.upgrade().is_some_and(|fetch| fetch.peek().is_none()));
        let fetch = start().shared();
        under_way.extend(fetch.downgrade().map(|weak| (key, weak)));
        drop(under_way);
        self.begun.notify_waiters();
        fetch
    }

    /// Ends when another fetch begins after this call.
    pub(super) fn begun(&self) -> Notified<'_> {
        self.begun.notified()
    }

    /// The fetch of that sample for one of these purposes, if there is one.
    pub(super) fn find(&self, id: SampleId, purposes: &[Purpose]) -> Option<Shared<Fetch>> {
        let under_way = self.under_way.lock();
        purposes.iter().find_map(|purpose| {
            let fetch = under_way.get(&(id, *purpose)).and_then(WeakShared::upgrade)?;
            fetch.peek().is_none().then_some(fetch)
        })
    }
}
