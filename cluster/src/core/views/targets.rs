//! Views whose request states a target: their plans, and the judgement of their frames.

use argus_scene::{Camera, Plan, Prediction, View};

use super::target_search::TargetSearch;
use super::{Cluster, Output, Views};
use crate::core::event::{Action, ViewId};
use crate::core::quality::choose::{self, Candidate, QualityTarget, Step};
use crate::core::quality::{Model, Observed, Setting, Situation};
use crate::core::workers::WorkKind;

/// A view's plan and prediction.
#[derive(Debug, Clone)]
pub(super) struct Planned {
    pub(super) plan: Plan,
    /// The prediction; `None` without a model, and for plans that it does not know.
    pub(super) expected: Option<Prediction>,
    /// The search for a frame within a bound, if there is a bound and a model.
    pub(super) target_search: Option<Box<TargetSearch>>,
}

impl Views {
    /// The model of a worker's device, or else of another device: errors hardly differ, and costs are corrected by
    /// measured times.
    fn model(&self, cluster: Cluster<'_>) -> Option<&Model> {
        let of_a_worker =
            |model: &&&Model| cluster.workers.iter().any(|worker| worker.hello().device == model.device);
        let models = || self.models.iter().map(AsRef::as_ref);
        models().find(|model| of_a_worker(&model)).or_else(|| models().next())
    }

    /// The plan of an unpinned view by its target, if a model can answer it; else `plain`, the plan by the request
    /// alone.
    pub(super) fn planned(&self, view: &View, plain: Plan, cluster: Cluster<'_>) -> Planned {
        let may_choose = view.pin.is_none() && view.camera.is_pinhole();
        let Some(model) = self.model(cluster).filter(|_| may_choose) else {
            return Planned { plan: plain, expected: None, target_search: None };
        };
        let set = cluster.samples.set();
        let rig = (&set.rig, cluster.samples.sight());
        let situation = Situation::new(&view.camera, view.height, rig, &set.extent);
        let pixels = u64::from(view.width) * u64::from(view.height);
        let chosen = QualityTarget::of(&view.plan).and_then(|target| {
            let candidates = model.candidates(&view.plan, &situation, pixels, &self.pace);
            let step = choose::first(&candidates, &target, |setting| self.wait_ms(setting, cluster))?;
            let Step::Try { setting, expected, judged } = step else { return None };
            let target_search = TargetSearch {
                camera: view.camera,
                request: view.plan,
                target,
                situation,
                pixels,
                tried: vec![setting],
                spent_ms: 0.0,
                judged,
            };
            let target_search = target.max_error.is_some().then(|| Box::new(target_search));
            let plan = plan_of(setting, &view.camera, set.version.number, cluster);
            Some(Planned { plan, expected: Some(expected), target_search })
        });
        chosen.unwrap_or_else(|| {
            let setting = Setting::of(&plain);
            let expected = model.of(setting).map(|calibrated| Prediction {
                error: calibrated.before.believe(&situation.0).upper(),
                ms: calibrated.cost.ms(pixels) * self.pace.factor(setting),
            });
            Planned { plan: plain, expected, target_search: None }
        })
    }

    /// Judges a frame by the statistics of its pixels and its rendering time. It is delivered, or rejected for
    /// another try.
    pub(in crate::core) fn judge(
        &mut self,
        (view_id, attempt): (ViewId, u32),
        observed: Option<Observed>,
        ms: f64,
        cluster: Cluster<'_>,
    ) -> Vec<Output> {
        if !self.is_current(view_id, attempt) {
            return Vec::new();
        }
        let Some(mut target_search) = self.views.get_mut(&view_id).and_then(|view| view.target_search.take())
        else {
            let expected = Prediction { error: 1.0, ms };
            return vec![Output::Act(Action::Deliver { view_id, attempt, expected })];
        };
        self.learn_pace(view_id, ms, cluster);
        target_search.spent_ms += if ms >= 0.0 { ms } else { 0.0 };
        match self.next_step(&target_search, observed, cluster) {
            Step::Deliver { expected } => {
                target_search.judged = false;
                if let Some(view) = self.views.get_mut(&view_id) {
                    view.target_search = Some(target_search);
                    view.expected = Some(expected);
                }
                vec![Output::Act(Action::Deliver { view_id, attempt, expected })]
            }
            Step::Try { setting, expected, judged } => {
                // The worker is not at fault, and holds the plan's samples.
                let taken_back = self.take_back(view_id, true);
                // A view keeps the version in which it was admitted.
                let served = cluster.samples.set().version;
                let version = self.views.get(&view_id).map_or(served, |view| view.version);
                let plan = plan_of(setting, &target_search.camera, version.number, cluster);
                target_search.tried.push(setting);
                target_search.judged = judged;
                self.counts.frames_refused += 1;
                let kind = if setting.is_direct() { WorkKind::Direct } else { WorkKind::Views };
                self.begin_again(view_id, plan, expected, target_search);
                taken_back.into_iter().chain([Output::Demand(kind)]).collect()
            }
        }
    }

    fn next_step(
        &self,
        target_search: &TargetSearch,
        observed: Option<Observed>,
        cluster: Cluster<'_>,
    ) -> Step {
        let nothing_known = Prediction { error: 1.0, ms: target_search.spent_ms };
        let (Some(model), Some(observed), Some(&seen)) =
            (self.model(cluster), observed, target_search.tried.last())
        else {
            // Without statistics the frame is delivered.
            return Step::Deliver { expected: nothing_known };
        };
        let candidates: Vec<Candidate<'_>> = model.candidates(
            &target_search.request,
            &target_search.situation,
            target_search.pixels,
            &self.pace,
        );
        let candidates = model.enlightened(&candidates, &target_search.situation, seen, &observed);
        choose::next(
            &candidates,
            &target_search.target,
            &target_search.tried,
            target_search.spent_ms,
            |setting| self.wait_ms(setting, cluster),
        )
    }

    /// Corrects the cost of a view's plan by a frame's rendering time.
    pub(super) fn learn_pace(&mut self, view_id: ViewId, ms: f64, cluster: Cluster<'_>) {
        let Some(view) = self.views.get(&view_id) else { return };
        let (setting, pixels) = (Setting::of(&view.plan), view.pixels);
        let known = self.model(cluster).and_then(|model| model.of(setting));
        if let Some(expected_ms) = known.map(|calibrated| calibrated.cost.ms(pixels)) {
            self.pace.observe(setting, ms, expected_ms);
        }
    }

    /// Milliseconds until a worker can begin a view of this setting.
    fn wait_ms(&self, setting: Setting, cluster: Cluster<'_>) -> f64 {
        self.expected_wait(setting.is_direct(), cluster).as_secs_f64() * 1e3
    }
}

/// The plan of a setting, with the best samples of a version for the camera.
fn plan_of(setting: Setting, camera: &Camera, version: u64, cluster: Cluster<'_>) -> Plan {
    setting.plan(cluster.samples.sample_ids(camera, setting.samples(), version))
}
