//! Frames that a session fetches from the worker that makes them, where its server sends it there.

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

/// A worker that says nothing for this long is given up: it says twice a second that it is at work. Its connection tells
/// as soon (`transport::replaceable`), but for one that something stands in between which answers in its place.
const SILENCE: Duration = Duration::from_millis(2500);

/// What came from a worker.
pub(crate) struct Fetched {
    pub(crate) frame: Frame,
    pub(crate) meta: FrameMeta,
    /// For the acknowledgement, unopened.
    pub(crate) receipt: Option<v1::Sealed>,
}

/// A frame on its way from a worker.
pub(crate) struct Fetch {
    /// Whose frame it is.
    pub(crate) camera_seq: u64,
    /// Of the ticket.
    pub(crate) serial: u64,
    messages: Pin<Box<dyn Stream<Item = Result<v1::RedeemResponse, ClientError>> + Send>>,
    assembler: FrameAssembler,
    whole: Option<(Frame, FrameMeta)>,
    sent_here: Instant,
    /// When the worker was last heard of, or first asked.
    heard: Option<Instant>,
    /// Of the request, when the server sent this client elsewhere.
    age_ms: f64,
}

impl fmt::Debug for Fetch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fetch").field("camera_seq", &self.camera_seq).finish_non_exhaustive()
    }
}

impl Fetch {
    /// Begins with the first call of [`Fetch::frame`].
    pub(crate) fn new(client: &Client, camera_seq: u64, elsewhere: v1::Elsewhere) -> Self {
        let v1::Elsewhere { address, ticket, age_ms, serial } = elsewhere;
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
            sent_here: Instant::now(),
            heard: None,
            age_ms,
        }
    }

    /// The frame, once it is whole. Safe to drop and call again.
    ///
    /// # Errors
    /// What kept it from coming.
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
            let age_ms = self.age_ms + self.sent_here.elapsed().as_secs_f64() * 1e3;
            frame.stages.push(Stage::new(Stage::DETOUR, (age_ms - meta.age_ms).max(0.0)));
            meta.age_ms = age_ms;
            return Ok(Fetched { frame, meta, receipt });
        }
    }
}
