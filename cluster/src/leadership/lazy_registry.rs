//! A registry that connects when it is first used.

use std::time::Duration;

use tokio::sync::OnceCell;
use tracing::warn;

use super::{HeldLease, NatsAccess, NatsRegistry, Registry, RegistryError};
use crate::rate_limited_log::RateLimitedLog;

/// A registry in NATS that connects when it is first used, and retries with each use. So processes may start in any
/// order: until it answers, a coordinator is on standby and says so.
#[derive(Debug)]
pub struct LazyRegistry {
    url: String,
    lease: Duration,
    access: NatsAccess,
    there: OnceCell<NatsRegistry>,
}

impl LazyRegistry {
    /// A registry with the arguments of [`NatsRegistry::connect_as`]; it does not connect yet.
    pub fn new(url: &str, lease: Duration, access: NatsAccess) -> Self {
        Self { url: url.to_owned(), lease, access, there: OnceCell::new() }
    }

    async fn there(&self) -> Result<&NatsRegistry, RegistryError> {
        let connected = self
            .there
            .get_or_try_init(|| NatsRegistry::connect_as(&self.url, self.lease, self.access.clone()))
            .await;
        connected.inspect_err(|error| {
            static ABSENT: RateLimitedLog = RateLimitedLog::new();
            if let Some(left_out) = ABSENT.now() {
                warn!(%error, left_out, "the registry does not answer yet; retrying");
            }
        })
    }
}

#[tonic::async_trait]
impl Registry for LazyRegistry {
    fn lease(&self) -> Option<Duration> {
        self.there.get().map_or(Some(self.lease), Registry::lease)
    }

    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        self.there().await?.acquire(address).await
    }

    async fn renew(&self, held: HeldLease, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        self.there().await?.renew(held, address).await
    }

    async fn release(&self, held: HeldLease) {
        if let Some(there) = self.there.get() {
            there.release(held).await;
        }
    }

    async fn leader(&self) -> Option<String> {
        self.there.get()?.leader().await
    }

    async fn note_workers(&self, names: &[String]) {
        if let Some(there) = self.there.get() {
            there.note_workers(names).await;
        }
    }

    async fn noted_workers(&self) -> Vec<String> {
        match self.there.get() {
            Some(there) => there.noted_workers().await,
            None => Vec::new(),
        }
    }
}
