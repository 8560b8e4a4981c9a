//! The demo's crowd: viewers who walk through the scene and ask for views at a steady rate.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use argus_client::load::{Cameras, Ended, LoadOptions, LoadReport, Mode, run_along};
use argus_client::{Client, ClientError};
use argus_scene::{Camera, Frame, PlanRequest};
use indicatif::ProgressBar;

use crate::demo::kind::{is_bought, kind_of, look_of};
use crate::demo::timeline::Timeline;

/// A view without a frame after this time has failed. It is long, so that queues show as latency.
const DEADLINE: Duration = Duration::from_secs(60);
/// Spreads the judged views over viewers and moments: the golden ratio.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The load of a crowd.
#[derive(Clone)]
pub(crate) struct Load {
    pub(crate) viewers: u16,
    /// Width and height of a view in pixels.
    pub(crate) size: [u32; 2],
    /// Views a second of all viewers together.
    pub(crate) per_sec: f64,
    /// Seconds for which views are requested.
    pub(crate) seconds: f64,
    /// How the viewers move.
    pub(crate) cameras: Cameras,
    /// Seconds for which the viewers have walked before.
    pub(crate) walked_secs: f64,
    pub(crate) plan: PlanRequest,
    /// Whether each viewer has a session, or requests of its own.
    pub(crate) mode: Mode,
    /// Most views that are judged.
    pub(crate) judged: usize,
}

/// What became of a crowd's views.
pub(crate) struct Crowd {
    pub(crate) report: LoadReport,
    pub(crate) timeline: Timeline,
    /// Answered views by the reason for their plan.
    pub(crate) reasons: BTreeMap<&'static str, u64>,
    /// The views to judge that were answered, in the order in which they were due.
    pub(crate) judged: Vec<Shown>,
    /// Number of views that were chosen to be judged, answered or not.
    pub(crate) chosen: usize,
    /// Answered views that are warped from bought sources.
    pub(crate) bought: u64,
    /// Share of a viewer's consecutive answered views that change between full size, half, quarter and sources.
    pub(crate) changes: f64,
}

/// A camera and its frame.
pub(crate) struct Shown {
    /// The view's number in the crowd.
    number: u64,
    pub(crate) viewer: u32,
    /// When it was due, seconds after the crowd began.
    pub(crate) due_secs: f64,
    pub(crate) camera: Camera,
    pub(crate) frame: Frame,
}

/// The numbers of at most `count` of `total` views: one of each equal part, at changing places of it, so that all seconds and all
/// viewers are among them.
fn choose(total: u64, count: usize) -> BTreeSet<u64> {
    let count = (count as u64).min(total);
    let part = total as f64 / count.max(1) as f64;
    (0..count).map(|i| ((i as f64 + (i as f64 * GOLDEN).fract()) * part) as u64).collect()
}

/// The share of consecutive views that look different, of each viewer's answered views by their number.
fn share_of_changes(looks: &BTreeMap<u32, BTreeMap<u64, u8>>) -> f64 {
    let mut pairs = (0_u64, 0_u64);
    for looks in looks.values() {
        let looks: Vec<u8> = looks.values().copied().collect();
        pairs.0 += looks.windows(2).filter(|pair| pair[0] != pair[1]).count() as u64;
        pairs.1 += looks.len().saturating_sub(1) as u64;
    }
    pairs.0 as f64 / pairs.1.max(1) as f64
}

/// Runs the load to its last answer. `progress` counts views.
///
/// # Errors
/// The service cannot render views of this size. Views that fail are counted.
pub(crate) async fn run(client: &Client, load: &Load, progress: &ProgressBar) -> anyhow::Result<Crowd> {
    let rate = load.per_sec / f64::from(load.viewers);
    // A load rounds its views up; none may be due after the crowd's time. Half a view less is certain to be rounded up to this.
    let views = (load.seconds * rate).floor().max(1.0);
    let options = LoadOptions {
        clients: load.viewers.into(),
        duration: Duration::try_from_secs_f64((views - 0.5) / rate)?,
        rate,
        size: load.size,
        plan: load.plan,
        mode: load.mode,
        deadline: DEADLINE,
        ..LoadOptions::default()
    };
    let total = options.views_per_client() * u64::from(load.viewers);
    progress.set_position(0);
    progress.set_length(total);
    let chosen = choose(total, load.judged);
    let (mut timeline, mut reasons) = (Timeline::new(load.seconds), BTreeMap::new());
    let (mut judged, mut bought) = (Vec::new(), 0);
    let mut looks = BTreeMap::<u32, BTreeMap<u64, u8>>::new();
    let (walk, walked_secs) = (load.cameras.clone(), load.walked_secs);
    let cameras = Arc::new(move |viewer, secs| walk(viewer, walked_secs + secs));
    let report = run_along(client, &options, cameras, |ended: Ended| {
        progress.inc(1);
        let viewer = ended.client;
        let due_secs = ended.index as f64 / options.rate + f64::from(viewer) / load.per_sec;
        let second = timeline.second(due_secs);
        match ended.outcome {
            Ok(frame) => {
                second.answer(ended.at - ended.due, &frame);
                let reason = frame.decision.map_or("as requested", |decision| decision.reason.phrase());
                *reasons.entry(reason).or_default() += 1;
                looks.entry(viewer).or_default().insert(ended.index, look_of(kind_of(&frame)));
                bought += u64::from(is_bought(&frame));
                let number = ended.index * u64::from(load.viewers) + u64::from(viewer);
                if chosen.contains(&number) {
                    judged.push(Shown { number, viewer, due_secs, camera: ended.view.camera, frame });
                }
            }
            Err(ClientError::Overloaded { .. }) => second.refused += 1,
            Err(_) => second.failed += 1,
        }
    });
    let report = report.await?;
    judged.sort_by_key(|shown| shown.number);
    let (chosen, changes) = (chosen.len(), share_of_changes(&looks));
    Ok(Crowd { report, timeline, reasons, judged, chosen, bought, changes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn judged_views_are_of_all_seconds_and_of_all_viewers() {
        // Twenty seconds of sixteen viewers who ask for eight views a second each.
        let chosen = choose(16 * 160, 128);
        assert_eq!(chosen.len(), 128);
        let seconds: BTreeSet<u64> = chosen.iter().map(|number| number / 128).collect();
        let viewers: BTreeSet<u64> = chosen.iter().map(|number| number % 16).collect();
        assert_eq!((seconds.len(), viewers.len()), (20, 16));
        assert_eq!(choose(5, 128).len(), 5);
        assert!(choose(0, 128).is_empty() && choose(10, 0).is_empty());
    }

    #[test]
    fn changes_are_counted_between_a_viewers_consecutive_answers() {
        let of = |looks: &[u8]| (0..).zip(looks.iter().copied()).collect::<BTreeMap<u64, u8>>();
        let looks = BTreeMap::from([(0, of(&[0, 0, 3, 3, 3])), (1, of(&[2, 3])), (2, of(&[1]))]);
        assert!((share_of_changes(&looks) - 2.0 / 5.0).abs() < 1e-12);
        assert_eq!(share_of_changes(&BTreeMap::new()), 0.0);
    }
}
