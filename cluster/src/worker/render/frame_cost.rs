//! Measures the cost of views that are warped from recent frames, before the first one is ordered.
//!
//! The compositor's programs for frames are others than those for samples of a set: a frame is one pinhole image without
//! highlights. They are compiled here, so that no view waits for them.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{
    Cancel, Compositor, FrameSource, Output, Outputs, Plan, RenderError, Sample, SampleId, SampleSet,
    SampleSetInfo, Scene, ViewJob, Warp,
};
use tracing::{debug, warn};

use super::{Renderer, ms_since};
use crate::core::quality::Cost;
use crate::worker::sources::set_of_sources;
use crate::worker::view_costs::ViewKind;
use crate::worker::warm::{SIZES, fastest, view};

/// A frame as a sample, and the view that it is warped to: that of its own camera.
struct Warped {
    sample: Arc<Sample>,
    job: ViewJob,
}

impl Renderer {
    /// Measures views that are warped from frames. Answers views from triangles meanwhile.
    pub(super) fn measure_frames(&mut self, info: &Arc<SampleSetInfo>) {
        let Some(scene) = self.scene.clone() else { return };
        let frames = self.typical_frames(&scene, info);
        let frames = frames.inspect_err(|error| warn!(%error, "views from frames cannot be measured"));
        let Ok(frames) = frames else { return };
        let began = Instant::now();
        let set = Arc::new(set_of_sources(info, self.queue.usual_visibility()));
        let cost =
            self.composing(|compositor, between| measured(compositor, &set, frames, between)).flatten();
        debug!(ms = ms_since(began), ?cost, "views from frames measured");
        self.meter.set_cost(ViewKind::FromFrames, cost);
    }

    /// Direct frames of a small and a typical size.
    fn typical_frames(
        &mut self,
        scene: &Scene,
        info: &Arc<SampleSetInfo>,
    ) -> Result<Vec<Warped>, RenderError> {
        let (camera, visibility) = (scene.default_camera(), self.queue.usual_visibility());
        SIZES
            .into_iter()
            .map(|[width, height]| {
                let source =
                    FrameSource { camera, width, height, samples_per_pixel: 1, band_rows: 0, light: None };
                let direct = view(info, camera, [width, height], source.plan(), visibility);
                let job = ViewJob { outputs: Outputs::COLOR.with(Output::Range), ..direct };
                let frames = self.guarded(|own| {
                    Ok(own.sampler()?.render_views(std::slice::from_ref(&job), &Cancel::default()))
                })?;
                let none = || RenderError::Internal("a frame lacks colour or range".to_owned());
                let frame = frames.into_iter().next().ok_or_else(none)??;
                let sample = Arc::new(source.sample(&frame).ok_or_else(none)?);
                let plan =
                    Plan::Warp(Warp { samples: vec![sample.id], frames: vec![source], ..Warp::default() });
                Ok(Warped { sample, job: ViewJob { plan, ..job } })
            })
            .collect()
    }
}

/// Warps each frame several times. The fastest time counts, since other processes use the same cores.
fn measured(
    compositor: &mut dyn Compositor,
    set: &Arc<SampleSetInfo>,
    frames: Vec<Warped>,
    between: &mut dyn FnMut(),
) -> Result<Option<Cost>, RenderError> {
    let mut times: Vec<(u64, f64)> = Vec::new();
    for Warped { sample, job } in frames {
        let ids: [SampleId; 1] = [sample.id];
        compositor.hold(&SampleSet { info: set.clone(), samples: vec![sample] })?;
        between();
        // Views of all sizes have the same programs.
        let ready = if times.is_empty() { compositor.ready(&job, between) } else { Ok(()) };
        let mut compose = |(): &mut ()| {
            let frames = compositor.compose(std::slice::from_ref(&job), &Cancel::default());
            frames.into_iter().try_for_each(|frame| frame.map(drop))
        };
        let time = ready.and_then(|()| fastest(&mut (), &mut compose, &mut |()| between()));
        compositor.release(&ids);
        times.push((u64::from(job.width) * u64::from(job.height), time?));
    }
    Ok(Cost::fit(times.into_iter()))
}
