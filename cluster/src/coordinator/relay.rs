//! A view's way through the coordinator: ask the core, open the worker's stream, pass its chunks on.
//!
//! Chunks are relayed as they come. A worker that fails before its first chunk costs nothing but time. One
//! that fails in the middle of a frame is replaced as well: a frame's bytes are a function of its provenance,
//! so another worker's are the same, and what the client already has is skipped. Only the frame's header is
//! looked at, to make sure of that, to add the relay's own time, and to learn how many pixels no sample saw. Where
//! the request bounds the error, it also says what the frame's pixels look like, and the core decides whether the
//! frame is passed on or thrown away.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::trace::within;
use argus_proto::v1::frame_chunk::Body;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{Fault, v1};
use argus_scene::{Prediction, Stage, View};
use futures::Stream;
use tokio::time::Instant;
use tonic::{Code, Status, Streaming};
use tracing::{Instrument, Span, debug};

use super::hub::{Asked, Hub, Ruling, Verdict};
use crate::core::{Client, Order};
use crate::wire;

/// How long a worker that has sent all of a frame may take to say so.
const LAST_WORD: Duration = Duration::from_secs(1);

/// A view that is asked for.
pub(super) struct Wanted {
    /// Who asks.
    pub(super) client: Client,
    /// Checked.
    pub(super) view: View,
    /// As it came, to be sent on.
    pub(super) wire: v1::View,
    pub(super) view_id: String,
    pub(super) deadline: Option<Duration>,
    pub(super) encoding: i32,
    /// Under which name its worker keeps what it leaves for its session's next frame; empty: it does not.
    pub(super) history: String,
    /// When its request arrived.
    pub(super) arrived: Instant,
    /// Its way through this process.
    pub(super) span: Span,
}

/// What a client already has of a frame.
#[derive(Default)]
struct Relayed {
    header: Option<v1::FrameHeader>,
    bytes: u64,
    /// Milliseconds of rendering what was thrown away.
    refused_ms: f64,
}

/// How an attempt ended early.
enum Broken {
    /// The core gave the view to another worker, or refused it.
    Overruled(Verdict),
    /// The worker failed.
    Failed(Status),
}

/// The frame of a view in chunks. Dropping the stream cancels the view.
pub(super) fn relay(hub: Arc<Hub>, wanted: Wanted) -> impl Stream<Item = Result<v1::FrameChunk, Status>> {
    async_stream::try_stream! {
        let mut asked = ask(&hub, &wanted);
        let order = ordered(&mut asked).await?;
        for await chunk in relay_from(hub, wanted, asked, order) {
            yield chunk?;
        }
    }
}

/// Asks the core for a view.
pub(super) fn ask(hub: &Arc<Hub>, wanted: &Wanted) -> Asked {
    hub.ask(wanted.client.clone(), wanted.view.clone(), wanted.deadline)
}

/// The frame of a view that was asked for and ordered.
pub(super) fn relay_from(
    hub: Arc<Hub>,
    wanted: Wanted,
    mut asked: Asked,
    mut order: Box<Order>,
) -> impl Stream<Item = Result<v1::FrameChunk, Status>> {
    async_stream::try_stream! {
        let mut relayed = Relayed::default();
        loop {
            let mut chunks: Option<Streaming<v1::FrameChunk>> = None;
            let broken = loop {
                // Both futures are safe to drop at any await: an RPC that is not read on is cancelled.
                let next = async {
                    match &mut chunks {
                        Some(chunks) => Ok((None, chunks.message().await?)),
                        None => {
                            let mut opened = open(&hub, &wanted, &order).instrument(wanted.span.clone()).await?;
                            let first = opened.message().await?;
                            Ok::<_, Status>((Some(opened), first))
                        }
                    }
                };
                let next = tokio::select! {
                    biased;
                    verdict = asked.verdict() => break Broken::Overruled(verdict),
                    next = next => next,
                };
                match next {
                    Err(status) => break Broken::Failed(status),
                    Ok((_, None)) => {
                        break Broken::Failed(Status::data_loss("the worker ended a frame before its end"));
                    }
                    Ok((opened, Some(chunk))) => {
                        chunks = opened.or(chunks);
                        if order.judged && relayed.header.is_none() {
                            let verdict = judge(&mut asked, &order, &chunk, &mut relayed).await;
                            match verdict {
                                Ok(Ruling::Deliver { attempt, expected }) if attempt == order.attempt => {
                                    order.expected = Some(expected);
                                }
                                overruled => break Broken::Overruled(overruled),
                            }
                        }
                        match relayed.pass(chunk, wanted.arrived, order.expected) {
                            Ok(Some(chunk)) if relayed.is_whole() => {
                                // Said before the client has it, who may go as soon as it does.
                                hub.frames.relayed();
                                arrived(&hub, asked, &order, relayed.header.as_ref());
                                yield chunk;
                                // Reading to the end lets the worker's stream close in order, if it does soon.
                                if let Some(chunks) = &mut chunks {
                                    let _ = tokio::time::timeout(LAST_WORD, chunks.message()).await;
                                }
                                return;
                            }
                            Ok(Some(chunk)) => yield chunk,
                            Ok(None) => {}
                            Err(status) => break Broken::Failed(status),
                        }
                    }
                }
            };
            order = match broken {
                Broken::Overruled(Ok(Ruling::Carry(order))) => order,
                // A ruling about nothing that is awaited: once more from the beginning.
                Broken::Overruled(Ok(Ruling::Deliver { .. })) => order,
                Broken::Overruled(Err(fault)) => Err(fault)?,
                Broken::Failed(status) if !another_may_succeed(&status) => {
                    asked.failed(order.attempt);
                    Err(status)?;
                    return;
                }
                Broken::Failed(status) => {
                    debug!(view = wanted.view_id, attempt = order.attempt, %status, "attempt failed");
                    match is_its_own(&status) {
                        true => asked.blame_worker(order.attempt),
                        false => asked.try_elsewhere(order.attempt),
                    }
                    // Where no other is left, what the last one said tells more than that it was the last.
                    match ordered(&mut asked).await {
                        Err(Fault::Unavailable(_)) => Err(status)?,
                        order => order?,
                    }
                }
            };
        }
    }
}

/// The next order; a ruling about a frame that is no longer awaited is passed over.
pub(super) async fn ordered(asked: &mut Asked) -> Result<Box<Order>, Fault> {
    loop {
        if let Ruling::Carry(order) = asked.verdict().await? {
            return Ok(order);
        }
    }
}

/// What the core says about a frame, by its header. Waiting for it is short: the core never waits.
async fn judge(asked: &mut Asked, order: &Order, first: &v1::FrameChunk, relayed: &mut Relayed) -> Verdict {
    let header = match &first.body {
        Some(Body::Header(header)) => Some(header),
        _ => None,
    };
    let ms = header.map_or(0.0, rendering_ms);
    asked.judge(order.attempt, header.and_then(|header| header.observed).map(wire::observed_from), ms);
    let verdict = asked.verdict().await;
    if matches!(&verdict, Ok(Ruling::Carry(_))) && ms.is_finite() {
        relayed.refused_ms += ms;
    }
    verdict
}

/// The client has its frame, of which the header is known unless its worker told nothing of it.
pub(super) fn arrived(hub: &Hub, asked: Asked, order: &Order, header: Option<&v1::FrameHeader>) {
    // What a judged frame cost was said then.
    let ms = header.filter(|_| !order.judged).map(rendering_ms);
    asked.answered(order.attempt, header.map(uncovered), ms);
    header.into_iter().for_each(|header| hub.frames.arrived(header));
}

/// Pixels of a frame that none of its samples saw.
pub(super) fn uncovered(header: &v1::FrameHeader) -> u64 {
    let pixels = f64::from(header.width) * f64::from(header.height);
    // What was traced is no longer unresolved. A number that is none counts as nothing.
    let guessed = (header.unresolved_fraction * pixels).round() as u64;
    guessed.saturating_add(header.served.map_or(0, |served| served.traced))
}

/// Milliseconds of a frame's stages that were spent on rendering it.
pub(super) fn rendering_ms(header: &v1::FrameHeader) -> f64 {
    header.stages.iter().filter(|stage| !Stage::is_on_the_way(&stage.name)).map(|stage| stage.ms).sum()
}

/// Whether a worker's failure may be its own: all but what is wrong with the request itself.
fn another_may_succeed(status: &Status) -> bool {
    !matches!(status.code(), Code::InvalidArgument | Code::DeadlineExceeded | Code::Unimplemented)
}

/// Whether a failure says that a worker does not work: not that it has no room, or may not do what it was asked.
fn is_its_own(status: &Status) -> bool {
    matches!(status.code(), Code::Unavailable | Code::Internal | Code::DataLoss | Code::Unknown)
}

/// An order as its worker gets it.
pub(super) fn request(hub: &Hub, wanted: &Wanted, order: &Order) -> v1::RenderRequest {
    let age = wanted.arrived.elapsed();
    let left = wanted.deadline.map_or(0, |deadline| {
        // 0 would mean: no deadline.
        u32::try_from(deadline.saturating_sub(age).as_millis()).unwrap_or(u32::MAX).max(1)
    });
    v1::RenderRequest {
        view_id: wanted.view_id.clone(),
        view: Some(wanted.wire.clone()),
        deadline_ms: left,
        encoding: wanted.encoding,
        order: Some(v1::ViewOrder {
            term: hub.term(),
            epoch: order.epoch,
            plan: Some((&order.plan).into()),
            sources: wire::sources(order.sources.clone()),
            age_ms: age.as_secs_f64() * 1e3,
            tracers: order.tracers.clone(),
            observe: order.judged,
            predicted: order.expected.map(Into::into),
            history: wanted.history.clone(),
            decision: order.decision.map(Into::into),
            fallback_samples_per_pixel: order.fallback.unwrap_or(0),
        }),
    }
}

async fn open(hub: &Hub, wanted: &Wanted, order: &Order) -> Result<Streaming<v1::FrameChunk>, Status> {
    let request = request(hub, wanted, order);
    let mut client = ViewsClient::new(hub.channels.to(&order.address)?);
    Ok(client.render(within(&wanted.span, request)).await?.into_inner())
}

impl Relayed {
    /// Whether the client has, with the chunk passed last, all of the frame.
    fn is_whole(&self) -> bool {
        let due =
            |header: &v1::FrameHeader| header.images.iter().map(|image| image.packed_bytes).sum::<u64>();
        self.header.as_ref().is_some_and(|header| self.bytes == due(header))
    }

    /// What to send on of a chunk; `None` if the client has it already.
    fn pass(
        &mut self,
        chunk: v1::FrameChunk,
        arrived: Instant,
        expected: Option<Prediction>,
    ) -> Result<Option<v1::FrameChunk>, Status> {
        match chunk.body {
            Some(Body::Header(mut header)) => {
                let begun_from_history = |header: &v1::FrameHeader| {
                    header.provenance.as_ref().is_some_and(|provenance| provenance.history)
                };
                // Nobody repeats a frame that began from an earlier one: a session's client has it anew.
                if self.header.iter().chain([&header]).any(begun_from_history) {
                    (self.header, self.bytes) = (None, 0);
                }
                if let Some(sent) = &self.header {
                    let same = sent.provenance == header.provenance && sent.images == header.images;
                    let reason = "the worker failed within a frame, and no other makes the same one";
                    return if same { Ok(None) } else { Err(Status::unavailable(reason)) };
                }
                let age_ms = arrived.elapsed().as_secs_f64() * 1e3;
                let relay_ms = (age_ms - header.age_ms).max(0.0);
                header.stages.push(v1::Stage { name: "relay".to_owned(), ms: relay_ms });
                header.age_ms = age_ms;
                if self.refused_ms > 0.0 {
                    let name = Stage::REFUSED.to_owned();
                    header.stages.push(v1::Stage { name, ms: self.refused_ms });
                }
                header.predicted = expected.map(Into::into);
                header.observed = None;
                self.header = Some(header.clone());
                Ok(Some(v1::FrameChunk { body: Some(Body::Header(header)) }))
            }
            Some(Body::Data(data)) => {
                // Every worker cuts the same bytes at the same places.
                if data.offset < self.bytes {
                    return Ok(None);
                }
                self.bytes = data.offset + data.bytes.len() as u64;
                Ok(Some(v1::FrameChunk { body: Some(Body::Data(data)) }))
            }
            None => Err(Status::data_loss("the worker sent an empty chunk")),
        }
    }
}
