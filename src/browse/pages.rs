//! The page, its scene description, its WebSocket, and single frames for scripts.

use std::sync::Arc;
use std::time::Duration;

use argus_client::{Client, ClientError, LightCells, RenderOptions};
use argus_scene::LightLevel;
use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::{WebSocketUpgrade, close_code};
use axum::extract::{DefaultBodyLimit, Path, RawQuery, Request, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde_json::{Value, json};

use super::access::Access;
use super::simulated_link::Wire;
use super::site::{MAX_FRAMES, MAX_PAGES, Site, jpeg, usual_camera};
use super::{assets, bridge, guard, messages, query};

/// Deadline of a single frame: the first one may wait for samples.
const PATIENCE: Duration = Duration::from_secs(60);

/// Longest token.
const MAX_TOKEN_BYTES: usize = 4096;

/// The header with a frame's description, [`messages::about`].
const ABOUT: HeaderName = HeaderName::from_static("argus-frame");

pub(super) fn router(site: Arc<Site>) -> Router {
    Router::new()
        .route("/", get(async || assets::page()))
        .route("/{file}", get(async |Path(name): Path<String>| assets::file(&name)))
        .route("/scene", get(scene))
        .route("/cells", get(cells))
        .route("/frame", get(frame))
        .route("/session", get(session))
        .route("/login", post(login))
        .fallback(async || assets::file(""))
        .layer(DefaultBodyLimit::max(MAX_TOKEN_BYTES))
        .layer(middleware::from_fn_with_state(site.clone(), of_this_machine))
        .with_state(site)
}

/// Rejects requests with another machine's host name, see [`guard::is_of_this_machine`].
async fn of_this_machine(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    if site.local && !guard::is_of_this_machine(request.headers(), request.uri().host()) {
        let reason = "open the page at the address that argus printed\n";
        return (StatusCode::MISDIRECTED_REQUEST, reason).into_response();
    }
    next.run(request).await
}

/// The client of a request, for the scene that its query names; or the answer to a request that has none.
async fn client_of(site: &Site, headers: &HeaderMap, query: Option<&str>) -> Result<Client, Response> {
    let Some(client) = site.access.client(headers).await else { return Err(log_in_first()) };
    let Some(scene) = query.and_then(query::scene) else { return Ok(client) };
    client.of_scene(&scene).await.map_err(|error| match error {
        ClientError::Invalid { .. } => reply(StatusCode::BAD_REQUEST, error),
        error => reply(StatusCode::BAD_GATEWAY, error),
    })
}

/// Opens a page's WebSocket.
async fn session(
    State(site): State<Arc<Site>>,
    headers: HeaderMap,
    RawQuery(asked): RawQuery,
    upgrade: WebSocketUpgrade,
) -> Response {
    if !guard::is_of_own_page(&headers) {
        return reply(StatusCode::FORBIDDEN, "only the page of this address may open a WebSocket here");
    }
    let client = match client_of(&site, &headers, asked.as_deref()).await {
        Ok(client) => client,
        Err(refused) => return refused,
    };
    let place = site.pages.clone().try_acquire_owned();
    let open = site.open.token();
    upgrade.max_message_size(bridge::MAX_MESSAGE_BYTES).max_frame_size(bridge::MAX_MESSAGE_BYTES).on_upgrade(
        async move |socket| {
            let _open = open;
            match place {
                Ok(_place) => bridge::run(socket, site, client).await,
                // A page cannot read why an upgrade failed, but it can read why a WebSocket was closed.
                Err(_) => {
                    let reason = format!("{MAX_PAGES} pages are open, the limit: close one of them");
                    bridge::close(&mut Wire::new(socket, None), close_code::AGAIN, &reason).await;
                }
            }
        },
    )
}

/// Logs in with the token in the request's body.
async fn login(State(site): State<Arc<Site>>, headers: HeaderMap, token: Bytes) -> Response {
    if !guard::is_of_own_page(&headers) {
        return reply(StatusCode::FORBIDDEN, "only the page of this address may log in here");
    }
    let Access::ByToken(logins) = &site.access else {
        return reply(StatusCode::NOT_FOUND, "this page needs no login");
    };
    let token = String::from_utf8_lossy(&token);
    match logins.enter(&token).await {
        Ok(cookie) => ([(header::SET_COOKIE, cookie)], StatusCode::NO_CONTENT).into_response(),
        Err(error @ ClientError::Refused { .. }) => reply(StatusCode::UNAUTHORIZED, error),
        Err(error) => reply(StatusCode::BAD_GATEWAY, error),
    }
}

/// The answer to a request without a login.
fn log_in_first() -> Response {
    reply(StatusCode::UNAUTHORIZED, "log in with your token first")
}

async fn scene(State(site): State<Arc<Site>>, headers: HeaderMap, RawQuery(asked): RawQuery) -> Response {
    let client = match client_of(&site, &headers, asked.as_deref()).await {
        Ok(client) => client,
        Err(refused) => return refused,
    };
    let about = client.description();
    let cameras: Vec<_> =
        about.cameras.iter().map(|named| json!({ "name": named.name, "camera": named.camera })).collect();
    let effects: Vec<_> = about
        .effect_plan
        .rows
        .iter()
        .map(|row| json!({ "effect": row.effect, "on": row.on, "why": row.why }))
        .collect();
    let scene = json!({
        "name": about.scene_name,
        "scene": client.scene().or(about.scenes.first().map(String::as_str)),
        "scenes": about.scenes,
        "triangles": about.triangles,
        "min": about.bounds.min,
        "max": about.bounds.max,
        "animated": about.epoch_secs > 0.0,
        "light": about.light,
        "light_rises": about.first_light == LightLevel::Direct,
        "cameras": cameras,
        "effects": effects,
    });
    ([(header::CONTENT_TYPE, "application/json")], scene.to_string()).into_response()
}

/// The light cells of all workers together, as in the cluster's status; `null` without any.
async fn cells(State(site): State<Arc<Site>>, headers: HeaderMap, RawQuery(asked): RawQuery) -> Response {
    let client = match client_of(&site, &headers, asked.as_deref()).await {
        Ok(client) => client,
        Err(refused) => return refused,
    };
    let status = match client.status().await {
        Ok(status) => status,
        Err(error) => return reply(StatusCode::BAD_GATEWAY, error),
    };
    let of_workers: Vec<_> = status.workers.iter().filter_map(|worker| worker.light_cells).collect();
    let sum = |count: fn(&LightCells) -> u64| of_workers.iter().map(count).sum::<u64>();
    let (pixels, pixels_lit) = (sum(|cells| cells.pixels), sum(|cells| cells.pixels_lit));
    let all = (!of_workers.is_empty()).then(|| {
        json!({
            "pages": sum(|cells| cells.pages),
            "bytes": sum(|cells| cells.bytes),
            "waiting": sum(|cells| cells.waiting),
            "fill_ms": of_workers.iter().map(|cells| cells.fill_ms).sum::<f64>(),
            "lit_share": LightCells { pixels, pixels_lit, ..LightCells::default() }.lit_share(),
        })
    });
    ([(header::CONTENT_TYPE, "application/json")], json!(all).to_string()).into_response()
}

async fn frame(State(site): State<Arc<Site>>, headers: HeaderMap, RawQuery(asked): RawQuery) -> Response {
    let client = match client_of(&site, &headers, asked.as_deref()).await {
        Ok(client) => client,
        Err(refused) => return refused,
    };
    let view = query::view(&asked.unwrap_or_default(), usual_camera(&client), &site.plan).and_then(|view| {
        view.validate(&client.description().limits)?;
        Ok(view)
    });
    let view = match view {
        Ok(view) => view,
        Err(reason) => return reply(StatusCode::BAD_REQUEST, reason),
    };
    let Ok(_turn) = site.frames.try_acquire() else {
        return reply(
            StatusCode::SERVICE_UNAVAILABLE,
            format!("{MAX_FRAMES} frames are in work, the limit: try again later"),
        );
    };
    let options = RenderOptions { deadline: PATIENCE, ..RenderOptions::default() };
    let answer = match client.render(&view, &options).await {
        Ok(answer) => answer,
        Err(error @ ClientError::Invalid { .. }) => return reply(StatusCode::BAD_REQUEST, error),
        Err(error @ ClientError::Overloaded { .. }) => return reply(StatusCode::SERVICE_UNAVAILABLE, error),
        Err(error) => return reply(StatusCode::BAD_GATEWAY, error),
    };
    let about = Value::Object(messages::about(&answer.frame, &answer.meta)).to_string();
    let image =
        tokio::task::spawn_blocking(move || jpeg(&answer.frame, messages::Form::default().quality)).await;
    match image {
        Ok(Ok(image)) => {
            let headers = [
                (header::CONTENT_TYPE, "image/jpeg".to_owned()),
                (header::CACHE_CONTROL, "no-store".to_owned()),
                (ABOUT, about),
            ];
            (headers, image).into_response()
        }
        Ok(Err(error)) => reply(StatusCode::BAD_GATEWAY, error),
        Err(error) => reply(StatusCode::INTERNAL_SERVER_ERROR, error),
    }
}

fn reply(status: StatusCode, reason: impl ToString) -> Response {
    (status, format!("{}\n", reason.to_string())).into_response()
}
