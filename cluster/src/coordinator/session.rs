//! Sessions: one moving camera, whose newest position wins.
//!
//! Cameras go into a slot of capacity one. A camera that is replaced there is counted as superseded. One view is in
//! work at a time, and few frames are unacknowledged (`inbox`), so a slow client gets fewer frames and never stale
//! ones. A client that can reach workers is redirected to them (`redirect`), one frame at a time.

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
use super::inbox::{Inbox, SessionCamera};
use super::memory::SessionMemory;
use super::redirect::{Redirects, SessionClient};
use super::shared_core::SharedCore;
use super::view_request::ViewRequest;
use crate::core::{Client, Event};

/// An open session, which counts against its client's limit until it is dropped.
pub(super) struct Open {
    shared: Arc<SharedCore>,
    client: Client,
}

impl Open {
    /// # Errors
    /// [`Fault::Overloaded`] beyond a limit, [`Fault::Unavailable`] while draining.
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

/// State that a session keeps between its views.
#[derive(Default)]
struct Kept {
    redirects: Redirects,
    memory: SessionMemory,
    /// The key of this session's frame histories at workers, once one was requested.
    history: Option<String>,
}

/// Answers the cameras of one client until it closes its side or the coordinator shuts down.
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
            // Messages are read within this task, so that reading ends with it. Reading comes first, so that new
            // cameras supersede waiting ones.
            let camera = tokio::select! {
                biased;
                () = &mut reader, if reading => { reading = false; continue }
                camera = inbox.camera() => camera,
                () = shared.closing.cancelled() => None,
            };
            let Some(camera) = camera else { return };
            let camera_seq = camera.0;
            // Boxed, since most sessions wait for a camera most of the time.
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
                    // Another coordinator leads now, where the client must open its session anew.
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

/// Reads the client's messages into the inbox until the client closes its side.
async fn listen(shared: &SharedCore, mut requests: Streaming<v1::SessionRequest>, inbox: &Inbox) {
    while let Ok(Some(request)) = requests.message().await {
        if inbox.receive(request) {
            shared.step(Event::CameraSuperseded);
        }
    }
    inbox.close();
}

/// A random key for a session's frame histories at workers.
fn drawn_name() -> String {
    format!("{:032x}", SmallRng::from_os_rng().random::<u128>())
}

/// A view that may be reprojected from an earlier frame, which only the seeded search can.
fn with_history(mut view: View) -> Result<View, InvalidField> {
    let reason = match view.plan.search {
        _ if view.pin.is_some() => {
            "a pinned frame must be repeatable, and reprojected frames are not".to_owned()
        }
        _ if view.plan.direct => "direct views use no search".to_owned(),
        Some(search) if search != Search::Seeded => {
            format!("only the search `seeded` can use an earlier frame, not `{}`", search.name())
        }
        _ => {
            view.plan.search = Some(Search::Seeded);
            return Ok(view);
        }
    };
    Err(InvalidField::new("history", reason))
}

/// The answers to one camera: chunks of its frame, redirects, or a failure.
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

/// The request for the view of a session's camera.
fn view_request(
    open: &Open,
    (seq, asked, arrived): SessionCamera,
    kept: &mut Kept,
) -> Result<ViewRequest, InvalidField> {
    let view = checked(&open.shared, asked.view.as_ref())?;
    let view = if asked.history { with_history(view)? } else { view };
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
