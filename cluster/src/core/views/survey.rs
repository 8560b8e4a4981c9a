//! What is found out about a view before it is asked for, by rays that are sent outside of the core.

use argus_scene::rig::{Sight, Survey};
use argus_scene::{Rig, SampleSetInfo, View};

use super::planner::MOST_TEXEL_PIXELS;

/// What is to be found out about a view before it is asked for. The rays are sent outside of the core.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyWanted {
    rig: Rig,
    time_secs: f64,
    candidates: Vec<u64>,
}

impl SurveyWanted {
    /// How well samples of these cameras would show a view; `None` of no camera.
    pub(super) fn of(set: &SampleSetInfo, candidates: Vec<u64>) -> Option<Self> {
        let (rig, time_secs) = (set.rig, set.time_secs());
        (!candidates.is_empty()).then_some(Self { rig, time_secs, candidates })
    }

    /// Sends the rays.
    pub fn take(&self, view: &View, sight: &dyn Sight) -> Survey {
        let mut survey = Survey::new(&view.camera, [view.width, view.height], sight, self.time_secs);
        for &index in &self.candidates {
            survey.judge(&self.rig, index, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        survey
    }
}
