//! Drives the state machine of one view: waits for its next event, and executes the commands that follow.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::v1;
use argus_proto::v1::views_client::ViewsClient;
use futures::Stream;
use tonic::{Status, Streaming};
use tracing::{Instrument, debug};

use super::inbox::ClientNotice;
use super::redirect::SessionClient;
use super::shared_core::{CoreReply, Instruction, SharedCore};
use super::view_handle::ViewHandle;
use super::view_path::{Answered, Command, Event, State, ViewPath};
use super::view_request::ViewRequest;
use crate::core::Order;

/// How long to wait for the end of a worker's stream after the whole frame arrived.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// One part of the answer to a view.
#[allow(clippy::large_enum_variant, reason = "most are chunks, and a box for each would cost more")]
pub(super) enum Answer {
    /// A chunk of the frame.
    Chunk(v1::FrameChunk),
    /// Where to fetch the frame.
    Redirect(v1::Redirect),
}

/// Answers a view: the chunks of its frame, a redirect, or an error as the last item. Dropping the stream cancels the
/// view. With `client`, the client may be redirected to workers.
pub(super) fn answer<'a>(
    shared: Arc<SharedCore>,
    request: ViewRequest,
    client: Option<SessionClient<'a>>,
) -> impl Stream<Item = Result<Answer, Status>> + use<'a> {
    async_stream::stream! {
        let mut view = ViewDriver::new(shared, request, client);
        while !matches!(view.path.state(), State::Done) {
            let event = view.next().await;
            for command in view.path.step(event) {
                match command {
                    Command::Send(chunk) => yield Ok(Answer::Chunk(chunk)),
                    Command::Redirect(redirect) => yield Ok(Answer::Redirect(redirect)),
                    Command::Fail(status) => {
                        view.shared.client_metrics.ended(&view.request.client, status.code());
                        yield Err(status);
                    }
                    Command::CloseStream => view.close_stream().await,
                    command => view.execute(command),
                }
            }
        }
    }
}

/// The driver of one view. Dropping it cancels the view, unless its path has ended.
struct ViewDriver<'a> {
    shared: Arc<SharedCore>,
    request: ViewRequest,
    client: Option<SessionClient<'a>>,
    handle: ViewHandle,
    path: ViewPath,
    /// The stream of the ordered worker, once it is open.
    stream: Option<Streaming<v1::FrameChunk>>,
}

impl<'a> ViewDriver<'a> {
    fn new(shared: Arc<SharedCore>, request: ViewRequest, client: Option<SessionClient<'a>>) -> Self {
        let last = client.as_ref().and_then(|client| client.memory.recall());
        let handle =
            ViewHandle::new(&shared, request.client.clone(), request.view.clone(), request.deadline, last);
        let path = ViewPath::new(client.as_ref().is_some_and(|client| client.redirectable));
        Self { shared, request, client, handle, path, stream: None }
    }

    /// Waits for the next event of the view's state. Each future is cancellation-safe: replies and notices stay
    /// queued until they are taken, and dropping an RPC cancels it.
    async fn next(&mut self) -> Event {
        match (self.path.state(), &self.client) {
            (State::Ordered(_) | State::Streaming(_), _) => tokio::select! {
                biased;
                reply = self.handle.next_reply() => self.decided(reply),
                chunk = next_chunk(&self.shared, &self.request, self.path.order(), &mut self.stream) => self.chunk_arrived(chunk),
            },
            (State::Redirected { .. }, Some(client)) => tokio::select! {
                biased;
                notice = client.notice(&self.shared) => self.noticed(notice),
                reply = self.handle.next_reply() => self.decided(reply),
            },
            _ => {
                let reply = self.handle.next_reply().await;
                self.decided(reply)
            }
        }
    }

    /// Reads a worker's stream to its end, so that it closes in order. Gives up after a timeout.
    async fn close_stream(&mut self) {
        if let Some(stream) = &mut self.stream {
            let _ = tokio::time::timeout(CLOSE_TIMEOUT, stream.message()).await;
        }
    }

    /// The event of a core's reply, with a redirect where the client may fetch the frame itself.
    fn decided(&mut self, reply: CoreReply) -> Event {
        match reply {
            Ok(Instruction::Dispatch(order)) => {
                let client = self.client.as_mut().filter(|_| self.path.may_redirect(&order));
                let ticket = client.and_then(|client| client.ticket(&self.shared, &self.request, &order));
                Event::Ordered { order, ticket }
            }
            Ok(Instruction::Deliver { attempt, expected }) => Event::Delivered { attempt, expected },
            Err(fault) => Event::Refused(fault),
        }
    }

    /// The event of a worker's chunk or error.
    fn chunk_arrived(&self, chunk: Result<v1::FrameChunk, Status>) -> Event {
        match chunk {
            Ok(chunk) => Event::Chunk { chunk, age_ms: self.request.age_ms() },
            Err(status) => {
                let attempt = self.path.order().map(|order| order.attempt);
                debug!(view = self.request.view_id, attempt, %status, "attempt failed");
                Event::Broken(status)
            }
        }
    }

    /// The event of a client's notice about a redirected frame.
    fn noticed(&mut self, notice: ClientNotice) -> Event {
        let newest = match notice {
            ClientNotice::Arrived(_) => self.handle.newest(),
            ClientNotice::Missed(_) => None,
        };
        match &mut self.client {
            Some(client) => client.event(notice, &self.request, newest),
            None => Event::Cancelled,
        }
    }

    /// Executes a command that needs no waiting.
    fn execute(&mut self, command: Command) {
        match command {
            Command::Open => self.stream = None,
            Command::PauseRedirects => {
                if let Some(client) = &mut self.client {
                    client.pause();
                }
            }
            Command::Judge { attempt, observed, ms } => self.handle.judge(attempt, observed, ms),
            Command::Failed { attempt, failure } => self.handle.failed(attempt, failure),
            Command::Answered(answered) => self.answered(&answered),
            Command::Cancel => self.handle.cancelled(),
            // [`answer`] executes these: they go to the client, or wait.
            Command::Send(_) | Command::Redirect(_) | Command::Fail(_) | Command::CloseStream => {}
        }
    }

    fn answered(&mut self, answered: &Answered) {
        match answered.relayed {
            true => self.shared.frame_metrics.relayed(),
            false => self.shared.frame_metrics.fetched(),
        }
        let view = &self.request.view;
        let pixels = u64::from(view.width) * u64::from(view.height);
        self.shared.client_metrics.answered(&self.request.client, pixels);
        self.handle.answered(answered.attempt, answered.uncovered, answered.ms, answered.fell_short);
        let Some(header) = &answered.header else { return };
        self.shared.frame_metrics.arrived(header);
        if let Some(client) = &mut self.client {
            client.memory.learn(&self.request.view, header);
        }
    }
}

impl Drop for ViewDriver<'_> {
    fn drop(&mut self) {
        for command in self.path.step(Event::Cancelled) {
            self.execute(command);
        }
    }
}

/// The next chunk of the ordered worker's stream. Opens the stream first.
async fn next_chunk(
    shared: &SharedCore,
    request: &ViewRequest,
    order: Option<&Order>,
    stream: &mut Option<Streaming<v1::FrameChunk>>,
) -> Result<v1::FrameChunk, Status> {
    let stream = match stream {
        Some(stream) => stream,
        None => {
            let order = order.ok_or_else(|| Status::internal("a chunk was awaited without an order"))?;
            stream.insert(open(shared, request, order).instrument(request.span.clone()).await?)
        }
    };
    let chunk = stream.message().await?;
    chunk.ok_or_else(|| Status::data_loss("the worker's stream ended within a frame"))
}

async fn open(
    shared: &SharedCore,
    request: &ViewRequest,
    order: &Order,
) -> Result<Streaming<v1::FrameChunk>, Status> {
    let for_worker = request.for_worker(shared.term(), shared.service.scene.hash, order);
    let mut client = ViewsClient::new(shared.channels.to(&order.address)?);
    Ok(client.render(within(&request.span, for_worker)).await?.into_inner())
}
