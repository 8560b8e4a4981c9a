//! The demo's crowd: viewers who walk around their viewpoints and ask for views at a steady rate.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use argus_client::load::{CameraPath, Ended, LoadOptions, LoadReport, run_along};
use argus_client::{Client, ClientError};
use argus_scene::{Camera, Frame, PlanRequest};
use indicatif::ProgressBar;

use crate::demo::timeline::Timeline;

/// A view without a frame after this time has failed. It is long, so that queues show as latency.
const DEADLINE: Duration = Duration::from_secs(60);

/// The load of a crowd.
#[derive(Clone, Copy)]
pub(crate) struct Load {
    pub(crate) viewers: u16,
    /// Width and height of a view in pixels.
    pub(crate) size: [u32; 2],
    /// Views a second of all viewers together.
    pub(crate) per_sec: f64,
    /// Seconds for which views are requested.
    pub(crate) seconds: f64,
    pub(crate) plan: PlanRequest,
}

/// What became of a crowd's views.
pub(crate) struct Crowd {
    pub(crate) report: LoadReport,
    pub(crate) timeline: Timeline,
    /// Answered views by the reason for their plan.
    pub(crate) reasons: BTreeMap<&'static str, u64>,
    /// The last answered view of each viewer, by the viewer's number.
    pub(crate) last: BTreeMap<u32, Shown>,
}

/// A camera and its frame.
pub(crate) struct Shown {
    index: u64,
    pub(crate) camera: Camera,
    pub(crate) frame: Frame,
}

/// Runs the load to its last answer. `progress` counts views.
///
/// # Errors
/// The service cannot render views of this size. Views that fail are counted.
pub(crate) async fn run(client: &Client, load: Load, progress: &ProgressBar) -> anyhow::Result<Crowd> {
    let options = LoadOptions {
        clients: load.viewers.into(),
        duration: Duration::try_from_secs_f64(load.seconds)?,
        rate: load.per_sec / f64::from(load.viewers),
        size: load.size,
        plan: load.plan,
        deadline: DEADLINE,
        ..LoadOptions::default()
    };
    progress.set_position(0);
    progress.set_length(options.views_per_client() * u64::from(load.viewers));
    let (mut timeline, mut reasons, mut last) =
        (Timeline::new(load.seconds), BTreeMap::new(), BTreeMap::<u32, Shown>::new());
    let description = client.description().clone();
    let cameras = Arc::new(move |viewer, secs| CameraPath::new(&description, viewer).camera(secs));
    let report = run_along(client, &options, cameras, |ended: Ended| {
        progress.inc(1);
        let due_secs = ended.index as f64 / options.rate + f64::from(ended.client) / load.per_sec;
        let second = timeline.second(due_secs);
        match ended.outcome {
            Ok(frame) => {
                second.answer(ended.at - ended.due, &frame);
                let reason = frame.decision.map_or("as requested", |decision| decision.reason.phrase());
                *reasons.entry(reason).or_default() += 1;
                if last.get(&ended.client).is_none_or(|before| before.index < ended.index) {
                    let shown = Shown { index: ended.index, camera: ended.view.camera, frame };
                    last.insert(ended.client, shown);
                }
            }
            Err(ClientError::Overloaded { .. }) => second.refused += 1,
            Err(_) => second.failed += 1,
        }
    });
    Ok(Crowd { report: report.await?, timeline, reasons, last })
}
