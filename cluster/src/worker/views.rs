//! The worker's `Views` service. The coordinator sends orders to it, and redirected clients redeem tickets.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::chunks::{FrameMeta, frame_chunks};
use argus_proto::status::invalid;
use argus_proto::trace::{TARGET, continued, continued_from, stages};
use argus_proto::v1::frame_chunk::Body;
use argus_proto::v1::redeem_response::Body as Redeemed;
use argus_proto::v1::views_server::Views;
use argus_proto::{Fault, v1};
use argus_scene::{Frame, History, InvalidField, Plan, derived};
use futures::Stream;
use prost::Message;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};
use tracing::{Instrument, Span, debug_span, field};

use super::frame_memory::{self, FramePermit};
use super::node::{ActiveRequest, Node};
use super::order::{SAMPLES, check, good_enough};
use super::{measured_error, probe};
use crate::core::quality::Observed;
use crate::sealed::Kind;
use crate::send_timeout::with_send_timeout;
use crate::wire;

/// The service.
pub(super) struct ViewsService {
    pub(super) node: Arc<Node>,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// How long a client may take to read a redirected frame.
const READ_WITHIN: Duration = Duration::from_secs(60);

/// Interval of the messages that a waiting client gets.
const KEEPALIVE: Duration = Duration::from_millis(500);

/// Factor on the send timeout of frames that a coordinator relays. A coordinator reads one window, and then no more
/// until its client has read half of it: the time that a client may take for one chunk, it may take for several. A
/// coordinator drops the frames of slow clients itself, so this timeout is for coordinators that hang.
const RELAY_TIMEOUT_FACTOR: u32 = 8;

#[tonic::async_trait]
impl Views for ViewsService {
    type RenderStream = Streamed<v1::FrameChunk>;
    type RedeemStream = Streamed<v1::RedeemResponse>;
    type SessionStream = Streamed<v1::SessionResponse>;
    type RenderBatchStream = Streamed<v1::RenderBatchResponse>;

    async fn describe(
        &self,
        _request: Request<v1::DescribeRequest>,
    ) -> Result<Response<v1::DescribeResponse>, Status> {
        Err(ask_the_coordinator())
    }

    async fn names(
        &self,
        _request: Request<v1::NamesRequest>,
    ) -> Result<Response<v1::NamesResponse>, Status> {
        Err(ask_the_coordinator())
    }

    async fn set_transforms(
        &self,
        _request: Request<v1::SetTransformsRequest>,
    ) -> Result<Response<v1::SetTransformsResponse>, Status> {
        Err(ask_the_coordinator())
    }

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let (arrived, span) = (Instant::now(), self.span());
        continued(&span, request.metadata());
        let (chunks, permits) = self.answer(request.into_inner(), arrived, span, false).await?;
        let item_within = self.node.config.read_within * RELAY_TIMEOUT_FACTOR;
        Ok(Response::new(sent(chunks.into_iter(), permits, item_within)))
    }

    async fn redeem(
        &self,
        request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        let arrived = Instant::now();
        let fetching = self.node.redirects.begin_fetch()?;
        let ticket = request.into_inner().ticket.unwrap_or_default();
        let (ticket, key) = self.node.redirects.redeem(&ticket).map_err(invalid)?;
        let v1::RedirectTicket { serial, request, traceparent } = ticket;
        let request = request.ok_or_else(|| invalid(InvalidField::new("ticket", "holds no request")))?;
        let span = self.span();
        continued_from(&span, &traceparent);
        let service = Self { node: self.node.clone() };
        let redeemed = redeemed(fetching, async move {
            let (chunks, permits) = service.answer(request, arrived, span, true).await?;
            let header = chunks.iter().find_map(|chunk| match &chunk.body {
                Some(Body::Header(header)) => Some(header.clone()),
                _ => None,
            });
            let receipt = key.seal(Kind::Receipt, &v1::Receipt { serial, header });
            let bodies = chunks.into_iter().map(Redeemed::Chunk).chain([Redeemed::Receipt(receipt)]);
            Ok((bodies.collect(), permits))
        });
        Ok(Response::new(Box::pin(with_send_timeout(redeemed, self.node.config.read_within))))
    }

    async fn render_batch(
        &self,
        _request: Request<v1::RenderBatchRequest>,
    ) -> Result<Response<Self::RenderBatchStream>, Status> {
        Err(ask_the_coordinator())
    }

    async fn session(
        &self,
        _request: Request<Streaming<v1::SessionRequest>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        Err(ask_the_coordinator())
    }
}

/// The answer for a redirected client. Until the frame is ready, it sends that the worker is working. All of it is
/// sent within [`READ_WITHIN`] or dropped. A client that disconnects cancels its view.
fn redeemed<Held: Send + 'static>(
    permit: impl Send + 'static,
    answer: impl Future<Output = Result<(Vec<Redeemed>, Held), Status>> + Send + 'static,
) -> ReceiverStream<Result<v1::RedeemResponse, Status>> {
    let (sender, receiver) = mpsc::channel(1);
    let response = |body| Ok(v1::RedeemResponse { body: Some(body) });
    tokio::spawn(async move {
        let keepalives = async {
            loop {
                tokio::time::sleep(KEEPALIVE).await;
                // A client that has not read the last message needs no further one.
                let _ = sender.try_send(response(Redeemed::Working(v1::Working {})));
            }
        };
        let answer = tokio::select! {
            answer = answer => answer,
            () = keepalives => return,
            () = sender.closed() => return,
        };
        let sending = async {
            match answer {
                Ok((bodies, held)) => {
                    for body in bodies {
                        // The client may have disconnected.
                        sender.send(response(body)).await.ok()?;
                    }
                    drop(held);
                }
                Err(status) => sender.send(Err(status)).await.ok()?,
            }
            Some(())
        };
        let _ = tokio::time::timeout(READ_WITHIN, sending).await;
        drop(permit);
    });
    ReceiverStream::new(receiver)
}

/// A stream of ready items. It holds `permits` until it is sent, and ends if an item is not read within
/// `item_within`.
fn sent<T: Send + 'static>(
    items: impl Iterator<Item = T> + Send + 'static,
    permits: impl Send + 'static,
    item_within: Duration,
) -> Streamed<T> {
    let items = items.map(move |item| {
        let _held_until_sent = &permits;
        Ok(item)
    });
    Box::pin(with_send_timeout(futures::stream::iter(items), item_within))
}

impl ViewsService {
    /// The trace span of a request.
    fn span(&self) -> Span {
        let worker = self.node.hello.name.as_str();
        debug_span!(target: TARGET, "render", view = field::Empty, worker)
    }

    /// Renders and packs the frame of an order. Returns its chunks, with its request and its reserved memory.
    /// `for_client`: a redirected client reads the frame.
    async fn answer(
        &self,
        request: v1::RenderRequest,
        arrived: Instant,
        span: Span,
        for_client: bool,
    ) -> Result<(Vec<v1::FrameChunk>, (ActiveRequest, FramePermit)), Status> {
        span.record("view", &request.view_id);
        let active = self.node.begin()?;
        let Some(order) = request.order else { return Err(ask_the_coordinator()) };
        self.node.check_term(order.term)?;
        self.node.transforms.known(order.state.map_or(0, |state| state.revision)).await?;
        let (age_ms, observe, predicted) = (order.age_ms, order.observe, order.predicted);
        let ordered = check(&self.node, request.view, order)?;
        let outputs = ordered.outputs;
        let encoding = v1::Encoding::try_from(request.encoding).unwrap_or(v1::Encoding::Unspecified);
        let deadline = (request.deadline_ms > 0).then(|| Duration::from_millis(request.deadline_ms.into()));
        // The rest of the deadline is for packing the frame, if its holes could not be traced in time.
        let trace_until = deadline.map(|deadline| arrived + deadline.mul_f64(0.9));
        let bytes = frame_memory::bytes_of(&ordered.job, outputs);
        let answer = async {
            let permit = self.node.frame_memory.take(bytes, for_client).await?;
            let frame = good_enough(&self.node, &ordered, trace_until).await?;
            // Where nothing predicts whether the bound is kept, it is measured.
            let predicted =
                match (predicted, ordered.is_bounded && matches!(frame.provenance.plan, Plan::Warp(_))) {
                    (None, true) => Some(
                        measured_error::error_of(&self.node, &ordered.job, &frame, trace_until).await.into(),
                    ),
                    (predicted, _) => predicted,
                };
            Ok::<_, Fault>((frame, predicted, permit))
        };
        let answer = answer.instrument(span.clone());
        let (mut frame, predicted, mut permit) = match deadline {
            None => answer.await?,
            Some(deadline) => {
                let late = |_| Fault::Deadline(deadline);
                tokio::time::timeout(deadline, answer).await.map_err(late)??
            }
        };
        probe::consider(&self.node, &ordered, &frame);
        // Fetched samples have their own spans.
        let measured = frame.stages.iter().filter(|stage| stage.name != SAMPLES);
        stages(&span, measured.map(|stage| (stage.name.as_str(), stage.ms)));
        let meta = FrameMeta {
            view_id: request.view_id,
            worker: self.node.hello.name.clone(),
            age_ms,
            ..FrameMeta::default()
        };
        let (node, job, history, flow_to) =
            (self.node.clone(), ordered.job, ordered.history, ordered.flow_to);
        let pack = move || {
            // The next frame may be ordered once this one is sent, so its depth is cached before.
            if let Some((name, left)) = history.zip(History::of(&frame, &job.camera, job.history.as_deref()))
            {
                node.histories.keep(name, left);
            }
            let observed = if observe { Observed::of(&frame) } else { None };
            let camera = (&job.camera, job.rays.as_ref());
            derived::complete(&mut frame, outputs, camera, flow_to.as_ref());
            frame.images.keep_only(outputs);
            encode(&frame, meta, encoding, arrived, observed, predicted)
        };
        let turn = self.node.packing.acquire().await.map_err(|e| Status::internal(e.to_string()))?;
        let chunks =
            tokio::task::spawn_blocking(pack).await.map_err(|e| Status::internal(e.to_string()))??;
        drop((turn, span));
        // The rendered frame is dropped, and only its chunks remain.
        permit.keep(chunks.iter().map(|chunk| chunk.encoded_len() as u64).sum());
        Ok((chunks, (active, permit)))
    }
}

fn ask_the_coordinator() -> Status {
    invalid(InvalidField::new("order", "must be given: clients must send their requests to the coordinator"))
}

/// Packs a frame into chunks. The header has the time of packing.
fn encode(
    frame: &Frame,
    meta: FrameMeta,
    encoding: v1::Encoding,
    arrived: Instant,
    observed: Option<Observed>,
    predicted: Option<v1::Prediction>,
) -> Result<Vec<v1::FrameChunk>, Fault> {
    let began = Instant::now();
    let mut chunks = frame_chunks(frame, &meta, encoding)?;
    if let Some(v1::FrameChunk { body: Some(Body::Header(header)) }) = chunks.first_mut() {
        let ms = began.elapsed().as_secs_f64() * 1e3;
        header.stages.push(v1::Stage { name: "encode".to_owned(), ms });
        (header.observed, header.predicted) = (observed.map(wire::observed), predicted);
        header.age_ms += arrived.elapsed().as_secs_f64() * 1e3;
    }
    Ok(chunks)
}
