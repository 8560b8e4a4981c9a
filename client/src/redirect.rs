//! Fetches redirected frames from the workers that render them.

use std::fmt;
use std::pin::Pin;
use std::time::Duration;

use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::v1::redeem_response::Body;
use argus_proto::{WireError, v1};
use argus_scene::{Frame, InvalidField, Stage};
use futures::{Stream, StreamExt};
use tokio::time::{Instant, timeout_at};
use tonic::Code;

use crate::{Client, ClientError};

/// A worker without a message for this long is given up; it sends one twice a second while it works. Keep-alive
/// (`transport::replaceable`) detects a dead connection as soon, unless a proxy answers in the worker's place.
const SILENCE: Duration = Duration::from_millis(2500);

/// A frame fetched from a worker.
pub(crate) struct Fetched {
    pub(crate) frame: Frame,
    pub(crate) meta: FrameMeta,
    /// The receipt for the acknowledgement, which this client does not open.
    pub(crate) receipt: Option<v1::Sealed>,
}

/// A frame that is being fetched from a worker.
pub(crate) struct Fetch {
    /// The frame's camera.
    pub(crate) camera_seq: u64,
    /// The ticket's serial number.
    pub(crate) serial: u64,
    messages: Pin<Box<dyn Stream<Item = Result<v1::RedeemResponse, ClientError>> + Send>>,
    assembler: FrameAssembler,
    whole: Option<(Frame, FrameMeta)>,
    redirected_at: Instant,
    /// When the worker last sent a message, or was first asked.
    heard: Option<Instant>,
    /// Age of the request in milliseconds when the server redirected this client.
    age_ms: f64,
}

impl fmt::Debug for Fetch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fetch").field("camera_seq", &self.camera_seq).finish_non_exhaustive()
    }
}

impl Fetch {
    /// Prepares a fetch; it starts with the first call of [`Fetch::frame`].
    pub(crate) fn new(client: &Client, camera_seq: u64, redirect: v1::Redirect) -> Self {
        let v1::Redirect { address, ticket, age_ms, serial } = redirect;
        let of = client.clone();
        let messages = async_stream::try_stream! {
            let mut worker = of.worker(&address)?;
            let mut messages = worker.redeem(v1::RedeemRequest { ticket }).await?.into_inner();
            while let Some(message) = messages.message().await? {
                yield message;
            }
        };
        Self {
            camera_seq,
            serial,
            messages: Box::pin(messages),
            assembler: FrameAssembler::new(client.description().limits),
            whole: None,
            redirected_at: Instant::now(),
            heard: None,
            age_ms,
        }
    }

    /// Returns the frame once it is whole. The future may be dropped and called again.
    ///
    /// # Errors
    /// Why the frame did not arrive.
    pub(crate) async fn frame(&mut self) -> Result<Fetched, ClientError> {
        loop {
            let silent = |_| {
                let message = format!("the worker has said nothing for {} ms", SILENCE.as_millis());
                ClientError::Server { code: Code::Unavailable, message, broken: true }
            };
            let until = *self.heard.get_or_insert_with(Instant::now) + SILENCE;
            let message = timeout_at(until, self.messages.next()).await.map_err(silent)?;
            self.heard = Some(Instant::now());
            let receipt = match message.transpose()?.map(|message| message.body) {
                Some(Some(Body::Working(_))) => continue,
                Some(Some(Body::Chunk(chunk))) => {
                    self.whole = self.assembler.push(chunk)?.or(self.whole.take());
                    continue;
                }
                Some(Some(Body::Receipt(receipt))) => Some(receipt),
                Some(None) => return Err(WireError::from(InvalidField::new("body", "must be given")).into()),
                None => None,
            };
            let cut_short = || {
                let message = "the worker ended a frame before its end".to_owned();
                ClientError::Server { code: Code::DataLoss, message, broken: true }
            };
            let (mut frame, mut meta) = self.whole.take().ok_or_else(cut_short)?;
            let age_ms = self.age_ms + self.redirected_at.elapsed().as_secs_f64() * 1e3;
            frame.stages.push(Stage::new(Stage::DETOUR, (age_ms - meta.age_ms).max(0.0)));
            meta.age_ms = age_ms;
            return Ok(Fetched { frame, meta, receipt });
        }
    }
}
