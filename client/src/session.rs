//! Sessions: what a moving camera sees.

use std::fmt;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::WireError;
use argus_proto::chunks::FrameMeta;
use argus_proto::trace::traceparent;
use argus_proto::v1::{self, Encoding, frame_chunk, session_response::Body};
use argus_scene::{Frame, InvalidField, View};
use tokio::time::{Instant, sleep_until, timeout};
use tonic::{Code, Streaming};

use crate::arrival::Arrival;
use crate::elsewhere::{Fetch, Fetched};
use crate::outbox::Outbox;
use crate::render::answers;
use crate::retry::Backoff;
use crate::unanswered::{Camera, Unanswered};
use crate::{Client, ClientError};

/// A server's hint keeps a session quiet for this long at most: a camera is worth more than a mistaken number.
const LONGEST_QUIET: Duration = Duration::from_secs(10);

/// How a session behaves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionOptions {
    /// How images travel; unspecified leaves it to the server.
    pub encoding: Encoding,
    /// A broken session is opened again for this long before it is given up.
    pub patience: Duration,
    /// Whether frames may be fetched from workers where the server says so; it relays those that cannot be.
    pub redirect: bool,
    /// Whether searches may begin from this session's frame before; [`argus_scene::Provenance::history`] says of each frame
    /// whether its did. Plans may leave the search open or ask for the seeded one.
    pub history: bool,
}

impl Default for SessionOptions {
    fn default() -> Self {
        let patience = Duration::from_secs(30);
        Self { encoding: Encoding::Unspecified, patience, redirect: true, history: false }
    }
}

/// What comes out of a session.
#[derive(Debug, Clone)]
pub enum SessionEvent {
    /// A frame of the camera with that number; those of older ones never come after it.
    Frame {
        /// What [`Session::send`] returned.
        camera_seq: u64,
        /// What the camera sees.
        frame: Box<Frame>,
        /// Who made it.
        meta: FrameMeta,
    },
    /// A view that could not be rendered; the session goes on. Where the service had too much to do, cameras wait here,
    /// newer ones in place of older ones, for as long as it said.
    Failed {
        /// What [`Session::send`] returned.
        camera_seq: u64,
        /// Why.
        error: ClientError,
    },
}

/// A moving camera. Each camera that is sent supersedes those before it; each frame is acknowledged when it
/// has arrived whole, so that a slow client gets fewer frames and never stale ones. A connection that breaks is
/// made again and the newest unanswered camera sent again.
#[derive(Debug)]
pub struct Session {
    client: Client,
    options: SessionOptions,
    outbox: Arc<Outbox>,
    incoming: Incoming,
    arrival: Arrival,
    /// Camera of the frame that is arriving.
    arriving: Option<u64>,
    /// The frame that is fetched from a worker.
    fetch: Option<Fetch>,
    unanswered: Unanswered,
    backoff: Backoff,
    /// When the session broke, until the next answer.
    broken_since: Option<Instant>,
}

/// What the server says, or the way there. It outlives a call of [`Session::next`] that is dropped: one that waits for less
/// time than opening takes would else never be answered.
enum Incoming {
    /// To be opened, and not before that.
    Closed(Instant),
    Opening(Pin<Box<dyn Future<Output = Result<Streaming<v1::SessionResponse>, ClientError>> + Send>>),
    Open(Box<Streaming<v1::SessionResponse>>),
}

impl fmt::Debug for Incoming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Closed(_) => "closed",
            Self::Opening(_) => "opening",
            Self::Open(_) => "open",
        })
    }
}

impl Client {
    /// Opens a session; the connection is made with the first call of [`Session::next`].
    pub fn session(&self, options: SessionOptions) -> Session {
        Session {
            arrival: Arrival::new(self.description().limits),
            client: self.clone(),
            options,
            outbox: Arc::default(),
            incoming: Incoming::Closed(Instant::now()),
            arriving: None,
            fetch: None,
            unanswered: Unanswered::default(),
            backoff: Backoff::new(),
            broken_since: None,
        }
    }
}

impl Session {
    /// Moves the camera; returns its number. Never waits: a camera that has not left yet is replaced.
    pub fn send(&mut self, view: &View) -> u64 {
        let (camera_seq, camera) = self.unanswered.send(view.clone());
        if let Some(before) = self.outbox.put(camera_seq, wire(&self.options, camera)) {
            self.unanswered.never_left(before);
        }
        camera_seq
    }

    /// Whether the newest camera has been answered.
    pub fn is_idle(&self) -> bool {
        self.unanswered.is_idle()
    }

    /// Cameras that will not be answered since a newer one was: they were replaced here before they left, on their way when
    /// a connection broke, or at the server.
    pub fn superseded(&self) -> u64 {
        self.unanswered.superseded()
    }

    /// Waits for the next frame. Safe to drop and call again.
    ///
    /// # Errors
    /// Once the session cannot be kept up: a failure that repetition does not cure, or
    /// [`ClientError::Deadline`] when it could not be opened again for as long as the options allow.
    pub async fn next(&mut self) -> Result<SessionEvent, ClientError> {
        loop {
            let server = self.client.server();
            let error = match self.receive().await {
                Ok(None) => continue,
                Ok(Some(event)) => {
                    (self.backoff, self.broken_since) = (Backoff::new(), None);
                    return Ok(event);
                }
                Err(error) => error,
            };
            self.incoming = Incoming::Closed(Instant::now());
            // A server without room for another session says when to ask again: this one's own place may still be
            // taken by the connection that broke.
            let room = match &error {
                ClientError::Overloaded { retry_after: Some(after), .. } => Some((*after).min(LONGEST_QUIET)),
                _ => None,
            };
            match room {
                Some(_) => {}
                None if error.is_transient() => self.client.try_another(server),
                None => return Err(error),
            }
            let after = self.options.patience;
            let end = *self.broken_since.get_or_insert_with(Instant::now) + after;
            let pause = room.unwrap_or_else(|| self.backoff.pause());
            if Instant::now() + pause >= end {
                return Err(ClientError::Deadline { after, last: error.to_string() });
            }
            tracing::debug!(%error, "opening the session again");
            self.incoming = Incoming::Closed(Instant::now() + pause);
        }
    }

    /// Waits for the next message; `None` where it completes nothing.
    async fn receive(&mut self) -> Result<Option<SessionEvent>, ClientError> {
        let incoming = match &mut self.incoming {
            Incoming::Open(incoming) => incoming,
            Incoming::Opening(opening) => {
                self.incoming = Incoming::Open(Box::new(opening.await?));
                return Ok(None);
            }
            Incoming::Closed(until) => {
                sleep_until(*until).await;
                self.open();
                return Ok(None);
            }
        };
        let response = tokio::select! {
            response = incoming.message() => response?,
            fetched = fetched(&mut self.fetch) => return self.take_fetched(fetched),
        };
        let Some(response) = response else {
            // A server that shuts down ends sessions in order; another one may take its place.
            let message = "the server ended the session".to_owned();
            return Err(ClientError::Server { code: Code::Unavailable, message, broken: true });
        };
        let camera_seq = response.camera_seq;
        let body =
            response.body.ok_or_else(|| WireError::from(InvalidField::new("body", "must be given")))?;
        // Whatever is said of a camera stands in place of what was said of it before.
        self.fetch.take_if(|fetch| fetch.camera_seq == camera_seq);
        match body {
            // One that crossed the acknowledgement is of no use any more.
            Body::Elsewhere(_) if camera_seq <= self.unanswered.answered() => Ok(None),
            Body::Elsewhere(elsewhere) => {
                self.fetch = Some(Fetch::new(&self.client, camera_seq, elsewhere));
                Ok(None)
            }
            Body::Failure(failure) => {
                if !self.unanswered.settle(camera_seq) {
                    return Ok(None);
                }
                let error = error_of(failure);
                if let ClientError::Overloaded { retry_after: Some(after), .. } = &error {
                    self.outbox.quiet_for(*after);
                }
                Ok(Some(SessionEvent::Failed { camera_seq, error }))
            }
            Body::Chunk(chunk) => {
                if *self.arriving.get_or_insert(camera_seq) != camera_seq {
                    let reason = format!("frames of two cameras interleave at {camera_seq}");
                    return Err(WireError::OutOfOrder { what: "frame", reason }.into());
                }
                // What began from an earlier frame is not taken up where a lost worker left off.
                if matches!(chunk.body, Some(frame_chunk::Body::Header(_))) {
                    self.arrival.begin_again();
                }
                let Some((frame, meta)) = self.arrival.push(chunk)? else { return Ok(None) };
                self.arriving = None;
                self.outbox.acknowledge(camera_seq, None);
                self.deliver(camera_seq, frame, meta)
            }
        }
    }

    /// What came of a frame that was to be fetched; one that did not come is relayed.
    fn take_fetched(
        &mut self,
        (camera_seq, fetched): (u64, Result<Fetched, ClientError>),
    ) -> Result<Option<SessionEvent>, ClientError> {
        let serial = self.fetch.take().map_or(0, |fetch| fetch.serial);
        let fits = |fetched: Fetched| match self.unanswered.view(camera_seq) {
            Some(view) => Ok(answers(&fetched.frame, view).map(|()| fetched)?),
            None => Ok(fetched),
        };
        match fetched.and_then(fits) {
            Ok(Fetched { frame, meta, receipt }) => {
                self.outbox.acknowledge(camera_seq, receipt);
                self.deliver(camera_seq, frame, meta)
            }
            Err(error) => {
                tracing::debug!(%error, "a frame could not be fetched from its worker");
                // What a worker says itself is about this frame, not about the way to it.
                let unreachable = !matches!(
                    error,
                    ClientError::Overloaded { .. }
                        | ClientError::Invalid { .. }
                        | ClientError::Server { broken: false, .. }
                );
                let reason = error.to_string();
                self.outbox.missed(camera_seq, v1::SessionMissed { reason, serial, unreachable });
                Ok(None)
            }
        }
    }

    /// A frame that arrived whole, unless a newer camera was answered.
    fn deliver(
        &mut self,
        camera_seq: u64,
        frame: Frame,
        meta: FrameMeta,
    ) -> Result<Option<SessionEvent>, ClientError> {
        if let Some(view) = self.unanswered.view(camera_seq) {
            answers(&frame, view)?;
        }
        if !self.unanswered.settle(camera_seq) {
            return Ok(None);
        }
        Ok(Some(SessionEvent::Frame { camera_seq, frame: Box::new(frame), meta }))
    }

    /// Begins to open the stream, anew if there was one, and sends the newest camera again if it is unanswered.
    fn open(&mut self) {
        self.arrival = Arrival::new(self.client.description().limits);
        (self.arriving, self.fetch) = (None, None);
        if let Some((camera_seq, camera)) = self.unanswered.newest() {
            self.outbox.put_back(camera_seq, wire(&self.options, camera));
        }
        let (requests, mut views) = (self.outbox.stream(), self.client.views());
        let after = self.options.patience;
        self.incoming = Incoming::Opening(Box::pin(async move {
            let last = "the session was not opened".to_owned();
            let opened = timeout(after, views.session(requests)).await;
            Ok(opened.map_err(|_| ClientError::Deadline { after, last })??.into_inner())
        }));
    }
}

fn wire(options: &SessionOptions, camera: &Camera) -> v1::SessionView {
    let SessionOptions { encoding, redirect, history, .. } = *options;
    let (view, traceparent) = (Some((&camera.view).into()), traceparent(&camera.span));
    v1::SessionView { view, encoding: encoding as i32, redirectable: redirect, traceparent, history }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.outbox.close();
    }
}

/// The frame that is fetched, with its camera; never, where none is.
async fn fetched(fetch: &mut Option<Fetch>) -> (u64, Result<Fetched, ClientError>) {
    match fetch {
        Some(fetch) => (fetch.camera_seq, fetch.frame().await),
        None => std::future::pending().await,
    }
}

/// What a view's failure means, where it ended no call.
pub(crate) fn error_of(failure: v1::SessionFailure) -> ClientError {
    let v1::SessionFailure { code, message, field, retry_after_ms } = failure;
    match Code::from_i32(code) {
        Code::InvalidArgument if !field.is_empty() => ClientError::Invalid {
            // The message repeats the field, as all statuses of an invalid field do.
            reason: message.strip_prefix(&format!("{field}: ")).unwrap_or(&message).to_owned(),
            field,
        },
        Code::ResourceExhausted => {
            let retry_after =
                (retry_after_ms > 0).then(|| Duration::from_millis(retry_after_ms.into()).min(LONGEST_QUIET));
            ClientError::Overloaded { message, retry_after }
        }
        code => ClientError::Server { code, message, broken: false },
    }
}
