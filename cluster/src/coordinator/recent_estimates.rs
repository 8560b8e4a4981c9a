//! Recent estimates: a camera that moves a little sees mostly the same, so its estimate reuses rays.

use std::collections::VecDeque;
use std::sync::Arc;

use argus_scene::View;
use argus_scene::rig::{CoverageEstimate, VisibilityQuery};
use parking_lot::Mutex;

use crate::core::EstimateRequest;

/// Estimates that are kept: a few views of each of some dozen clients. Searching them takes a few microseconds.
const KEPT: usize = 128;

/// The newest estimates, of all clients.
#[derive(Debug, Default)]
pub(super) struct RecentEstimates(Mutex<VecDeque<(EstimateRequest, Arc<CoverageEstimate>)>>);

impl RecentEstimates {
    /// Makes an estimate, reusing rays of the nearest recent one.
    pub(super) fn make(
        &self,
        wanted: EstimateRequest,
        view: &View,
        sight: &dyn VisibilityQuery,
    ) -> Box<CoverageEstimate> {
        let near = self.nearest(&wanted, view);
        let estimate = wanted.make_after(near.as_deref(), view, sight);
        let mut kept = self.0.lock();
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back((wanted, Arc::new(estimate.clone())));
        Box::new(estimate)
    }

    fn nearest(&self, wanted: &EstimateRequest, view: &View) -> Option<Arc<CoverageEstimate>> {
        let kept = self.0.lock();
        let alike = kept.iter().filter(|(of, _)| of.is_of_same_scene(wanted));
        let apart = alike.map(|(_, estimate)| (estimate.apart(&view.camera), estimate));
        let nearest = apart.filter(|(apart, _)| apart.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, estimate)| estimate.clone())
    }
}
