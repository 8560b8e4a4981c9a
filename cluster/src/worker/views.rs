//! `Views` as a worker serves it: to its coordinator, with orders, and to clients that were sent here with one.

use std::collections::HashMap;
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
use argus_scene::frame::{Decision, Reason};
use argus_scene::{
    Difference, FaceMask, Frame, History, Holes, InvalidField, Output, Outputs, Plan, Provenance,
    RenderError, SampleCamera, SampleId, SampleSetInfo, SceneState, Search, Specification, Stage, Version,
    View, ViewJob,
};
use futures::Stream;
use futures::future::try_join_all;
use prost::Message;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};
use tracing::{Instrument, Span, debug_span, field, warn};

use super::frame_memory::{self, FramePermit};
use super::histories::MAX_NAME;
use super::node::{Active, Node};
use super::queue::Rendered;
use super::{bound, fetch, probe, trace};
use crate::core::Source;
use crate::core::quality::Observed;
use crate::rate_limited_log::RateLimitedLog;
use crate::sealed::Kind;
use crate::send_timeout::with_send_timeout;
use crate::wire;

/// The service.
pub(super) struct ViewsService {
    pub(super) node: Arc<Node>,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// How long a client may take to read all of a frame that it fetches: nobody's patience with a slow one ends before.
const READ_WITHIN: Duration = Duration::from_secs(60);

/// How often a client that waits for its frame hears that it is in work.
const BEAT: Duration = Duration::from_millis(500);

/// A coordinator reads a window ahead of its client, and then no more until the client has read half of that: what a client
/// may take for a chunk, it may take for several. It drops what its client does not read; this is for one that hangs.
const RELAY_PATIENCE: u32 = 8;

/// The stage of waiting for samples.
const SAMPLES: &str = "samples";

/// A view as ordered, checked.
struct Ordered {
    job: ViewJob,
    info: Arc<SampleSetInfo>,
    /// The plan's samples in its order.
    samples: Vec<Source>,
    /// Who traces what no sample saw, where the plan wants that.
    tracers: Vec<String>,
    /// Exactly this plan, or no frame.
    pinned: bool,
    /// The device that the frame must be of; any if empty.
    device: String,
    /// The specification that the frame must have; any if absent.
    specification: Option<Specification>,
    /// The images that the frame shall hold; the job's may be more.
    outputs: Outputs,
    /// Under which name what it leaves for the next frame is kept; the job has what the last one left.
    history: Option<String>,
    /// How the plan was chosen; `None` where the request named it.
    decision: Option<Decision>,
    /// The direct view that is rendered instead, where a sample is missing or the frame from samples is not good enough.
    fallback: Option<Plan>,
}

/// Sub-pixels of a pixel, at most.
const MOST_SUB_PIXELS: u32 = 256;

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

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let (arrived, span) = (Instant::now(), self.span());
        continued(&span, request.metadata());
        let (chunks, places) = self.answer(request.into_inner(), arrived, span, false).await?;
        let patience = self.node.config.read_within * RELAY_PATIENCE;
        Ok(Response::new(sent(chunks.into_iter(), places, patience)))
    }

    async fn redeem(
        &self,
        request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        let arrived = Instant::now();
        let fetching = self.node.begin_fetch()?;
        let ticket = request.into_inner().ticket.unwrap_or_default();
        let (ticket, key) = self.node.admit(&ticket).map_err(invalid)?;
        let v1::RedirectTicket { serial, request, traceparent } = ticket;
        let request = request.ok_or_else(|| invalid(InvalidField::new("ticket", "holds no request")))?;
        let span = self.span();
        continued_from(&span, &traceparent);
        let service = Self { node: self.node.clone() };
        let answered = answered(fetching, async move {
            let (chunks, places) = service.answer(request, arrived, span, true).await?;
            let header = chunks.iter().find_map(|chunk| match &chunk.body {
                Some(Body::Header(header)) => Some(header.clone()),
                _ => None,
            });
            let receipt = key.seal(Kind::Receipt, &v1::Receipt { serial, header });
            let bodies = chunks.into_iter().map(Redeemed::Chunk).chain([Redeemed::Receipt(receipt)]);
            Ok((bodies.collect(), places))
        });
        Ok(Response::new(Box::pin(with_send_timeout(answered, self.node.config.read_within))))
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

/// What a client is answered: until there is a frame, that it is in work. All of it is sent in [`READ_WITHIN`] or dropped,
/// and the places that it holds with it. A client that goes ends the work for it.
fn answered<Held: Send + 'static>(
    place: impl Send + 'static,
    answer: impl Future<Output = Result<(Vec<Redeemed>, Held), Status>> + Send + 'static,
) -> ReceiverStream<Result<v1::RedeemResponse, Status>> {
    let (sender, receiver) = mpsc::channel(1);
    let said = |body| Ok(v1::RedeemResponse { body: Some(body) });
    tokio::spawn(async move {
        let beats = async {
            loop {
                tokio::time::sleep(BEAT).await;
                // One that has not read the last one needs no other.
                let _ = sender.try_send(said(Redeemed::Working(v1::Working {})));
            }
        };
        let answer = tokio::select! {
            answer = answer => answer,
            () = beats => return,
            () = sender.closed() => return,
        };
        let sending = async {
            match answer {
                Ok((bodies, held)) => {
                    for body in bodies {
                        // A client that is gone needs no more.
                        sender.send(said(body)).await.ok()?;
                    }
                    drop(held);
                }
                Err(status) => sender.send(Err(status)).await.ok()?,
            }
            Some(())
        };
        let _ = tokio::time::timeout(READ_WITHIN, sending).await;
        drop(place);
    });
    ReceiverStream::new(receiver)
}

/// A stream of what is there already, which has its `places` until it is sent. Nothing makes who asked read it: an item
/// that is not read in time ends it.
fn sent<T: Send + 'static>(
    items: impl Iterator<Item = T> + Send + 'static,
    places: impl Send + 'static,
    item_within: Duration,
) -> Streamed<T> {
    let items = items.map(move |item| {
        let _in_work_until_sent = &places;
        Ok(item)
    });
    Box::pin(with_send_timeout(futures::stream::iter(items), item_within))
}

impl ViewsService {
    /// What a request's way through this worker is traced as.
    fn span(&self) -> Span {
        let worker = self.node.hello.name.as_str();
        debug_span!(target: TARGET, "render", view = field::Empty, worker)
    }

    /// The frame of an order, in chunks, and the places that it has among requests and in memory. `for_client`: it is not
    /// the coordinator who reads it.
    async fn answer(
        &self,
        request: v1::RenderRequest,
        arrived: Instant,
        span: Span,
        for_client: bool,
    ) -> Result<(Vec<v1::FrameChunk>, (Active, FramePermit)), Status> {
        span.record("view", &request.view_id);
        let active = self.node.begin()?;
        let Some(order) = request.order else { return Err(ask_the_coordinator()) };
        self.node.check_term(order.term)?;
        let (age_ms, observe, predicted) = (order.age_ms, order.observe, order.predicted);
        let ordered = check(&self.node, request.view, order)?;
        let outputs = ordered.outputs;
        let encoding = v1::Encoding::try_from(request.encoding).unwrap_or(v1::Encoding::Unspecified);
        let deadline = (request.deadline_ms > 0).then(|| Duration::from_millis(request.deadline_ms.into()));
        // What is left of it is for packing a frame whose holes could not be traced in time.
        let trace_until = deadline.map(|deadline| arrived + deadline.mul_f64(0.9));
        let bytes = frame_memory::bytes_of(&ordered.job);
        let answer = async {
            let permit = self.node.frame_memory.take(bytes, for_client).await?;
            Ok::<_, Fault>((good_enough(&self.node, &ordered, trace_until).await?, permit))
        };
        let answer = answer.instrument(span.clone());
        let (frame, mut permit) = match deadline {
            None => answer.await?,
            Some(deadline) => {
                let late = |_| Fault::Deadline(deadline);
                tokio::time::timeout(deadline, answer).await.map_err(late)??
            }
        };
        probe::consider(&self.node, &ordered.job, &frame);
        // Fetching samples has spans of its own.
        let measured = frame.stages.iter().filter(|stage| stage.name != SAMPLES);
        stages(&span, measured.map(|stage| (stage.name.as_str(), stage.ms)));
        let meta = FrameMeta { view_id: request.view_id, worker: self.node.hello.name.clone(), age_ms };
        let (node, job, history) = (self.node.clone(), ordered.job, ordered.history);
        let pack = move || {
            // Whatever became of its holes: the next frame is ordered once this one has been sent.
            if let Some((name, left)) = history.zip(History::of(&frame, &job.camera, job.history.as_deref()))
            {
                node.histories.keep(name, left);
            }
            let observed = if observe { Observed::of(&frame) } else { None };
            encode(&with_only(frame, outputs), meta, encoding, arrived, observed, predicted)
        };
        let turn = self.node.packing.acquire().await.map_err(|e| Status::internal(e.to_string()))?;
        let chunks =
            tokio::task::spawn_blocking(pack).await.map_err(|e| Status::internal(e.to_string()))??;
        drop((turn, span));
        // The frame as it was rendered is gone.
        permit.keep(chunks.iter().map(|chunk| chunk.encoded_len() as u64).sum());
        Ok((chunks, (active, permit)))
    }
}

fn ask_the_coordinator() -> Status {
    invalid(InvalidField::new("order", "must be given: clients ask the coordinator, which sends orders here"))
}

fn check(node: &Node, view: Option<v1::View>, order: v1::ViewOrder) -> Result<Ordered, Fault> {
    let state: SceneState = order.state.map(SceneState::from).unwrap_or_default();
    let view = View::try_from(view.ok_or_else(|| InvalidField::new("view", "must be given"))?)?;
    let plan = Plan::try_from(order.plan.ok_or_else(|| InvalidField::new("order.plan", "must be given"))?)?;
    let mut sources: HashMap<SampleId, v1::SampleSource> =
        order.sources.into_iter().filter_map(|source| Some((SampleId::from(source.id?), source))).collect();
    let ids: &[SampleId] = match &plan {
        Plan::Direct { .. } => &[],
        Plan::Warp(warp) => &warp.samples,
    };
    let faces_of = |camera| match &plan {
        Plan::Direct { .. } => FaceMask::ALL,
        Plan::Warp(warp) => warp.faces.of(camera),
    };
    let (info, limits) = match ids.first() {
        Some(id) => node.set_in(Version { number: id.version, state })?,
        None => node.set_showing(state)?,
    };
    view.validate(&limits)?;
    let mut samples = Vec::with_capacity(ids.len());
    for id in ids {
        if id.version != info.version.number {
            let reason = format!("sample {id} is ordered for a view of version {}", info.version.number);
            return Err(Fault::Unavailable(reason));
        }
        info.camera(id.camera)?;
        let v1::SampleSource { addresses, dispensable, .. } = sources.remove(id).unwrap_or_default();
        samples.push(Source { id: *id, faces: faces_of(id.camera), addresses, dispensable });
    }
    let View { camera, width, height, outputs, pin, .. } = view;
    // A view from triangles can be repeated by the backend that it was rendered with, whichever is this cluster's.
    let specification = pin.as_ref().and_then(|pin| pin.specification);
    let visibility = specification.map_or_else(|| node.visibility_of(&info), |pinned| pinned.visibility);
    let device = pin.as_ref().map(|pin| pin.device.clone()).unwrap_or_default();
    let time_secs = info.time_secs();
    let asked = outputs;
    let begins = matches!(&plan, Plan::Warp(warp) if warp.search == Search::Seeded);
    let name = Some(order.history).filter(|name| begins && (1..=MAX_NAME).contains(&name.len()));
    // What the frame is judged by, and what the next one begins from, whether or not it was asked for.
    let judged_by = [Output::Color, Output::Confidence].into_iter().filter(|_| order.observe);
    let begun_from = [Output::Range, Output::Source].into_iter().filter(|_| name.is_some());
    let outputs = judged_by.chain(begun_from).fold(asked, Outputs::with);
    let history = name.as_deref().and_then(|name| node.histories.get(name));
    let (epoch, reflections) = (state.epoch, info.reflections);
    let job =
        ViewJob { camera, width, height, outputs, plan, epoch, time_secs, visibility, reflections, history };
    let (tracers, pinned) = (order.tracers, pin.is_some());
    let decision = order.decision.map(Decision::try_from).transpose()?;
    let fallback = (1..=MOST_SUB_PIXELS).contains(&order.fallback_samples_per_pixel);
    let fallback = fallback.then_some(Plan::Direct { samples_per_pixel: order.fallback_samples_per_pixel });
    let (history, outputs) = (name, asked);
    Ok(Ordered {
        job,
        info,
        samples,
        outputs,
        tracers,
        pinned,
        device,
        specification,
        history,
        decision,
        fallback,
    })
}

/// The frame with only the outputs that were requested.
fn with_only(mut frame: Frame, outputs: Outputs) -> Frame {
    for output in Output::ALL.into_iter().filter(|&output| !outputs.has(output)) {
        *frame.image_mut(output) = None;
    }
    frame
}

/// The frame of an order: by its plan or, where the order allows it and that plan's frame is not good enough, from triangles.
async fn good_enough(node: &Arc<Node>, ordered: &Ordered, until: Option<Instant>) -> Result<Frame, Fault> {
    let began = Instant::now();
    let with = |frame: Frame, decision: Option<Decision>| Frame { decision, ..frame };
    let Some(plan) = &ordered.fallback else {
        return Ok(with(traced(node, ordered, until).await?, ordered.decision));
    };
    match traced(node, ordered, until).await {
        Ok(frame) => return Ok(with(frame, ordered.decision)),
        // A sample that was held is not held any more, or too little was seen by those that are.
        Err(Fault::NotFound(_) | Fault::Render(RenderError::MissingSample(_))) => {}
        Err(fault) => return Err(fault),
    }
    let refused_ms = began.elapsed().as_secs_f64() * 1e3;
    let job = ViewJob { plan: plan.clone(), history: None, ..ordered.job.clone() };
    let mut frame = render(node, ordered, &[], &job).await?;
    frame.stages.push(Stage::new(Stage::REFUSED, refused_ms));
    let fell_short = |decision| Decision { reason: Reason::FrameFellShort, excess: 0.0, ..decision };
    Ok(with(frame, ordered.decision.map(fell_short)))
}

/// The frame, with what no sample saw traced where the plan wants that. A frame whose holes nobody traces is
/// delivered with them marked, under a plan that says so; a pinned one is left to another worker.
async fn traced(node: &Arc<Node>, ordered: &Ordered, until: Option<Instant>) -> Result<Frame, Fault> {
    let Plan::Warp(warp) = &ordered.job.plan else {
        return render(node, ordered, &ordered.samples, &ordered.job).await;
    };
    let traces = warp.holes == Holes::Trace;
    let mut job = ordered.job.clone();
    job.outputs.mask |= traces;
    if ordered.fallback.is_some() {
        // What it is judged by.
        (job.outputs.range, job.outputs.source) = (true, true);
    }
    let mut frame = render(node, ordered, &ordered.samples, &job).await?;
    if ordered.fallback.is_some()
        && let Some(reason) = bound::shortfall(&frame, &job.camera, &sample_cameras(ordered)?)
    {
        return Err(Fault::NotFound(reason));
    }
    if traces && let Err(fault) = trace::fill(node, &job, warp, &ordered.tracers, until, &mut frame).await {
        if ordered.pinned {
            return Err(fault);
        }
        static MARKED: RateLimitedLog = RateLimitedLog::new();
        if let Some(left_out) = MARKED.now() {
            warn!(%fault, left_out, "a frame is delivered with its holes marked instead of traced");
        }
        if let Plan::Warp(done) = &mut frame.provenance.plan {
            done.holes = Holes::Mark;
        }
    }
    if !ordered.job.outputs.mask {
        frame.mask = None;
    }
    Ok(frame)
}

/// The cameras of a plan's samples, in the order in which a frame's source counts them.
fn sample_cameras(ordered: &Ordered) -> Result<Vec<SampleCamera>, Fault> {
    let of_rig = ordered.samples.iter().filter(|source| !source.id.is_reflection_probe());
    of_rig.map(|source| Ok(ordered.info.camera(source.id.camera)?)).collect()
}

/// The frame as composed or rendered, with the stages before the role's own. If the device is lost, or the
/// compositor misses what it was given, everything is done once more, in a batch of its own: a view that takes
/// devices down shall not take its neighbours down twice.
async fn render(
    node: &Arc<Node>,
    ordered: &Ordered,
    needed: &[Source],
    job: &ViewJob,
) -> Result<Frame, Fault> {
    let mut again = false;
    loop {
        let began = Instant::now();
        let fetches = needed.iter();
        let fetches =
            fetches.map(|needed| fetch::at_hand(node.clone(), ordered.info.clone(), needed.clone()));
        let samples = try_join_all(fetches).await?;
        let samples_ms = began.elapsed().as_secs_f64() * 1e3;
        let rendered = node.render_view(job.clone(), ordered.info.clone(), samples, again).await;
        match rendered {
            Ok(Rendered { mut frame, queue_ms }) => {
                let Provenance { plan, specification, device, .. } = &frame.provenance;
                if !(ordered.device.is_empty() || ordered.device == *device) {
                    let reason = format!("{device:?} answered, not the device {:?}", ordered.device);
                    return Err(Fault::Pin(reason));
                }
                // Where the device does not have the backend that was asked for, the sampler takes another one.
                let differs = ordered.specification.zip(*specification);
                if let Some(at) = differs.and_then(|(asked, used)| asked.difference(&used, plan)) {
                    let Difference { field, first, second } = at;
                    return Err(Fault::Pin(format!("{field} {second} answered, not {field} {first}")));
                }
                let mut stages = vec![Stage::new("queue", queue_ms)];
                if !needed.is_empty() {
                    stages.insert(0, Stage::new(SAMPLES, samples_ms));
                }
                frame.stages.splice(0..0, stages);
                return Ok(frame);
            }
            Err(Fault::Render(RenderError::DeviceLost(_) | RenderError::MissingSample(_))) if !again => {
                again = true;
                let ids: Vec<SampleId> = needed.iter().map(|needed| needed.id).collect();
                node.store.forget(&ids);
            }
            Err(fault) => return Err(fault),
        }
    }
}

/// The frame in chunks, what packing took in its header.
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
