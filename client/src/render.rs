//! Single views.

use std::time::Duration;

use argus_proto::WireError;
use argus_proto::chunks::FrameMeta;
use argus_proto::trace::{TARGET, within};
use argus_proto::v1::{Encoding, RenderRequest};
use argus_scene::{Frame, InvalidField, Limits, Output, Outputs, View};
use tokio::time::{Instant, sleep, timeout_at};
use tracing::Instrument;

use crate::arrival::Arrival;
use crate::retry::Backoff;
use crate::{Client, ClientError};

/// How a view is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RenderOptions {
    /// The answer is of no use after this long. Until then, what may succeed on repetition is repeated.
    pub deadline: Duration,
    /// How images travel; unspecified leaves it to the server.
    pub encoding: Encoding,
    /// What to do when the service has too much to do: wait for as long as it says and ask again while the deadline lasts,
    /// or, if false, give up at once, as a load that must not wait for the service does.
    pub wait_for_room: bool,
    /// Names the view in logs; one is made up if absent. Repetitions carry the same.
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

/// A frame, and how it came.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// What was asked for.
    pub frame: Frame,
    /// Who made it, and how old it is: from its request's arrival at the service until it was here, whole.
    pub meta: FrameMeta,
    /// From the first request to the last byte.
    pub latency: Duration,
    /// Requests sent: 1 unless something failed on the way.
    pub attempts: u32,
}

/// A damaged answer is asked for again this often: damage on the way is cured, a faulty server is not
/// asked until the deadline.
const DAMAGED_ATTEMPTS: u32 = 3;

impl Client {
    /// Renders a view. Sends it again, under the same id, while the service is unavailable, the connection
    /// breaks, or a frame arrives damaged; and where the service has too much to do, no sooner than it says.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] at once, [`ClientError::Overloaded`] when the deadline leaves no time to wait for room
    /// ([`RenderOptions::wait_for_room`]), [`ClientError::Deadline`] when time is up, [`ClientError::Damaged`] after three damaged answers, [`ClientError::Server`] for what else the
    /// server reports.
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
            // 0 would mean "never" to the server.
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
                // Up to half as long again, so that those who were turned away together do not come back together.
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
        // Exactly the size that was asked for, so that no header can make this client set aside more.
        let (max_side, max_pixels) =
            (view.width.max(view.height), u64::from(view.width) * u64::from(view.height));
        let mut arrival = Arrival::new(Limits { max_side, max_pixels });
        while let Some(chunk) = stream.message().await? {
            if let Some((frame, meta)) = arrival.push(chunk)? {
                answers(&frame, view)?;
                // Read to the end of the stream, so that dropping it does not look like a cancellation.
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

/// Whether a frame has the size and the images that a view asked for.
pub(crate) fn answers(frame: &Frame, view: &View) -> Result<(), WireError> {
    let held = Output::ALL.into_iter().filter(|&output| frame.image(output).is_some());
    let came = held.fold(Outputs::default(), Outputs::with);
    if (frame.width, frame.height) != (view.width, view.height) {
        let reason = format!("is {} × {} pixels", frame.width, frame.height);
        return Err(InvalidField::new("frame.width", reason).into());
    }
    if came != view.outputs {
        return Err(InvalidField::new("frame.images", format!("are {came:?}")).into());
    }
    Ok(())
}

/// The server's own report that the deadline has passed is the same news as our clock's.
fn deadline_of(error: ClientError, after: Duration) -> ClientError {
    match error {
        ClientError::Server { code: tonic::Code::DeadlineExceeded, message, .. } => {
            ClientError::Deadline { after, last: message }
        }
        error => error,
    }
}
