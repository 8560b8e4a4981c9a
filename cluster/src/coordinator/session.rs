//! A session: one moving camera. The newest position wins, frames are acknowledged, nobody gets stale ones.
//!
//! Cameras go into a slot of capacity one: a camera that is still there when the next one comes was never
//! rendered and is counted as superseded. One view is in work at a time, and few frames are on their way to the
//! client unacknowledged (`inbox`), so that a slow client gets fewer frames instead of older ones. A client that
//! can reach workers is sent there for its frames (`redirect`), one at a time.

use std::sync::Arc;

use argus_proto::status::invalid;
use argus_proto::trace::{TARGET, continued_from};
use argus_proto::v1::session_response::Body;
use argus_proto::{Fault, v1};
use argus_scene::{InvalidField, Search, View};
use futures::{Stream, StreamExt};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use tonic::{Status, Streaming};
use tracing::debug_span;

use super::checks::{checked, checked_encoding};
use super::drive::{Answer, answer};
use super::failure::failure;
use super::shared_core::SharedCore;
use super::inbox::{Inbox, SessionCamera};
use super::memory::SessionMemory;
use super::redirect::{Redirects, SessionClient};
use super::view_request::ViewRequest;
use crate::core::{Client, Event};

/// Counts the session while it lasts.
pub(super) struct Open {
    shared: Arc<SharedCore>,
    client: Client,
}

impl Open {
    /// # Errors
    /// If the client may not open one now.
    pub(super) fn new(shared: Arc<SharedCore>, client: Client) -> Result<Self, Fault> {
        shared.open_session(&client)?;
        Ok(Self { shared, client })
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.shared.step(Event::SessionClosed { client: self.client.clone() });
    }
}

/// What a session keeps from one of its views to the next.
#[derive(Default)]
struct Kept {
    redirects: Redirects,
    memory: SessionMemory,
    /// Names what its frames leave at workers, once one shall leave something.
    history: Option<String>,
}

/// Answers the cameras of one client until it closes its side, or the coordinator closes.
pub(super) fn run(
    open: Open,
    requests: Streaming<v1::SessionRequest>,
) -> impl Stream<Item = Result<v1::SessionResponse, Status>> {
    async_stream::try_stream! {
        let shared = open.shared.clone();
        shared.check_leading()?;
        let inbox = Inbox::default();
        let reader = listen(&shared, requests, &inbox);
        tokio::pin!(reader);
        let mut reading = true;
        let mut kept = Kept::default();
        loop {
            // Listening goes on within this task, so that it ends with it.
            // It comes first: what has arrived meanwhile overtakes what waits.
            let camera = tokio::select! {
                biased;
                () = &mut reader, if reading => { reading = false; continue }
                camera = inbox.camera() => camera,
                () = shared.closing.cancelled() => None,
            };
            let Some(camera) = camera else { return };
            let camera_seq = camera.0;
            // In memory of its own: most sessions wait for a camera most of the time.
            let mut answers = Box::pin(answers(&open, camera, &inbox, &mut kept));
            let mut failed = false;
            loop {
                let answer = tokio::select! {
                    answer = answers.next() => answer,
                    () = &mut reader, if reading => { reading = false; continue }
                };
                let Some(body) = answer else { break };
                if matches!(body, Body::Failure(_)) {
                    failed = true;
                    // Another coordinator leads now: the session is to be opened there, and nothing has failed.
                    shared.check_leading()?;
                }
                yield v1::SessionResponse { camera_seq, superseded: inbox.superseded(), body: Some(body) };
            }
            if failed {
                inbox.failed(camera_seq);
            }
        }
    }
}

/// Puts what the client says into the inbox, until it says no more.
async fn listen(shared: &SharedCore, mut requests: Streaming<v1::SessionRequest>, inbox: &Inbox) {
    while let Ok(Some(request)) = requests.message().await {
        if inbox.receive(request) {
            shared.step(Event::CameraSuperseded);
        }
    }
    inbox.close();
}

/// A name for what a session's frames leave at workers, that no other session has.
fn drawn_name() -> String {
    format!("{:032x}", SmallRng::from_os_rng().random::<u128>())
}

/// A view whose search may begin from an earlier frame: by the one search that can.
fn begun_from_history(mut view: View) -> Result<View, InvalidField> {
    let reason = match view.plan.search {
        _ if view.pin.is_some() => {
            "a pinned frame is repeated, and none that began from an earlier one can be".to_owned()
        }
        _ if view.plan.direct => "a view from the triangles is not searched".to_owned(),
        Some(search) if search != Search::Seeded => {
            format!("only the seeded search begins from an earlier frame, not the search `{}`", search.name())
        }
        _ => {
            view.plan.search = Some(Search::Seeded);
            return Ok(view);
        }
    };
    Err(InvalidField::new("history", reason))
}

/// The frame of one camera, or where to fetch it, or its failure.
fn answers<'a>(
    open: &'a Open,
    camera: SessionCamera,
    inbox: &'a Inbox,
    kept: &'a mut Kept,
) -> impl Stream<Item = Body> + use<'a> {
    async_stream::stream! {
        let (camera_seq, redirectable) = (camera.0, camera.1.redirectable);
        let request = match view_request(open, camera, kept) {
            Ok(request) => request,
            Err(at) => {
                yield Body::Failure(failure(&invalid(at)));
                return;
            }
        };
        let client = SessionClient::new(&mut kept.redirects, &mut kept.memory, inbox, camera_seq, redirectable);
        for await answer in answer(open.shared.clone(), request, Some(client)) {
            yield match answer {
                Ok(Answer::Chunk(chunk)) => Body::Chunk(chunk),
                Ok(Answer::Redirect(redirect)) => Body::Redirect(redirect),
                Err(status) => Body::Failure(failure(&status)),
            };
        }
    }
}

/// The view that a session's client asks for with a camera.
fn view_request(
    open: &Open,
    (seq, asked, arrived): SessionCamera,
    kept: &mut Kept,
) -> Result<ViewRequest, InvalidField> {
    let view = checked(&open.shared, asked.view.as_ref())?;
    let view = if asked.history { begun_from_history(view)? } else { view };
    let encoding = checked_encoding(asked.encoding)?;
    let span = debug_span!(target: TARGET, "relay", camera = seq);
    continued_from(&span, &asked.traceparent);
    let history = match asked.history {
        true => kept.history.get_or_insert_with(drawn_name).clone(),
        false => String::new(),
    };
    Ok(ViewRequest {
        client: open.client.clone(),
        view,
        wire: asked.view.unwrap_or_default(),
        view_id: seq.to_string(),
        deadline: None,
        encoding,
        history,
        arrived,
        span,
    })
}
