//! Views that are warped from recent direct frames: which frames are kept for them, and what they are composed of.

use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{
    Detail, Frame, FrameSource, Output, Outputs, Plan, Sample, SampleSetInfo, SurfaceLight, ViewJob, Warp,
};

use super::frames::FrameKey;
use super::node::Node;
use super::queue::Rendered;

/// The images that a job needs so that its direct frame can be kept: those that were asked for, and range. `None` if its
/// frame has no colour or would not fit, or its exposure is out of the range of a texel.
pub(super) fn outputs_to_keep(node: &Node, job: &ViewJob, exposure: f32) -> Option<Outputs> {
    let fits = FrameSource::allows(exposure) && node.frames.has_room_for(&source_of(job, 1));
    (job.outputs.has(Output::Color) && fits).then_some(job.outputs.with(Output::Range))
}

/// Keeps a direct frame, which was rendered for a job, to warp other views from it. A frame that shows light cells of an earlier pose is
/// not kept: it cannot be rendered again, so a view warped from it could not be pinned.
pub(super) fn keep(node: &Node, job: &ViewJob, frame: &Frame) {
    let Plan::Direct { samples_per_pixel, detail: Detail::Full, light } = frame.provenance.plan else {
        return;
    };
    if matches!(light, Some(SurfaceLight::OlderCells { .. })) {
        return;
    }
    let source = FrameSource { light, ..source_of(job, samples_per_pixel) };
    let _ = node.frames.keep(FrameKey::of(&source, job), frame);
}

/// The direct frame of a job.
fn source_of(job: &ViewJob, samples_per_pixel: u32) -> FrameSource {
    let (camera, width, height) = (job.camera, job.width, job.height);
    FrameSource { camera, width, height, samples_per_pixel, band_rows: 0, light: None }
}

/// What a view from frames is composed of.
pub(super) struct Gathered {
    /// The job, whose plan names the frames as samples.
    pub(super) job: ViewJob,
    pub(super) info: Arc<SampleSetInfo>,
    pub(super) samples: Vec<Arc<Sample>>,
    /// The frames, each with the light that it has; none where samples are of a set.
    pub(super) frames: Vec<FrameSource>,
}

/// Gathers the frames of a job's plan. `renders`: those that are not held are rendered here.
///
/// # Errors
/// [`Fault::NotFound`] for a frame that is not held, unless `renders`; else the error of rendering it.
pub(super) async fn gather(
    node: &Node,
    job: &ViewJob,
    warp: &Warp,
    info: &Arc<SampleSetInfo>,
    renders: bool,
) -> Result<Gathered, Fault> {
    let (mut samples, mut frames) = (Vec::with_capacity(warp.frames.len()), Vec::new());
    for source in &warp.frames {
        let key = FrameKey::of(source, job);
        let (source, sample) = match node.frames.get(&key) {
            Some(found) => found,
            None if renders => rendered(node, job, &key, info).await?,
            None => {
                return Err(Fault::NotFound("a frame that the view is warped from was dropped".to_owned()));
            }
        };
        samples.push(sample);
        frames.push(source);
    }
    let ids = samples.iter().map(|sample| sample.id).collect();
    let plan = Plan::Warp(Warp { samples: ids, ..warp.clone() });
    let set = node.frames.set_of(info, job.visibility);
    Ok(Gathered { job: ViewJob { plan, ..job.clone() }, info: set, samples, frames })
}

/// Renders a frame that a job is warped from.
async fn rendered(
    node: &Node,
    job: &ViewJob,
    key: &FrameKey,
    info: &Arc<SampleSetInfo>,
) -> Result<(FrameSource, Arc<Sample>), Fault> {
    let FrameSource { camera, width, height, .. } = key.source;
    let outputs = Outputs::COLOR.with(Output::Range);
    let plan = key.source.plan();
    let direct = ViewJob { camera, width, height, outputs, plan, history: None, rays: None, ..job.clone() };
    let Rendered { frame, .. } =
        node.render_thread.render_view(direct, info.clone(), Vec::new(), false).await?;
    let without = || Fault::Unavailable("a rendered frame lacks colour or range".to_owned());
    let source = FrameSource { light: frame.provenance.plan.light(), ..key.source };
    let sample = node.frames.keep(FrameKey { source, ..*key }, &frame).ok_or_else(without)?;
    Ok((source, sample))
}

/// The plan of a composed frame names its frames by what they are.
pub(super) fn restore_plan(frame: &mut Frame, job: &ViewJob, frames: Vec<FrameSource>) {
    if let Plan::Warp(warp) = &job.plan {
        frame.provenance.plan = Plan::Warp(Warp { frames, ..warp.clone() });
    }
}
