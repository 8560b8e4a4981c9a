//! Rendering of single views.

use std::time::Duration;

use argus_proto::WireError;
use argus_proto::chunks::FrameMeta;
use argus_proto::trace::{TARGET, within};
use argus_proto::v1::{Encoding, RenderRequest};
use argus_scene::{Frame, InvalidField, Limits, Outputs, View};
use tokio::time::{Instant, sleep, timeout_at};
use tracing::Instrument;

use crate::arrival::Arrival;
use crate::retry::Backoff;
use crate::{Client, ClientError};

/// Options of a view request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RenderOptions {
    /// Deadline of the request. Until then, failures that may be transient are retried.
    pub deadline: Duration,
    /// Encoding of images on the wire; unspecified: the server chooses.
    pub encoding: Encoding,
    /// Whether to wait as long as the server asks and retry when it rejects the view because of overload. If false,
    /// the rejection is returned at once, as an open-loop load needs.
    pub wait_for_room: bool,
    /// Id of the view in logs, equal for all retries. `None`: a new one.
    pub view_id: Option<String>,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            deadline: Duration::from_secs(30),
            encoding: Encoding::Unspecified,
            wait_for_room: true,
            view_id: None,
        }
    }
}

/// A frame and its delivery.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// The requested frame.
    pub frame: Frame,
    /// The worker that rendered it, and its age: from the request's arrival at the service until the whole
    /// frame arrived here.
    pub meta: FrameMeta,
    /// From the first request to the last byte.
    pub latency: Duration,
    /// Number of requests: 1 without failures.
    pub attempts: u32,
}

/// Attempts after damaged answers. Damage on the way is cured by a retry; a faulty server is not retried until
/// the deadline.
const DAMAGED_ATTEMPTS: u32 = 3;

impl Client {
    /// Renders a view. Retries under the same id while the service is unavailable, the connection breaks or a frame
    /// is damaged. After a rejection because of overload it waits as long as the server asks.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] at once. [`ClientError::Overloaded`] if waiting is off
    /// ([`RenderOptions::wait_for_room`]) or would
    /// exceed the deadline. [`ClientError::Deadline`] when time is up. [`ClientError::Damaged`] after three
    /// damaged answers.
    /// [`ClientError::Server`] for any other failure that the server reports.
    pub async fn render(&self, view: &View, options: &RenderOptions) -> Result<Answer, ClientError> {
        let begin = Instant::now();
        let end = begin + options.deadline;
        let view_id = options.view_id.clone().unwrap_or_else(|| self.new_view_id());
        let mut request = RenderRequest {
            view_id,
            view: Some(view.into()),
            deadline_ms: 0,
            encoding: options.encoding as i32,
            order: None,
        };
        let mut backoff = Backoff::new();
        let mut last = "the server did not reply".to_owned();
        let (mut attempts, mut damaged) = (0, 0);
        loop {
            attempts += 1;
            let server = self.server();
            let left = end.saturating_duration_since(Instant::now());
            // 0 would mean "no deadline" to the server.
            request.deadline_ms = u32::try_from(left.as_millis()).unwrap_or(u32::MAX).max(1);
            let error = match timeout_at(end, self.attempt(view, request.clone())).await {
                Ok(Ok((frame, meta))) => {
                    return Ok(Answer { frame, meta, latency: begin.elapsed(), attempts });
                }
                Ok(Err(error)) => error,
                Err(_) => return Err(ClientError::Deadline { after: options.deadline, last }),
            };
            damaged += u32::from(matches!(error, ClientError::Damaged(_)));
            let room = match &error {
                ClientError::Overloaded { retry_after, .. } if options.wait_for_room => *retry_after,
                _ => None,
            };
            if (!error.is_transient() && room.is_none()) || damaged >= DAMAGED_ATTEMPTS {
                return Err(deadline_of(error, options.deadline));
            }
            tracing::debug!(view_id = request.view_id, attempts, %error, "sending the view again");
            if let Some(after) = room {
                // Up to 50% longer, so that rejected clients do not all return at once.
                let pause = after + after.mul_f64(0.5 * self.random());
                if Instant::now() + pause >= end {
                    return Err(error);
                }
                last = error.to_string();
                sleep(pause).await;
                continue;
            }
            self.try_another(server);
            let pause = backoff.pause();
            if Instant::now() + pause >= end {
                return Err(ClientError::Deadline { after: options.deadline, last: error.to_string() });
            }
            last = error.to_string();
            sleep(pause).await;
        }
    }

    async fn attempt(&self, view: &View, request: RenderRequest) -> Result<(Frame, FrameMeta), ClientError> {
        let span = tracing::debug_span!(target: TARGET, "view", view = request.view_id);
        self.attempt_in(&span, view, request).instrument(span.clone()).await
    }

    async fn attempt_in(
        &self,
        span: &tracing::Span,
        view: &View,
        request: RenderRequest,
    ) -> Result<(Frame, FrameMeta), ClientError> {
        let mut stream = self.views().render(within(span, request)).await?.into_inner();
        // Limited to the requested size, so that no header can make this client allocate more.
        let (max_side, max_pixels) =
            (view.width.max(view.height), u64::from(view.width) * u64::from(view.height));
        let mut arrival = Arrival::new(Limits { max_side, max_pixels });
        while let Some(chunk) = stream.message().await? {
            if let Some((frame, meta)) = arrival.push(chunk)? {
                answers(&frame, view)?;
                // Read the stream to its end: dropping it earlier would look like a cancellation.
                if stream.message().await?.is_some() {
                    let reason = "more came after the frame".to_owned();
                    return Err(WireError::OutOfOrder { what: "frame", reason }.into());
                }
                return Ok((frame, meta));
            }
        }
        arrival.end()?;
        Err(WireError::Truncated { what: "frame", got: 0, expected: 1 }.into())
    }
}

/// Checks that a frame has the size and the images that the view asked for.
pub(crate) fn answers(frame: &Frame, view: &View) -> Result<(), WireError> {
    let held = frame.images.iter().map(|(output, _)| output);
    let came: Outputs = held.collect();
    if (frame.width, frame.height) != (view.width, view.height) {
        let reason = format!("is {} × {} pixels", frame.width, frame.height);
        return Err(InvalidField::new("frame.width", reason).into());
    }
    if came != view.outputs {
        return Err(InvalidField::new("frame.images", format!("are {came:?}")).into());
    }
    Ok(())
}

/// A deadline reported by the server becomes this client's deadline error.
fn deadline_of(error: ClientError, after: Duration) -> ClientError {
    match error {
        ClientError::Server { code: tonic::Code::DeadlineExceeded, message, .. } => {
            ClientError::Deadline { after, last: message }
        }
        error => error,
    }
}
