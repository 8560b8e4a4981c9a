//! A registry within one process: for a single coordinator, and for tests.

use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use parking_lot::Mutex;
use tokio::time::Instant;

use super::{HeldLease, Registry, RegistryError};

/// A registry within one process. Clones share it.
#[derive(Debug, Clone)]
pub struct LocalRegistry {
    lease: Option<Duration>,
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    /// The term of the next leader.
    next_term: u64,
    revision: u64,
    holder: Option<Holder>,
    workers: Vec<String>,
}

#[derive(Debug)]
struct Holder {
    held: HeldLease,
    address: String,
    renewed: Instant,
}

impl LocalRegistry {
    /// For a single coordinator: it leads at once, and its lease never lapses. The term is the milliseconds since
    /// 1970, so that it is higher after a restart.
    pub fn alone() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self::alone_under(u64::try_from(since.as_millis()).unwrap_or(u64::MAX))
    }

    /// For a single coordinator, with a given term.
    pub fn alone_under(term: u64) -> Self {
        Self::new(term, None)
    }

    /// For several coordinators. The first leader has the term `first_term`.
    pub fn shared(first_term: u64, lease: Duration) -> Self {
        Self::new(first_term, Some(lease))
    }

    fn new(next_term: u64, lease: Option<Duration>) -> Self {
        let state = State { next_term, revision: 0, holder: None, workers: Vec::new() };
        Self { lease, state: Arc::new(Mutex::new(state)) }
    }
}

impl State {
    fn forget_the_lapsed(&mut self, lease: Option<Duration>) {
        let lapsed = |holder: &Holder| lease.is_some_and(|lease| holder.renewed.elapsed() >= lease);
        if self.holder.as_ref().is_some_and(lapsed) {
            self.holder = None;
        }
    }
}

#[tonic::async_trait]
impl Registry for LocalRegistry {
    fn lease(&self) -> Option<Duration> {
        self.lease
    }

    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        let mut state = self.state.lock();
        state.forget_the_lapsed(self.lease);
        if state.holder.is_some() {
            return Ok(None);
        }
        state.revision += 1;
        let held = HeldLease { term: state.next_term, revision: state.revision };
        state.next_term = state.next_term.saturating_add(1);
        state.holder = Some(Holder { held, address: address.to_owned(), renewed: Instant::now() });
        Ok(Some(held))
    }

    async fn renew(&self, held: HeldLease, _address: &str) -> Result<Option<HeldLease>, RegistryError> {
        let mut state = self.state.lock();
        state.forget_the_lapsed(self.lease);
        state.revision += 1;
        let revision = state.revision;
        let Some(holder) = state.holder.as_mut().filter(|holder| holder.held == held) else {
            return Ok(None);
        };
        holder.held.revision = revision;
        holder.renewed = Instant::now();
        Ok(Some(holder.held))
    }

    async fn release(&self, held: HeldLease) {
        let mut state = self.state.lock();
        if state.holder.as_ref().is_some_and(|holder| holder.held == held) {
            state.holder = None;
        }
    }

    async fn leader(&self) -> Option<String> {
        let mut state = self.state.lock();
        state.forget_the_lapsed(self.lease);
        state.holder.as_ref().map(|holder| holder.address.clone())
    }

    async fn note_workers(&self, names: &[String]) {
        self.state.lock().workers = names.to_vec();
    }

    async fn noted_workers(&self) -> Vec<String> {
        self.state.lock().workers.clone()
    }
}
