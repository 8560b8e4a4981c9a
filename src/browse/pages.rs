//! The page, what it needs to know of the scene, and its frames.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use argus_client::{Answer, Client, ClientError, RenderOptions};
use argus_scene::{Plan, PlanRequest};
use axum::Router;
use axum::extract::{RawQuery, Request, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use serde_json::json;
use tokio::sync::Semaphore;

use super::query;

/// Views that are asked for at a time, of all pages together.
const IN_FLIGHT: usize = 16;

/// How long a page waits for an image: the first one of an interior waits for its samples.
const PATIENCE: Duration = Duration::from_secs(60);

const QUALITY: u8 = 90;

/// What came with a frame, as JSON.
const ABOUT: HeaderName = HeaderName::from_static("argus-frame");

/// What pages are made from.
pub(super) struct Site {
    client: Client,
    plan: PlanRequest,
    /// Only this machine can reach it.
    local: bool,
    room: Semaphore,
}

impl Site {
    pub(super) fn new(client: Client, plan: PlanRequest, local: bool) -> Self {
        Self { client, plan, local, room: Semaphore::new(IN_FLIGHT) }
    }
}

pub(super) fn router(site: Arc<Site>) -> Router {
    Router::new()
        .route("/", get(async || Html(include_str!("page.html"))))
        .route("/scene", get(scene))
        .route("/frame", get(frame))
        .fallback(async || (StatusCode::NOT_FOUND, "there is /, /scene and /frame\n"))
        .layer(middleware::from_fn_with_state(site.clone(), of_this_machine))
        .with_state(site)
}

/// Turns away what was sent to a name that is not this machine's: a page from elsewhere could have its own name point here, and
/// look at what only this client may see.
async fn of_this_machine(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    if site.local && !is_of_this_machine(request.headers(), request.uri().host()) {
        let reason = "open the page by the address that it was announced with\n";
        return (StatusCode::MISDIRECTED_REQUEST, reason).into_response();
    }
    next.run(request).await
}

fn is_of_this_machine(headers: &HeaderMap, authority: Option<&str>) -> bool {
    let named = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let Some(host) = named.or(authority) else { return false };
    // [::1]:7480, 127.0.0.1:7480, localhost
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

async fn scene(State(site): State<Arc<Site>>) -> Response {
    let about = site.client.description();
    let cameras: Vec<_> =
        about.cameras.iter().map(|named| json!({ "name": named.name, "camera": named.camera })).collect();
    let scene = json!({
        "name": about.scene_name,
        "triangles": about.triangles,
        "min": about.bounds.min,
        "max": about.bounds.max,
        "animated": about.epoch_secs > 0.0,
        "cameras": cameras,
    });
    ([(header::CONTENT_TYPE, "application/json")], scene.to_string()).into_response()
}

async fn frame(State(site): State<Arc<Site>>, RawQuery(asked): RawQuery) -> Response {
    let view = match query::view(&asked.unwrap_or_default(), &site.plan, &site.client) {
        Ok(view) => view,
        Err(reason) => return told(StatusCode::BAD_REQUEST, reason),
    };
    let Ok(_turn) = site.room.try_acquire() else {
        return told(StatusCode::SERVICE_UNAVAILABLE, format!("{IN_FLIGHT} views are waited for already"));
    };
    let options = RenderOptions { deadline: PATIENCE, ..RenderOptions::default() };
    let answer = match site.client.render(&view, &options).await {
        Ok(answer) => answer,
        Err(error @ ClientError::Invalid { .. }) => return told(StatusCode::BAD_REQUEST, error),
        Err(error @ ClientError::Overloaded { .. }) => return told(StatusCode::SERVICE_UNAVAILABLE, error),
        Err(error) => return told(StatusCode::BAD_GATEWAY, error),
    };
    let about = about(&answer);
    let image = tokio::task::spawn_blocking(move || jpeg(&answer)).await;
    match image {
        Ok(Ok(image)) => {
            let headers = [
                (header::CONTENT_TYPE, "image/jpeg".to_owned()),
                (header::CACHE_CONTROL, "no-store".to_owned()),
                (ABOUT, about),
            ];
            (headers, image).into_response()
        }
        Ok(Err(error)) => told(StatusCode::BAD_GATEWAY, error),
        Err(error) => told(StatusCode::INTERNAL_SERVER_ERROR, error),
    }
}

fn told(status: StatusCode, reason: impl ToString) -> Response {
    (status, format!("{}\n", reason.to_string())).into_response()
}

/// What the page shows beside the image.
fn about(answer: &Answer) -> String {
    let frame = &answer.frame;
    let (search, samples) = match &frame.provenance.plan {
        Plan::Direct { .. } => ("direct", 0),
        Plan::Warp(warp) => (warp.search.name(), warp.samples.len()),
    };
    let about = json!({
        "search": search,
        "samples": samples,
        "unresolved_fraction": frame.unresolved_fraction,
        "rendering_ms": frame.rendering_ms(),
        "age_ms": answer.meta.age_ms,
        "epoch": frame.provenance.epoch,
    });
    about.to_string()
}

fn jpeg(answer: &Answer) -> anyhow::Result<Vec<u8>> {
    let frame = &answer.frame;
    let Some(color) = &frame.color else { anyhow::bail!("the frame has no colour") };
    let mut image = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut image, QUALITY);
    encoder.encode(color, frame.width, frame.height, ExtendedColorType::Rgb8)?;
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_may_point_anywhere_are_not_this_machines() {
        let of = |host: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, host.parse().unwrap());
            is_of_this_machine(&headers, None)
        };
        for host in ["127.0.0.1:7480", "localhost", "LOCALHOST:7480", "[::1]:7480", "127.8.0.1"] {
            assert!(of(host), "{host}");
        }
        for host in [
            "example.org",
            "example.org:7480",
            "localhost.example.org",
            "192.0.2.1:7480",
            "[2001:db8::1]",
            "",
        ] {
            assert!(!of(host), "{host}");
        }
        assert!(!is_of_this_machine(&HeaderMap::new(), None));
    }
}
