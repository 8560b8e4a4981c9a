//! Recent surveys: a camera that moves a little sees mostly the same, so its survey reuses rays.

use std::collections::VecDeque;
use std::sync::Arc;

use argus_scene::View;
use argus_scene::rig::{Survey, VisibilityQuery};
use parking_lot::Mutex;

use crate::core::SurveyWanted;

/// Surveys that are kept: a few views of each of some dozen clients. Searching them takes a few microseconds.
const KEPT: usize = 128;

/// The newest surveys, of all clients.
#[derive(Debug, Default)]
pub(super) struct Surveys(Mutex<VecDeque<(SurveyWanted, Arc<Survey>)>>);

impl Surveys {
    /// Takes a survey, reusing rays of the nearest recent one.
    pub(super) fn take(&self, wanted: SurveyWanted, view: &View, sight: &dyn VisibilityQuery) -> Box<Survey> {
        let near = self.nearest(&wanted, view);
        let survey = wanted.take_after(near.as_deref(), view, sight);
        let mut kept = self.0.lock();
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back((wanted, Arc::new(survey.clone())));
        Box::new(survey)
    }

    fn nearest(&self, wanted: &SurveyWanted, view: &View) -> Option<Arc<Survey>> {
        let kept = self.0.lock();
        let alike = kept.iter().filter(|(of, _)| of.is_of_same_scene(wanted));
        let apart = alike.map(|(_, survey)| (survey.apart(&view.camera), survey));
        let nearest = apart.filter(|(apart, _)| apart.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, survey)| survey.clone())
    }
}
