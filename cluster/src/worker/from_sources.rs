//! Views that are warped from sources: which frames are kept for them, and what they are composed of.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{
    Detail, Frame, FrameSource, Output, Outputs, Plan, Sample, SampleId, SampleSetInfo, SurfaceLight,
    ViewJob, Warp,
};
use futures::future::try_join_all;
use tracing::debug;

use super::fetch;
use super::fetches::Purpose;
use super::node::Node;
use super::queue::Rendered;
use super::sources::{Origin, SourceKey};
use crate::core::Source;

/// The images that a job needs so that its direct frame can be kept: those that were asked for, and range. `None` if its
/// frame has no colour or would not fit, or its exposure is out of the range of a texel.
pub(super) fn outputs_to_keep(node: &Node, job: &ViewJob, exposure: f32) -> Option<Outputs> {
    let fits = FrameSource::allows(exposure) && node.sources.has_room_for(&source_of(job, 1));
    (job.outputs.has(Output::Color) && fits).then_some(job.outputs.with(Output::Range))
}

/// Keeps a direct frame, which was rendered for a job, to warp other views from it. Returns its key. A frame that shows light cells of an
/// earlier pose is not kept: it cannot be rendered again, so a view warped from it could not be pinned.
pub(super) fn keep(node: &Node, job: &ViewJob, frame: &Frame, bought: bool) -> Option<SourceKey> {
    let Plan::Direct { samples_per_pixel, detail: Detail::Full, light } = frame.provenance.plan else {
        return None;
    };
    if matches!(light, Some(SurfaceLight::OlderCells { .. })) {
        return None;
    }
    let key = SourceKey::of(&FrameSource { light, ..source_of(job, samples_per_pixel) }, job);
    node.sources.keep(key, frame, Origin { bought, render_ms: frame.rendering_ms() })?;
    Some(key)
}

/// The direct frame of a job.
fn source_of(job: &ViewJob, samples_per_pixel: u32) -> FrameSource {
    let ViewJob { camera, width, height, band_rows, .. } = *job;
    FrameSource { camera, width, height, samples_per_pixel, band_rows, light: None }
}

/// What a view from sources is composed of.
pub(super) struct Gathered {
    /// The job, whose plan names the sources as samples.
    pub(super) job: ViewJob,
    pub(super) info: Arc<SampleSetInfo>,
    pub(super) samples: Vec<Arc<Sample>>,
    /// The frames, each with the light that it has; none where samples are of a set.
    pub(super) frames: Vec<FrameSource>,
}

/// Where the sources of a job are from.
pub(super) struct From<'a> {
    /// Sources that other workers hold.
    pub(super) others: &'a [Source],
    /// Those that no worker has are rendered here.
    pub(super) renders: bool,
}

/// Gathers the sources of a job's plan.
///
/// # Errors
/// [`Fault::NotFound`] for a source that no worker has, unless it is rendered; else the error of rendering it.
pub(super) async fn gather(
    node: &Arc<Node>,
    job: &ViewJob,
    warp: &Warp,
    info: &Arc<SampleSetInfo>,
    from: From<'_>,
) -> Result<Gathered, Fault> {
    let all = warp.frames.iter().map(|source| at_hand(node, job, SourceKey::of(source, job), info, &from));
    let (frames, samples): (Vec<FrameSource>, Vec<Arc<Sample>>) =
        try_join_all(all).await?.into_iter().unzip();
    let ids = samples.iter().map(|sample| sample.id).collect();
    let plan = Plan::Warp(Warp { samples: ids, ..warp.clone() });
    let set = node.sources.set_of(info, job.visibility);
    Ok(Gathered { job: ViewJob { plan, ..job.clone() }, info: set, samples, frames })
}

/// Gets a source: from the store, from another worker, or by rendering.
async fn at_hand(
    node: &Arc<Node>,
    job: &ViewJob,
    key: SourceKey,
    info: &Arc<SampleSetInfo>,
    from: &From<'_>,
) -> Result<(FrameSource, Arc<Sample>), Fault> {
    if let Some(found) = node.sources.get(&key) {
        return Ok(found);
    }
    let named = |id: SampleId| from.others.iter().find(|source| source.id == id);
    if let Some((key, source)) = key.with_lights().find_map(|key| Some((key, named(key.id())?))) {
        match fetched(node, key, info, &source.addresses).await {
            Ok(sample) => return Ok((key.source, sample)),
            Err(fault) => debug!(id = %key.id(), %fault, "a source cannot be had from other workers"),
        }
    }
    match from.renders {
        true => rendered(node, job, &key, info).await,
        false => Err(Fault::NotFound("a frame that the view is warped from was dropped".to_owned())),
    }
}

/// Fetches a source from the first of these workers that has it, and keeps it. Views that need it at the same time share one fetch.
async fn fetched(
    node: &Arc<Node>,
    key: SourceKey,
    info: &Arc<SampleSetInfo>,
    addresses: &[String],
) -> Result<Arc<Sample>, Fault> {
    let fetch = node.fetches.join((key.id(), Purpose::View), || {
        let (node, info, addresses) = (node.clone(), info.clone(), addresses.to_vec());
        Box::pin(async move {
            let mut last = Fault::NotFound("no worker is known to hold it".to_owned());
            for address in addresses.iter().filter(|address| **address != node.hello.address) {
                match fetch::source_from(&node, &info, &key, address).await {
                    Ok((sample, chunks)) => {
                        let sample = Arc::new(sample);
                        node.store.keep_packed(sample.id, chunks);
                        let origin = Origin { bought: false, render_ms: 0.0 };
                        node.sources.keep_sample(key, sample.clone(), origin);
                        node.news.notify_one();
                        return Ok(sample);
                    }
                    Err(fault) => last = fault,
                }
            }
            Err(last)
        })
    });
    fetch.await
}

/// Renders a frame that a job is warped from.
async fn rendered(
    node: &Node,
    job: &ViewJob,
    key: &SourceKey,
    info: &Arc<SampleSetInfo>,
) -> Result<(FrameSource, Arc<Sample>), Fault> {
    let FrameSource { camera, width, height, band_rows, .. } = key.source;
    let outputs = Outputs::COLOR.with(Output::Range);
    let plan = key.source.plan();
    let direct =
        ViewJob { camera, width, height, outputs, plan, band_rows, history: None, rays: None, ..job.clone() };
    let Rendered { frame, .. } =
        node.render_thread.render_view(direct, info.clone(), Vec::new(), false).await?;
    let without = || Fault::Unavailable("a rendered frame lacks colour or range".to_owned());
    let source = FrameSource { light: frame.provenance.plan.light(), ..key.source };
    let origin = Origin { bought: false, render_ms: frame.rendering_ms() };
    let sample = node.sources.keep(SourceKey { source, ..*key }, &frame, origin).ok_or_else(without)?;
    Ok((source, sample))
}

/// The plan of a composed frame names its frames by what they are.
pub(super) fn restore_plan(frame: &mut Frame, job: &ViewJob, frames: Vec<FrameSource>) {
    if let Plan::Warp(warp) = &job.plan {
        frame.provenance.plan = Plan::Warp(Warp { frames, ..warp.clone() });
    }
}
