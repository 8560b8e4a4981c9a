//! Batches: many cameras in one request.

use std::collections::{BTreeSet, HashMap};
use std::time::Duration;

use argus_proto::WireError;
use argus_proto::chunks::FrameMeta;
use argus_proto::trace::{TARGET, within};
use argus_proto::v1::render_batch_response::Body;
use argus_proto::v1::{Encoding, RenderBatchRequest, RenderBatchResponse};
use argus_scene::{Camera, Frame, InvalidField, Limits, Outputs, PlanRequest, View};
use futures::Stream;
use tokio::time::{Instant, sleep};
use tonic::Streaming;

use crate::arrival::Arrival;
use crate::render::answers;
use crate::retry::Backoff;
use crate::session::error_of;
use crate::{Client, ClientError};

/// After so long without a frame, the rest of a batch fails: as long as a single view waits by default.
const PATIENCE: Duration = Duration::from_secs(30);

/// Cameras whose frames share size, outputs and plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// The viewpoints, at most 2048.
    pub cameras: Vec<Camera>,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The images of each frame.
    pub outputs: Outputs,
    /// The requested plan. If it names neither samples nor triangles, the service fixes each frame's when it accepts the batch:
    /// from samples where the views share enough of them, else from triangles.
    pub plan: PlanRequest,
}

impl Batch {
    fn view(&self, index: usize) -> Option<View> {
        let Self { width, height, outputs, plan, .. } = *self;
        Some(View {
            camera: *self.cameras.get(index)?,
            width,
            height,
            outputs,
            plan,
            pin: None,
            flow_to: None,
            rays: None,
        })
    }
}

/// A camera's index in its batch, with its frame or its error.
pub type BatchAnswer = (usize, Result<(Frame, FrameMeta), ClientError>);

/// A batch request in progress.
struct Arriving {
    stream: Streaming<RenderBatchResponse>,
    /// The batch index of each camera of this request.
    asked: Vec<usize>,
    arrivals: HashMap<u32, Arrival>,
}

impl Client {
    /// Renders a batch. Frames arrive in the order in which they are done, each with its camera's index. If the
    /// connection breaks, or views fail since all workers were lost, the missing cameras are requested again, until no
    /// frame arrives for 30 s. Every index arrives exactly once, with its frame or its error.
    pub fn render_batch(
        &self,
        batch: Batch,
        encoding: Encoding,
    ) -> impl Stream<Item = BatchAnswer> + Send + use<> {
        let client = self.clone();
        async_stream::stream! {
            let mut left: BTreeSet<usize> = (0..batch.cameras.len()).collect();
            let (mut backoff, mut end) = (Backoff::new(), Instant::now() + PATIENCE);
            while !left.is_empty() {
                let server = client.server();
                // Why cameras of this request are still without a frame: the newest reason.
                let cut = WireError::Truncated { what: "batch", got: 0, expected: 1 };
                let mut missing = ClientError::from(cut);
                match client.begin_batch(&batch, &left, encoding).await {
                    Ok(mut arriving) => loop {
                        match arriving.next(&batch).await {
                            Ok(Some((_, Err(lost)))) if lost.is_transient() => missing = lost,
                            Ok(Some((index, result))) => {
                                if left.remove(&index) {
                                    (backoff, end) = (Backoff::new(), Instant::now() + PATIENCE);
                                    yield (index, result);
                                }
                            }
                            Ok(None) => break,
                            Err(broken) => {
                                missing = broken;
                                break;
                            }
                        }
                    },
                    Err(refused) => missing = refused,
                }
                if !missing.is_transient() || Instant::now() >= end {
                    for index in std::mem::take(&mut left) {
                        yield (index, Err(missing.clone()));
                    }
                } else if !left.is_empty() {
                    client.try_another(server);
                    sleep(backoff.pause()).await;
                }
            }
        }
    }

    async fn begin_batch(
        &self,
        batch: &Batch,
        left: &BTreeSet<usize>,
        encoding: Encoding,
    ) -> Result<Arriving, ClientError> {
        let cameras = left.iter().filter_map(|index| batch.cameras.get(*index)).map(Into::into).collect();
        // The fields in wire format, taken from the first view.
        let view: argus_proto::v1::View = batch.view(0).as_ref().map(Into::into).unwrap_or_default();
        let request = RenderBatchRequest {
            batch_id: self.new_view_id(),
            cameras,
            width: view.width,
            height: view.height,
            outputs: view.outputs,
            plan: view.plan,
            encoding: encoding as i32,
        };
        let span = tracing::debug_span!(target: TARGET, "batch", batch = request.batch_id);
        let stream = self.views().render_batch(within(&span, request)).await?.into_inner();
        Ok(Arriving { stream, asked: left.iter().copied().collect(), arrivals: HashMap::new() })
    }
}

impl Arriving {
    /// Receives until the next camera is done or has failed; `None` at the stream's end.
    ///
    /// # Errors
    /// The stream broke, or a message does not belong to the batch.
    async fn next(&mut self, batch: &Batch) -> Result<Option<BatchAnswer>, ClientError> {
        loop {
            let Some(RenderBatchResponse { index, body }) = self.stream.message().await? else {
                return Ok(None);
            };
            let wrong =
                |field, reason: &str| ClientError::from(WireError::from(InvalidField::new(field, reason)));
            let known = usize::try_from(index).ok().and_then(|index| self.asked.get(index).copied());
            let known = known.and_then(|known| Some((known, batch.view(known)?)));
            let (known, view) = known.ok_or_else(|| wrong("index", "is of no camera that was asked for"))?;
            match body {
                Some(Body::Failure(failure)) => {
                    self.arrivals.remove(&index);
                    return Ok(Some((known, Err(error_of(failure)))));
                }
                Some(Body::Chunk(chunk)) => {
                    // Limited to the requested size, so that no header can make this client allocate more.
                    let limits = Limits {
                        max_side: view.width.max(view.height),
                        max_pixels: u64::from(view.width) * u64::from(view.height),
                    };
                    let arrival = self.arrivals.entry(index).or_insert_with(|| Arrival::new(limits));
                    if let Some((frame, meta)) = arrival.push(chunk)? {
                        self.arrivals.remove(&index);
                        answers(&frame, &view)?;
                        return Ok(Some((known, Ok((frame, meta)))));
                    }
                }
                None => return Err(wrong("body", "must be given")),
            }
        }
    }
}
