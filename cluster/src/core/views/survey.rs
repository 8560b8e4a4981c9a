//! Surveys of views, taken by rays outside of the core.

use argus_scene::rig::{Survey, VisibilityQuery};
use argus_scene::{FrameSource, Rig, SampleSetInfo, View};

use super::planner::{MOST_SAMPLES, MOST_TEXEL_PIXELS};

/// A survey that the core wants of a view. The shell sends its rays, outside of the core.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyWanted {
    rig: Rig,
    time_secs: f64,
    /// Cameras to be judged completely.
    whole: Vec<u64>,
    /// Cameras to be judged only as far as it takes to choose among them.
    few: Vec<u64>,
    /// Recent direct frames, judged completely, under their numbers.
    frames: Vec<FrameSource>,
}

impl SurveyWanted {
    /// A survey of these cameras and frames; `None` without any.
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

    /// Takes the survey.
    pub fn take(&self, view: &View, sight: &dyn VisibilityQuery) -> Survey {
        self.take_after(None, view, sight)
    }

    /// Whether another survey's rays are valid for this one.
    pub fn is_of_same_scene(&self, other: &Self) -> bool {
        self.rig == other.rig && self.time_secs == other.time_secs
    }

    /// Takes the survey, reusing rays of an earlier one of the same scene.
    pub fn take_after(&self, before: Option<&Survey>, view: &View, sight: &dyn VisibilityQuery) -> Survey {
        let (camera, size) = (&view.camera, [view.width, view.height]);
        let mut survey = match before {
            Some(before) => before.renewed(camera, size, sight, self.time_secs),
            None => Survey::new(camera, size, sight, self.time_secs),
        };
        for &index in &self.whole {
            survey.judge(&self.rig, index, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        for frame in &self.frames {
            let camera = (frame.number(), &frame.sample_camera());
            survey.judge_camera(camera, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        survey.judge_few(&self.rig, &self.few, MOST_SAMPLES, (sight, self.time_secs), MOST_TEXEL_PIXELS);
        survey
    }
}
