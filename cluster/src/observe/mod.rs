//! Monitoring of a process: metrics, readiness and liveness, on the port of its gRPC services.
//!
//! `GET /metrics` answers in the OpenMetrics text format. `GET /readyz` answers 200 if a view can be answered, else
//! 503 with the reason. `GET /livez` fails only for a wedged process that should be restarted. The standard gRPC
//! health service agrees: the service name `""` and the offered services are readiness, [`LIVE`] is liveness.

mod exposition;
mod http;

use std::sync::Arc;
use std::time::Duration;

use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

pub(crate) use exposition::{Exposition, SceneRow};
pub(crate) use http::with_pages;

/// The service name of liveness in the gRPC health service.
pub const LIVE: &str = "live";

/// The prefix of every metric's name.
pub(crate) const PREFIX: &str = "argus";

/// Interval between updates of the gRPC health service.
const LOOK: Duration = Duration::from_millis(100);

/// A process that can be monitored.
pub(crate) trait Monitored: Send + Sync + 'static {
    /// Whether it can answer a view, or the reason why not.
    fn ready(&self) -> Result<(), String>;
    /// Whether it makes progress, or the reason why not.
    fn live(&self) -> Result<(), String>;
    /// Writes its metrics.
    fn expose(&self, exposition: &mut Exposition<'_>) -> std::fmt::Result;
}

/// Keeps the gRPC health service up to date, for `services` and for the process.
///
/// The status is correct once this returns, before any request. The returned future keeps it so, and never ends.
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
