//! What people and machines watch a process by: metrics, readiness and liveness, beside its gRPC services and
//! on their port.
//!
//! `GET /metrics` is in the OpenMetrics text format, `GET /readyz` answers 200 once a view can be answered and 503 with
//! the reason while none can, `GET /livez` fails only for a process that is wedged and gains from being started again.
//! The standard gRPC health service says the same: the service names `""` and those that are offered are readiness,
//! [`LIVE`] is liveness.

mod exposition;
mod http;

use std::sync::Arc;
use std::time::Duration;

use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

pub(crate) use exposition::Exposition;
pub(crate) use http::with_pages;

/// The name under which the gRPC health service answers for liveness.
pub const LIVE: &str = "live";

/// What the name of every metric begins with.
pub(crate) const PREFIX: &str = "argus";

/// How soon a change of readiness shows.
const LOOK: Duration = Duration::from_millis(100);

/// A process that can be monitored.
pub(crate) trait Monitored: Send + Sync + 'static {
    /// Whether it can answer a view, or why not.
    fn ready(&self) -> Result<(), String>;
    /// Whether it still gets on with its work, or how it does not.
    fn live(&self) -> Result<(), String>;
    /// Writes what it counts and measures.
    fn expose(&self, exposition: &mut Exposition<'_>) -> std::fmt::Result;
}

/// Keeps the gRPC health service true, for `services` and for the process as a whole.
///
/// It is true once this returns, so that nobody asks before it is; the future that it returns keeps it so and never ends.
pub(crate) async fn keep_health(
    monitored: Arc<dyn Monitored>,
    health: HealthReporter,
    services: &[&str],
) -> impl Future<Output = ()> {
    tell_health(&*monitored, &health, services).await;
    async move {
        let mut interval = tokio::time::interval(LOOK);
        loop {
            interval.tick().await;
            tell_health(&*monitored, &health, services).await;
        }
    }
}

async fn tell_health(monitored: &dyn Monitored, health: &HealthReporter, services: &[&str]) {
    let status = |well: Result<(), String>| match well {
        Ok(()) => ServingStatus::Serving,
        Err(_) => ServingStatus::NotServing,
    };
    let ready = status(monitored.ready());
    for service in std::iter::once(&"").chain(services) {
        health.set_service_status(*service, ready).await;
    }
    health.set_service_status(LIVE, status(monitored.live())).await;
}
