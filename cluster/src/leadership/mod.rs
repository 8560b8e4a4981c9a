//! Who of several coordinators leads, and who is there: at most one leads at a time, each time under a higher term.
//!
//! A leader holds a *lease*, which lapses unless it is renewed. It stops leading before its lease can have lapsed,
//! counted from before its last renewal was asked for, and nobody gets the lease before: so two never assign at the same
//! time as long as clocks *run* alike; what they show does not matter. Should one's clock stand still all the same (a
//! stopped process that goes on), what it still says carries a lower term than its successor's, and workers refuse it.

mod lazy_registry;
mod local;
mod nats;

use std::time::Duration;

pub use lazy_registry::LazyRegistry;
pub use local::LocalRegistry;
pub use nats::{NatsAccess, NatsRegistry, NatsSecret, NatsTls, nats_host};

/// The lease, held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeldLease {
    /// Of this leadership; higher than that of any before.
    pub term: u64,
    /// What the registry knows this state of the lease by; changes with each renewal.
    pub revision: u64,
}

/// Where coordinators agree who leads, and what workers there are.
#[tonic::async_trait]
pub trait Registry: Send + Sync + std::fmt::Debug + 'static {
    /// How long a lease lasts from the last time that it was acquired or renewed; `None`: for ever.
    fn lease(&self) -> Option<Duration>;

    /// Takes the lease, in the name of the coordinator that is reached at `address`; `None`: another one holds it.
    ///
    /// # Errors
    /// [`RegistryError`] if it is not known whether it was taken; who took it is then asked to renew in vain.
    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError>;

    /// Goes on holding the lease; `None`: it lapsed, or another one holds it.
    ///
    /// # Errors
    /// [`RegistryError`] if that cannot be told now.
    async fn renew(&self, held: HeldLease, address: &str) -> Result<Option<HeldLease>, RegistryError>;

    /// Gives the lease up, so that another one need not wait for it to lapse.
    async fn release(&self, held: HeldLease);

    /// The address of whoever holds the lease, for people: it may be out of date.
    async fn leader(&self) -> Option<String>;

    /// Writes down what workers have joined the leader. It may be lost; a successor then waits for fewer.
    async fn note_workers(&self, names: &[String]);

    /// What workers the last leader had.
    async fn noted_workers(&self) -> Vec<String>;
}

/// A registry that does not answer, or not as it should.
#[derive(Debug, Clone, thiserror::Error)]
#[error("the registry at {url}: {reason}")]
pub struct RegistryError {
    /// Where it is.
    pub url: String,
    /// What it said, or did not.
    pub reason: String,
}
