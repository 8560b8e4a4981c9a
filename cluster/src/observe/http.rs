//! The HTTP pages of a process, on the port of its gRPC services.

use std::fmt;
use std::sync::Arc;

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, text};
use prometheus_client::registry::Registry;
use tonic::service::Routes;

use super::{Exposition, Monitored};

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The sources of the pages.
#[derive(Clone)]
struct Pages {
    monitored: Arc<dyn Monitored>,
    registry: Arc<Registry>,
}

/// Adds `/metrics`, `/readyz` and `/livez` to the services. `recorded` holds metrics that are recorded as they
/// happen, such as histograms.
pub(crate) fn with_pages(services: Routes, monitored: Arc<dyn Monitored>, mut recorded: Registry) -> Routes {
    recorded.register_collector(Box::new(ComputedMetrics(monitored.clone())));
    let pages = Pages { monitored, registry: Arc::new(recorded) };
    let pages = Router::new()
        .route("/metrics", get(metrics))
        .route("/readyz", get(async |State(pages): State<Pages>| answer(pages.monitored.ready(), "ready")))
        .route("/livez", get(async |State(pages): State<Pages>| answer(pages.monitored.live(), "live")))
        .with_state(pages);
    let mut services = services.prepare();
    let router = services.axum_router_mut();
    *router = std::mem::take(router).merge(pages);
    services
}

async fn metrics(State(pages): State<Pages>) -> Response {
    let mut text = String::new();
    match text::encode(&mut text, &pages.registry) {
        Ok(()) => ([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

fn answer(well: Result<(), String>, word: &'static str) -> Response {
    match well {
        Ok(()) => (StatusCode::OK, format!("{word}\n")).into_response(),
        Err(reason) => (StatusCode::SERVICE_UNAVAILABLE, format!("{reason}\n")).into_response(),
    }
}

/// Metrics that are computed when they are scraped.
struct ComputedMetrics(Arc<dyn Monitored>);

impl fmt::Debug for ComputedMetrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ComputedMetrics")
    }
}

impl Collector for ComputedMetrics {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
        self.0.expose(&mut Exposition::new(encoder))
    }
}
