//! Coverage estimates of views, made by rays outside of the core.

use argus_scene::rig::{CoverageEstimate, VisibilityQuery};
use argus_scene::{FrameSource, Rig, SampleSetInfo, View};

use super::planner::{MOST_SAMPLES, MOST_TEXEL_PIXELS};

/// An estimate that the core wants of a view. The shell sends its rays, outside of the core.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimateRequest {
    rig: Rig,
    time_secs: f64,
    /// Cameras to be judged completely.
    whole: Vec<u64>,
    /// Cameras to be judged only as far as it takes to choose among them.
    few: Vec<u64>,
    /// Recent direct frames, judged completely, under their numbers.
    frames: Vec<FrameSource>,
}

impl EstimateRequest {
    /// An estimate of these cameras and frames; `None` without any.
    pub(super) fn of(
        set: &SampleSetInfo,
        whole: Vec<u64>,
        few: Vec<u64>,
        frames: Vec<FrameSource>,
    ) -> Option<Self> {
        let (rig, time_secs) = (set.rig, set.time_secs());
        let is_empty = whole.is_empty() && few.is_empty() && frames.is_empty();
        (!is_empty).then_some(Self { rig, time_secs, whole, few, frames })
    }

    /// Makes the estimate.
    pub fn make(&self, view: &View, sight: &dyn VisibilityQuery) -> CoverageEstimate {
        self.make_after(None, view, sight)
    }

    /// Whether another estimate's rays are valid for this one.
    pub fn is_of_same_scene(&self, other: &Self) -> bool {
        self.rig == other.rig && self.time_secs == other.time_secs
    }

    /// Makes the estimate, reusing rays of an earlier one of the same scene.
    pub fn make_after(
        &self,
        before: Option<&CoverageEstimate>,
        view: &View,
        sight: &dyn VisibilityQuery,
    ) -> CoverageEstimate {
        let (camera, size) = (&view.camera, [view.width, view.height]);
        let mut estimate = match before {
            Some(before) => before.renewed(camera, size, sight, self.time_secs),
            None => CoverageEstimate::new(camera, size, sight, self.time_secs),
        };
        for &index in &self.whole {
            estimate.judge(&self.rig, index, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        for frame in &self.frames {
            let camera = (frame.number(), &frame.sample_camera());
            estimate.judge_camera(camera, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        estimate.judge_few(&self.rig, &self.few, MOST_SAMPLES, (sight, self.time_secs), MOST_TEXEL_PIXELS);
        estimate
    }
}
