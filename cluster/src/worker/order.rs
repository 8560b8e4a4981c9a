//! Orders for views: checked, and carried out.

use std::collections::HashMap;
use std::sync::Arc;

use argus_proto::convert::scene_hash;
use argus_proto::{Fault, v1};
use argus_scene::frame::{Decision, Reason};
use argus_scene::{
    Camera, Difference, FaceMask, Frame, Holes, InvalidField, Output, Outputs, Plan, Provenance, RenderError,
    SampleId, SampleSetInfo, SceneState, Search, Specification, Stage, Version, View, ViewJob, Warp, derived,
};
use futures::future::try_join_all;
use tokio::time::Instant;
use tracing::{debug, warn};

use super::from_sources::{self, From, Gathered};
use super::histories::MAX_NAME;
use super::node::Node;
use super::queue::Rendered;
use super::{fetch, trace};
use crate::core::{Fallback, Source};
use crate::rate_limited_log::RateLimitedLog;
use crate::wire::{self, Probe};

/// Name of the stage that waits for samples.
pub(super) const SAMPLES: &str = "samples";

/// A validated order.
pub(super) struct Ordered {
    pub(super) job: ViewJob,
    pub(super) info: Arc<SampleSetInfo>,
    /// The plan's samples, in the plan's order.
    samples: Vec<Source>,
    /// Where other workers hold the plan's frames.
    pub(super) frames: Vec<Source>,
    /// Addresses of workers that trace holes, if the plan traces them.
    pub(super) tracers: Vec<String>,
    /// The plan is pinned: a frame by another plan is an error.
    pinned: bool,
    /// Required device; empty: any.
    device: String,
    /// Required specification; `None`: any.
    specification: Option<Specification>,
    /// The requested images. The job may have more.
    pub(super) outputs: Outputs,
    /// The camera that flow leads to.
    pub(super) flow_to: Option<Camera>,
    /// Key under which the frame's depth is cached. The job has the previous frame's.
    pub(super) history: Option<String>,
    /// The planner's decision; `None` if the request named the plan.
    decision: Option<Decision>,
    /// What replaces the frame if a sample or frame is missing, or the result is not good enough.
    fallback: Option<Fallback>,
    /// The request bounds the error.
    pub(super) is_bounded: bool,
    /// A direct frame is kept, for other views to be warped from it.
    keeps_frame: bool,
    /// What to measure of the view in spare time.
    pub(super) probe: Option<Probe>,
}

/// Validates an order for a view.
pub(super) fn check(node: &Node, view: Option<v1::View>, order: v1::ViewOrder) -> Result<Ordered, Fault> {
    let state = order.state.map(SceneState::try_from).transpose()?.unwrap_or_default();
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
    // Before a version is looked up, whose number means something else in another scene.
    let (served, _) = node.served.set()?;
    if !order.scene_hash.is_empty() && scene_hash(&order.scene_hash, "order.scene_hash")? != served.scene {
        return Err(Fault::Unavailable("this worker has gone to another scene".to_owned()));
    }
    let (info, limits) = match ids.first() {
        Some(id) => node.served.set_in(Version { number: id.version, state })?,
        None => node.served.set_showing(state)?,
    };
    view.validate(&limits)?;
    for frame in plan.frames() {
        let at =
            |e: InvalidField| InvalidField::new("plan.warp.frames", format!("{}: {}", e.field, e.reason));
        frame.validate(&limits).map_err(at)?;
    }
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
    let frames = sources.into_iter().filter(|(id, _)| id.version == SampleId::FRAMES);
    let frames = frames
        .map(|(id, v1::SampleSource { addresses, dispensable, .. })| Source {
            id,
            faces: FaceMask::ALL,
            addresses,
            dispensable,
        })
        .collect();
    let View { camera, width, height, outputs, pin, plan: asked_plan, flow_to, rays } = view;
    // A pinned direct view is repeated by the backend that rendered it, even if the cluster uses another one.
    let specification = pin.as_ref().and_then(|pin| pin.specification);
    let visibility =
        specification.map_or_else(|| node.served.visibility_of_views(&info), |pinned| pinned.visibility);
    let device = pin.as_ref().map(|pin| pin.device.clone()).unwrap_or_default();
    let time_secs = info.time_secs();
    let (asked, rendered) = (outputs, derived::rendered(outputs));
    let reprojects = matches!(&plan, Plan::Warp(warp) if warp.search == Search::Seeded);
    let name = Some(order.history).filter(|name| reprojects && (1..=MAX_NAME).contains(&name.len()));
    // Extra images: those that the frame is judged by, and those that the next frame's search starts from.
    let is_bounded = asked_plan.max_error.is_some();
    let judged_by = [(Output::Color, order.observe || is_bounded), (Output::Confidence, order.observe)];
    let judged_by = judged_by.into_iter().filter_map(|(output, is_needed)| is_needed.then_some(output));
    let starts_from = [Output::Range, Output::Source].into_iter().filter(|_| name.is_some());
    let outputs = judged_by.chain(starts_from).fold(rendered, Outputs::with);
    let history = name.as_deref().and_then(|name| node.histories.get(name));
    let reflections = info.reflections;
    let job = ViewJob {
        band_rows: 0,
        camera,
        rays,
        width,
        height,
        outputs,
        plan,
        state,
        time_secs,
        visibility,
        reflections,
        history,
    };
    let (tracers, pinned) = (order.tracers, pin.is_some());
    let decision = order.decision.map(Decision::try_from).transpose()?;
    let fallback = order.fallback.map(wire::fallback).transpose()?;
    let probe = order.probe.map(wire::probe).transpose()?;
    let (history, outputs, keeps_frame) = (name, asked, order.keeps_frame);
    Ok(Ordered {
        job,
        info,
        samples,
        frames,
        outputs,
        flow_to,
        tracers,
        pinned,
        device,
        specification,
        history,
        decision,
        fallback,
        is_bounded,
        keeps_frame,
        probe,
    })
}

/// Renders an order by its plan, or from triangles if the order allows it and the plan's frame is not good enough.
pub(super) async fn good_enough(
    node: &Arc<Node>,
    ordered: &Ordered,
    until: Option<Instant>,
) -> Result<Frame, Fault> {
    let began = Instant::now();
    let with = |frame: Frame, decision: Option<Decision>| Frame { decision, ..frame };
    let Some(Fallback { plan, .. }) = &ordered.fallback else {
        return Ok(with(traced(node, ordered, until).await?, ordered.decision));
    };
    match traced(node, ordered, until).await {
        Ok(frame) => return Ok(with(frame, ordered.decision)),
        // A sample was dropped meanwhile, or the samples miss too much of the view.
        Err(fault @ (Fault::NotFound(_) | Fault::Render(RenderError::MissingSample(_)))) => {
            debug!(%fault, "a view is rendered from triangles instead");
        }
        Err(fault) => return Err(fault),
    }
    let refused_ms = began.elapsed().as_secs_f64() * 1e3;
    let job = ViewJob { plan: plan.clone(), history: None, rays: None, ..ordered.job.clone() };
    let mut frame = render_direct(node, ordered, job).await?;
    frame.stages.push(Stage::new(Stage::REFUSED, refused_ms));
    // What it replaces was predicted to be off by more than its replacement.
    let fell_short = |decision| Decision { reason: Reason::FrameFellShort, ..decision };
    Ok(with(frame, ordered.decision.map(fell_short)))
}

/// Renders a frame, and traces its holes if the plan says so. If no worker traces them, a pinned frame fails, and another
/// worker renders it. Any other frame keeps marked holes, and its plan says so.
async fn traced(node: &Arc<Node>, ordered: &Ordered, until: Option<Instant>) -> Result<Frame, Fault> {
    let Plan::Warp(warp) = &ordered.job.plan else {
        return render_direct(node, ordered, ordered.job.clone()).await;
    };
    let traces = warp.holes == Holes::Trace;
    let mut job = ordered.job.clone();
    if traces {
        job.outputs = job.outputs.with(Output::Mask);
    }
    let beside = job.outputs.within(Outputs::GEOMETRY);
    job.outputs = job.outputs.outside(Outputs::GEOMETRY);
    let mut frame = render(node, ordered, &ordered.samples, &job).await?;
    if let Some(Fallback { max_uncovered, .. }) = &ordered.fallback
        && frame.unresolved_fraction > *max_uncovered
    {
        let percent = frame.unresolved_fraction * 100.0;
        return Err(Fault::NotFound(format!("the sources miss {percent:.1}% of the view")));
    }
    let holes = if traces && job.outputs.has(Output::Radiance) { trace::guessed(&frame) } else { Vec::new() };
    let mut filled = traces;
    if traces && let Err(fault) = trace::fill(node, &job, warp, &ordered.tracers, until, &mut frame).await {
        if ordered.pinned {
            return Err(fault);
        }
        static MARKED: RateLimitedLog = RateLimitedLog::new();
        if let Some(left_out) = MARKED.now() {
            warn!(%fault, left_out, "holes of a frame are marked instead of traced");
        }
        if let Plan::Warp(done) = &mut frame.provenance.plan {
            done.holes = Holes::Mark;
        }
        filled = false;
    }
    add_from_triangles(node, &job, &ordered.info, beside, if filled { &holes } else { &[] }, &mut frame)
        .await?;
    if !ordered.job.outputs.has(Output::Mask) {
        frame.images[Output::Mask] = None;
    }
    Ok(frame)
}

/// Adds what a frame from samples has from the triangles: `outputs`, and the radiance of traced pixels.
async fn add_from_triangles(
    node: &Node,
    job: &ViewJob,
    info: &Arc<SampleSetInfo>,
    outputs: Outputs,
    traced: &[u32],
    frame: &mut Frame,
) -> Result<(), Fault> {
    let wanted = if traced.is_empty() { outputs } else { outputs.with(Output::Radiance) };
    let Plan::Warp(Warp { supersampling, .. }) = job.plan else { return Ok(()) };
    if wanted == Outputs::NONE {
        return Ok(());
    }
    let began = Instant::now();
    let plan = Plan::direct(supersampling * supersampling);
    let direct = ViewJob { outputs: wanted, plan, history: None, rays: None, ..job.clone() };
    let rendered = node.render_thread.render_view(direct, info.clone(), Vec::new(), false).await?;
    let mut images = rendered.frame.images;
    trace::place_traced(frame, Output::Radiance, traced, images[Output::Radiance].take());
    frame.images.take_over(images);
    frame.stages.push(Stage::new("geometry", began.elapsed().as_secs_f64() * 1e3));
    Ok(())
}

/// Renders a view from triangles, and keeps its frame if the order says so.
async fn render_direct(node: &Arc<Node>, ordered: &Ordered, mut job: ViewJob) -> Result<Frame, Fault> {
    let exposure = ordered.info.lighting.exposure;
    let to_keep = from_sources::outputs_to_keep(node, &job, exposure).filter(|_| ordered.keeps_frame);
    job.outputs = to_keep.unwrap_or(job.outputs);
    let frame = render(node, ordered, &[], &job).await?;
    if to_keep.is_some() {
        let _ = from_sources::keep(node, &job, &frame, false);
    }
    Ok(frame)
}

/// Gets the samples and renders the frame, with stages for both waits. Retries once, in a separate batch, if the
/// device is lost or the compositor lacks a sample: a view that causes the loss of a device must not fail the views
/// beside it twice.
async fn render(
    node: &Arc<Node>,
    ordered: &Ordered,
    needed: &[Source],
    job: &ViewJob,
) -> Result<Frame, Fault> {
    let mut again = false;
    loop {
        let began = Instant::now();
        let gathered = gather(node, ordered, needed, job).await?;
        let samples_ms = began.elapsed().as_secs_f64() * 1e3;
        let Gathered { job: composed, info, samples, frames } = gathered;
        let rendered = node.render_thread.render_view(composed, info, samples, again).await;
        match rendered {
            Ok(Rendered { mut frame, queue_ms }) => {
                if !job.plan.frames().is_empty() {
                    from_sources::restore_plan(&mut frame, job, frames);
                }
                let Provenance { plan, specification, device, .. } = &frame.provenance;
                if !(ordered.device.is_empty() || ordered.device == *device) {
                    let reason = format!(
                        "the frame was rendered by {device:?}, not by the pinned device {:?}",
                        ordered.device
                    );
                    return Err(Fault::Pin(reason));
                }
                // If the device lacks the requested backend, the sampler uses another one.
                let differs = ordered.specification.zip(*specification);
                if let Some(at) = differs.and_then(|(asked, used)| asked.difference(&used, plan)) {
                    let Difference { field, first, second } = at;
                    return Err(Fault::Pin(format!(
                        "the frame was rendered with {field} {second}, not with the pinned {field} {first}"
                    )));
                }
                let mut stages = vec![Stage::new("queue", queue_ms)];
                if !(needed.is_empty() && job.plan.frames().is_empty()) {
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

/// Gets the samples or the frames of a job. The frames of an order with a fallback are not rendered.
async fn gather(
    node: &Arc<Node>,
    ordered: &Ordered,
    needed: &[Source],
    job: &ViewJob,
) -> Result<Gathered, Fault> {
    if let Plan::Warp(warp) = &job.plan
        && !warp.frames.is_empty()
    {
        let from = From { others: &ordered.frames, renders: ordered.fallback.is_none() };
        return from_sources::gather(node, job, warp, &ordered.info, from).await;
    }
    let fetches = needed.iter();
    let fetches = fetches.map(|needed| fetch::at_hand(node.clone(), ordered.info.clone(), needed.clone()));
    let samples = try_join_all(fetches).await?;
    Ok(Gathered { job: job.clone(), info: ordered.info.clone(), samples, frames: Vec::new() })
}
