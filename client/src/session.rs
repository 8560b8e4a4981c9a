//! Sessions: frames for a moving camera.

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
use crate::outbox::Outbox;
use crate::redirect::{Fetch, Fetched};
use crate::render::answers;
use crate::retry::Backoff;
use crate::unanswered::{Camera, Unanswered};
use crate::{Client, ClientError};

/// Longest time for which a server's retry hint holds cameras back, in case the hint is wrong.
const LONGEST_QUIET: Duration = Duration::from_secs(10);

/// Options of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionOptions {
    /// Encoding of images on the wire; unspecified: the server chooses.
    pub encoding: Encoding,
    /// How long a broken session is reopened before it fails.
    pub patience: Duration,
    /// Whether the server may redirect frames to workers. It relays those that cannot be fetched.
    pub redirect: bool,
    /// Whether searches may start from this session's previous frame (reprojection);
    /// [`argus_scene::Provenance::history`] tells for each frame whether its search did. Plans must leave the search
    /// open or name the seeded one.
    pub history: bool,
}

impl Default for SessionOptions {
    fn default() -> Self {
        let patience = Duration::from_secs(30);
        Self { encoding: Encoding::Unspecified, patience, redirect: true, history: false }
    }
}

/// An event of a session.
#[derive(Debug, Clone)]
pub enum SessionEvent {
    /// A frame. Frames of older cameras never follow it.
    Frame {
        /// The camera's number, from [`Session::send`].
        camera_seq: u64,
        /// What the camera sees.
        frame: Box<Frame>,
        /// The worker that rendered it, and its age.
        meta: FrameMeta,
    },
    /// A view that could not be rendered; the session continues. After an overload, cameras are held back as long as
    /// the server asked; newer ones replace older ones.
    Failed {
        /// The camera's number, from [`Session::send`].
        camera_seq: u64,
        /// Why the view failed.
        error: ClientError,
    },
}

/// A moving camera. A new camera supersedes older ones. Each whole frame is acknowledged, so that a slow client gets
/// fewer frames and never stale ones. A broken connection is restored, and the newest unanswered camera is sent
/// again.
#[derive(Debug)]
pub struct Session {
    client: Client,
    options: SessionOptions,
    outbox: Arc<Outbox>,
    incoming: Incoming,
    arrival: Arrival,
    /// Camera of the frame that is arriving.
    arriving: Option<u64>,
    /// The redirected frame that is being fetched.
    fetch: Option<Fetch>,
    unanswered: Unanswered,
    backoff: Backoff,
    /// When the session broke; `None` after the next answer.
    broken_since: Option<Instant>,
}

/// The response stream, or the attempt to open it. It survives a dropped call of [`Session::next`]; otherwise a
/// caller with short timeouts would never finish opening it.
enum Incoming {
    /// Closed; may be opened at this time.
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
    /// Creates a session. The first call of [`Session::next`] connects.
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
    /// Sends a camera and returns its number. Never waits: a camera that has not been sent yet is replaced.
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

    /// Number of cameras that a newer answer superseded: replaced before they were sent, lost in a broken connection,
    /// or skipped by the server.
    pub fn superseded(&self) -> u64 {
        self.unanswered.superseded()
    }

    /// Waits for the next event. The future may be dropped and called again.
    ///
    /// # Errors
    /// The session ends with an error that a retry does not cure, or with [`ClientError::Deadline`] if it
    /// could not be reopened
    /// within [`SessionOptions::patience`].
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
            // The server has no capacity for another session and says when to retry. The broken connection may still
            // occupy this session's place.
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

    /// Waits for the next message; `None` if it completes no event.
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
            // A server that shuts down ends its sessions; another one may take its place.
            let message = "the server ended the session".to_owned();
            return Err(ClientError::Server { code: Code::Unavailable, message, broken: true });
        };
        let camera_seq = response.camera_seq;
        let body =
            response.body.ok_or_else(|| WireError::from(InvalidField::new("body", "must be given")))?;
        // A new message about a camera replaces its fetch.
        self.fetch.take_if(|fetch| fetch.camera_seq == camera_seq);
        match body {
            // A redirect that crossed the acknowledgement is obsolete.
            Body::Redirect(_) if camera_seq <= self.unanswered.answered() => Ok(None),
            Body::Redirect(redirect) => {
                self.fetch = Some(Fetch::new(&self.client, camera_seq, redirect));
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
                // After a lost worker, a frame may start again from its header.
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

    /// Handles the result of a fetch. A frame that could not be fetched is reported, and the server relays it.
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
                // An error from the worker itself concerns this frame, not the connection.
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

    /// Returns a whole frame as an event, unless a newer camera was answered.
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

    /// Starts to open a new stream, and queues the newest camera again if it is unanswered.
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

/// Waits for the redirected frame and its camera; forever if there is none.
async fn fetched(fetch: &mut Option<Fetch>) -> (u64, Result<Fetched, ClientError>) {
    match fetch {
        Some(fetch) => (fetch.camera_seq, fetch.frame().await),
        None => std::future::pending().await,
    }
}

/// Converts the failure of one view into a client error.
pub(crate) fn error_of(failure: v1::SessionFailure) -> ClientError {
    let v1::SessionFailure { code, message, field, retry_after_ms } = failure;
    match Code::from_i32(code) {
        Code::InvalidArgument if !field.is_empty() => ClientError::Invalid {
            // The message repeats the field, like every status of an invalid field.
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
