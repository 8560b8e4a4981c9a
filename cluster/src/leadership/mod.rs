//! Leader election between coordinators: at most one leads at a time, each time under a higher term.
//!
//! A leader holds a *lease*, which lapses unless it is renewed. The leader stops before the lease can lapse, counted
//! from before its last renewal was requested, and no other coordinator gets the lease earlier. So two never lead at
//! the same time, provided that clocks *run* at the same speed; the times that they show do not matter. If a stopped
//! process continues after its lease, its messages carry a lower term than its successor's, and workers refuse them.

mod lazy_registry;
mod local;
mod nats;

use std::time::Duration;

pub use lazy_registry::LazyRegistry;
pub use local::LocalRegistry;
pub use nats::{NatsAccess, NatsRegistry, NatsSecret, NatsTls, nats_host};

/// A held lease.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeldLease {
    /// The term of this leadership, higher than any earlier one.
    pub term: u64,
    /// The registry's revision of the lease, which changes with each renewal.
    pub revision: u64,
}

/// The registry in which coordinators agree on the leader, and record the workers.
#[tonic::async_trait]
pub trait Registry: Send + Sync + std::fmt::Debug + 'static {
    /// Duration of a lease since it was acquired or renewed; `None`: it never lapses.
    fn lease(&self) -> Option<Duration>;

    /// Acquires the lease for the coordinator at `address`; `None`: another one holds it.
    ///
    /// # Errors
    /// [`RegistryError`] if the result is unknown. The lease may then be held until it lapses.
    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError>;

    /// Renews the lease; `None`: it lapsed, or another coordinator holds it.
    ///
    /// # Errors
    /// [`RegistryError`] if the result is unknown.
    async fn renew(&self, held: HeldLease, address: &str) -> Result<Option<HeldLease>, RegistryError>;

    /// Releases the lease, so that another coordinator can acquire it at once.
    async fn release(&self, held: HeldLease);

    /// The address of the present leader, for messages; it may be out of date.
    async fn leader(&self) -> Option<String>;

    /// Records the names of the joined workers. A lost record only means that a successor expects fewer workers.
    async fn note_workers(&self, names: &[String]);

    /// The recorded workers of the last leader.
    async fn noted_workers(&self) -> Vec<String>;
}

/// A failure of the registry.
#[derive(Debug, Clone, thiserror::Error)]
#[error("the registry at {url}: {reason}")]
pub struct RegistryError {
    /// Its address.
    pub url: String,
    /// What failed.
    pub reason: String,
}
