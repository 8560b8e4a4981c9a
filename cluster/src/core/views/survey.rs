//! What is found out about a view before it is asked for, by rays that are sent outside of the core.

use argus_scene::rig::{Sight, Survey};
use argus_scene::{Rig, SampleSetInfo, View};

use super::planner::{MOST_SAMPLES, MOST_TEXEL_PIXELS};

/// What is to be found out about a view before it is asked for. The rays are sent outside of the core.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyWanted {
    rig: Rig,
    time_secs: f64,
    /// Cameras of which everything is to be known.
    whole: Vec<u64>,
    /// Cameras of which no more is to be known than it takes to choose some of them.
    few: Vec<u64>,
}

impl SurveyWanted {
    /// How well samples of these cameras would show a view; `None` of no camera.
    pub(super) fn of(set: &SampleSetInfo, whole: Vec<u64>, few: Vec<u64>) -> Option<Self> {
        let (rig, time_secs) = (set.rig, set.time_secs());
        (!(whole.is_empty() && few.is_empty())).then_some(Self { rig, time_secs, whole, few })
    }

    /// Sends the rays.
    pub fn take(&self, view: &View, sight: &dyn Sight) -> Survey {
        self.take_after(None, view, sight)
    }

    /// Whether what another survey finds out holds for this one.
    pub fn is_of_same_scene(&self, other: &Self) -> bool {
        self.rig == other.rig && self.time_secs == other.time_secs
    }

    /// Sends the rays whose answers a survey of the same scene does not tell.
    pub fn take_after(&self, before: Option<&Survey>, view: &View, sight: &dyn Sight) -> Survey {
        let (camera, size) = (&view.camera, [view.width, view.height]);
        let mut survey = match before {
            Some(before) => before.renewed(camera, size, sight, self.time_secs),
            None => Survey::new(camera, size, sight, self.time_secs),
        };
        for &index in &self.whole {
            survey.judge(&self.rig, index, sight, self.time_secs, MOST_TEXEL_PIXELS);
        }
        survey.judge_few(&self.rig, &self.few, MOST_SAMPLES, (sight, self.time_secs), MOST_TEXEL_PIXELS);
        survey
    }
}
