//! The state that a worker's services share. Each part has its own module and private fields.

mod redirects;
mod render_thread;
mod served_set;
mod status;

use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use argus_proto::Fault;
use tokio::sync::{Notify, Semaphore, watch};

pub(super) use self::served_set::check_specification;

use self::redirects::Redirects;
use self::render_thread::RenderThread;
use self::served_set::ServedSet;
use self::status::WorkerStatus;
use super::config::{Config, RETRY};
use super::fetches::Fetches;
use super::frame_memory::FrameMemory;
use super::health::Health;
use super::histories::Histories;
use super::meter::Meter;
use super::policy;
use super::prefetches::Prefetches;
use super::probes::Probes;
use super::purchases::Purchases;
use super::queue::Queue;
use super::sources::SourceStore;
use super::store::Store;
use super::transforms::KnownTransforms;
use crate::core::quality::Cost;
use crate::core::{Hello, Report};
use crate::net::Channels;

/// A worker.
pub(super) struct Node {
    pub(super) config: Config,
    pub(super) hello: Hello,
    /// Connections to other workers.
    pub(super) channels: Channels,
    /// Role, and newest assignment in effect.
    pub(super) status: WorkerStatus,
    /// Scene, sample set, and its versions.
    pub(super) served: Arc<ServedSet>,
    /// Submits work to the render thread.
    pub(super) render_thread: RenderThread,
    /// Held samples.
    pub(super) store: Arc<Store>,
    /// Samples that are being fetched.
    pub(super) fetches: Fetches,
    /// Samples that the newest assignment wants held.
    pub(super) prefetches: Prefetches,
    /// Admission of redirected clients.
    pub(super) redirects: Redirects,
    /// Requests an early report.
    pub(super) news: Arc<Notify>,
    /// Permits to pack frames and samples, as many as there are threads for it.
    pub(super) packing: Semaphore,
    /// Reserved memory of frames.
    pub(super) frame_memory: FrameMemory,
    /// Depth of sessions' last frames, for reprojection.
    pub(super) histories: Arc<Histories>,
    /// Direct frames that other views are warped from.
    pub(super) sources: Arc<SourceStore>,
    /// Sources that the newest assignment orders.
    pub(super) purchases: Purchases,
    /// Errors of frames that were measured.
    pub(super) probes: Probes,
    /// Failures of the render thread's devices.
    pub(super) health: Arc<Health>,
    /// Addresses of suspected workers.
    pub(super) suspected: watch::Sender<HashSet<String>>,
    /// Addresses of other workers that hold light cells.
    pub(super) cell_holders: watch::Sender<Vec<String>>,
    /// Transforms of nodes that clients set.
    pub(super) transforms: KnownTransforms,
    meter: Arc<Meter>,
    /// Highest term seen.
    term: AtomicU64,
    /// Number of requests in progress.
    requests: AtomicUsize,
}

impl Node {
    pub(super) fn new(
        config: Config,
        hello: Hello,
        queue: Arc<Queue>,
        store: Arc<Store>,
        meter: Arc<Meter>,
        health: Arc<Health>,
    ) -> Arc<Self> {
        let news = Arc::new(Notify::new());
        let histories = Arc::new(Histories::new(config.history_bytes));
        let sources = Arc::new(SourceStore::new(config.source_bytes));
        let served =
            Arc::new(ServedSet::new(queue.clone(), store.clone(), histories.clone(), sources.clone()));
        Arc::new(Self {
            channels: Channels::new(config.connect_timeout, config.security.clone(), config.network.clone()),
            status: WorkerStatus::new(news.clone()),
            render_thread: RenderThread::new(queue, store.clone(), served.clone(), news.clone()),
            served,
            store,
            fetches: Fetches::default(),
            prefetches: Prefetches::default(),
            redirects: Redirects::new(config.max_queued_views),
            news,
            packing: Semaphore::new(policy::threads_beside(hello.cores)),
            frame_memory: FrameMemory::new(config.frame_bytes),
            histories,
            sources,
            purchases: Purchases::default(),
            probes: Probes::default(),
            health,
            suspected: watch::Sender::default(),
            cell_holders: watch::Sender::default(),
            transforms: KnownTransforms::default(),
            meter,
            term: AtomicU64::new(0),
            requests: AtomicUsize::new(0),
            config,
            hello,
        })
    }

    /// Checks a coordinator's term, and remembers it if it is the highest.
    ///
    /// # Errors
    /// [`Fault::StaleTerm`] for a term lower than the highest seen.
    pub(super) fn check_term(&self, theirs: u64) -> Result<(), Fault> {
        let ours = self.term.fetch_max(theirs, Ordering::AcqRel);
        if theirs < ours { Err(Fault::StaleTerm { ours, theirs }) } else { Ok(()) }
    }

    /// Awaits another worker's answer, until that worker is suspected.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if the worker at `address` is or becomes suspected; else the error of `answer`.
    pub(super) async fn unless_suspected<T>(
        &self,
        address: &str,
        answer: impl Future<Output = Result<T, Fault>>,
    ) -> Result<T, Fault> {
        let mut suspected = self.suspected.subscribe();
        tokio::select! {
            answer = answer => answer,
            // The sender lives as long as this worker.
            _ = suspected.wait_for(|all| all.contains(address)) => {
                Err(Fault::Unavailable(format!("the worker at {address} is suspected to hang")))
            }
        }
    }

    /// Counts a request as in progress until the guard is dropped.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] at [`Config::max_requests`].
    pub(super) fn begin(self: &Arc<Self>) -> Result<ActiveRequest, Fault> {
        let before = self.requests.fetch_add(1, Ordering::AcqRel);
        let active = ActiveRequest(self.clone());
        if before >= self.config.max_requests {
            let what = format!("this worker has {before} requests in progress");
            return Err(Fault::Overloaded { what, retry_after: RETRY });
        }
        Ok(active)
    }

    /// Number of requests in progress.
    pub(super) fn requests(&self) -> usize {
        self.requests.load(Ordering::Acquire)
    }

    /// A report for the coordinator.
    pub(super) fn report(&self) -> Report {
        // The status first: held samples are then at least as new as the assignment in effect.
        let mut report = self.status.report();
        self.render_thread.fill(&mut report);
        self.meter.fill(&mut report);
        let (frames_held, frames_bytes) = self.sources.held();
        (report.frames_held, report.frames_bytes) = (frames_held as u64, frames_bytes);
        report.light_cells = self.health.cells().map(Into::into);
        report
    }

    /// Cost of a view from triangles; `None` until it is measured.
    pub(super) fn direct_cost(&self) -> Option<Cost> {
        self.meter.direct_cost()
    }

    /// Counts a sample received from another worker, and the time of unpacking it.
    pub(super) fn received(&self, unpacking: Duration) {
        self.meter.add_received(unpacking);
    }
}

impl Drop for Node {
    /// Stops the render thread, also if the worker's future was dropped.
    fn drop(&mut self) {
        self.render_thread.stop();
    }
}

/// A request in progress, until it is dropped.
pub(super) struct ActiveRequest(Arc<Node>);

impl Drop for ActiveRequest {
    fn drop(&mut self) {
        self.0.requests.fetch_sub(1, Ordering::AcqRel);
    }
}
