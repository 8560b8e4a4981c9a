//! Chooses plan and worker of a view that leaves the way open.
//!
//! Both are one decision, made at dispatch and at each retry. Each worker with room makes *offers*: from triangles
//! (in full or in less detail), from the samples that it holds, and from its recent frames. The offer with the earliest predicted finish wins, among those whose predicted
//! error is within the view's bound. Samples that a worker does not hold are no part of its offers, so no view waits
//! for a sample.

use argus_scene::frame::{Decision, Reason};
use argus_scene::rig::Coverage;
use argus_scene::{Detail, Plan, PlanRequest, Preset};

use crate::core::event::{Fallback, WorkerId};

/// Default bound on a frame's excess: mean FLIP above that of a direct view.
const BALANCED_EXCESS: f64 = 0.03;

/// Bound on a frame's excess with [`Preset::Exact`].
const EXACT_EXCESS: f64 = 0.005;

/// Most samples of a plan: further ones cost more than they show.
pub(super) const MOST_SAMPLES: usize = 4;

/// Least share of the view that the samples of a frame within bound cover.
pub(super) const LEAST_COVERED: f64 = 0.99;

/// Least share of the view that has fine texels, in a frame within bound.
pub(crate) const LEAST_FINE: f64 = 0.95;

/// A texel is fine if its side covers at most this many pixels of the view.
pub(crate) const MOST_TEXEL_PIXELS: f64 = 1.5;

/// Predicted excess of a frame whose samples cover the view with fine texels. It comes from the samples' few
/// sub-samples, and from interpolation. `study load service` measured 0.008 for Sponza at 320×240, 0.009 for
/// `terrain:20000` at 96×72, and 0.014 to 0.018 for `terrain:500000` at 128×96, all with `--walk stand`. Probes
/// correct it for the served scene.
const EXCESS_OF_FINE: f64 = 0.015;

/// Predicted excess of the uncovered share: FLIP of about two unrelated parts of a scene. This is an unmeasured
/// guess, but such frames are outside of every bound anyway.
const EXCESS_OF_UNCOVERED: f64 = 0.4;

/// Predicted excess of the share with coarse texels. For `terrain:500000` seen from near the ground, with coarse
/// texels only, the measured excess is 0.12.
pub(super) const EXCESS_OF_COARSE: f64 = 0.15;

/// Predicted excess of views from triangles of which less is rendered: the largest that `argus-lab study views detail` measured in five scenes
/// (docs/results.md), since a prediction is meant as an upper bound.
pub(crate) const fn excess_of(detail: Detail) -> f64 {
    match detail {
        Detail::Full => 0.0,
        Detail::FewRays => 0.022,
        Detail::Half => 0.042,
        Detail::HalfFewRays => 0.051,
        Detail::Quarter => 0.108,
    }
}

/// Differences of predicted excess below this, mean FLIP, are within what predictions are off by.
const ERROR_STEP: f64 = 0.005;

/// The cluster is overloaded if the best offer within bound waits longer than this, milliseconds. Then an offer
/// beyond the bound that keeps the rate is chosen, and labelled.
const OVERLOADED_MS: f64 = 500.0;

/// What a request demands of the chosen offer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// Bound on the excess: mean FLIP above that of a direct view.
    pub max_excess: f64,
    /// Milliseconds until the frame is worthless; `None`: no deadline.
    pub deadline_ms: Option<f64>,
    /// Whether the earliest finish wins, whatever its error.
    pub time_first: bool,
    /// Milliseconds of rendering that the cluster's load leaves for the view; infinite while all that is asked is carried.
    pub most_ms: f64,
}

impl Aim {
    /// The demands of a request that leaves the way open.
    pub fn of(request: &PlanRequest) -> Self {
        let max_excess = match request.preset {
            Some(Preset::Exact) => EXACT_EXCESS,
            Some(Preset::Balanced | Preset::Interactive) | None => BALANCED_EXCESS,
        };
        let time_first = request.preset == Some(Preset::Interactive);
        Self { max_excess, deadline_ms: request.deadline_ms, time_first, most_ms: f64::INFINITY }
    }
}

/// An offer of one worker for one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// The worker.
    pub worker: WorkerId,
    /// Views in its queue, and views that it ever got: the order among equal offers.
    pub tie_break: (usize, u64),
    /// The plan.
    pub plan: Plan,
    /// Milliseconds until the worker can begin.
    pub wait_ms: f64,
    /// Milliseconds of rendering; `None` if no worker measured such a cost.
    pub render_ms: Option<f64>,
    /// Predicted excess: mean FLIP above that of a direct view.
    pub excess: f64,
    /// Whether the plan's samples cover enough of the view with fine texels; true for a direct view.
    pub meets_coverage: bool,
    /// Whether its frame would repeat the bytes of the session's last frame, whose camera stands still.
    pub repeats: bool,
}

impl Offer {
    /// Milliseconds until its frame is done; infinite if unknown.
    pub(super) fn finish_ms(&self) -> f64 {
        self.render_ms.map_or(f64::INFINITY, |render_ms| self.wait_ms + render_ms)
    }

    /// Whether its predicted error is within the bound.
    pub(super) fn keeps_bound(&self, aim: &Aim) -> bool {
        self.meets_coverage && self.excess <= aim.max_excess
    }

    /// Whether all of the view is rendered. Less is rendered only if there is no time for all.
    fn is_whole(&self) -> bool {
        self.plan.is_whole()
    }

    /// Whether there is time for it, as far as its cost is known.
    fn is_carried(&self, aim: &Aim) -> bool {
        self.render_ms.is_none_or(|ms| ms <= aim.most_ms) && !self.is_late(aim)
    }

    /// Its error in steps that can be told apart. Within a step, the earliest finish wins, so that load spreads.
    fn error_step(&self) -> i64 {
        (self.excess / ERROR_STEP).ceil() as i64
    }

    /// Whether its frame would be too late: after the deadline, or by so much that the cluster is overloaded.
    pub(super) fn is_late(&self, aim: &Aim) -> bool {
        self.wait_ms > OVERLOADED_MS || aim.deadline_ms.is_some_and(|most| self.finish_ms() > most)
    }
}

/// Predicted excess of a frame from samples, and whether their coverage allows it to be within bound. `factor` is the
/// scene's correction from probes. Without a coverage, the frame itself must show its error.
pub fn predicted_excess(coverage: Option<Coverage>, factor: f64) -> (f64, bool) {
    let Some(Coverage { covered, fine }) = coverage else { return (EXCESS_OF_FINE * factor, true) };
    let excess = EXCESS_OF_FINE + EXCESS_OF_UNCOVERED * (1.0 - covered) + EXCESS_OF_COARSE * (covered - fine);
    (excess * factor, covered >= LEAST_COVERED && fine >= LEAST_FINE)
}

/// The best offer, and the reason; `None` without offers.
///
/// That is the earliest finish within the bound, if there is time for it. Else it is the least error of those for which there is
/// time, and if there is time for none, the earliest finish of all.
pub fn choose(offers: Vec<Offer>, aim: &Aim) -> Option<(Offer, Decision)> {
    let whole = |offer: &&Offer| offer.is_whole();
    let within = |offer: &&Offer| offer.keeps_bound(aim);
    let in_bound = earliest(offers.iter().filter(whole).filter(within));
    let chosen = match in_bound {
        _ if aim.time_first => earliest(offers.iter().filter(whole)),
        Some(offer) if offer.is_carried(aim) => Some(offer),
        _ => None,
    };
    let carried = || least_error(offers.iter().filter(|offer| offer.is_carried(aim)));
    let chosen = chosen.or_else(carried).or_else(|| earliest(offers.iter()))?;
    let decision = Decision {
        reason: reason(chosen, &offers, aim),
        wait_ms: chosen.wait_ms,
        render_ms: chosen.render_ms.unwrap_or(0.0),
        excess: chosen.excess,
    };
    Some((chosen.clone(), decision))
}

/// What replaces a frame from samples that turns out worse than predicted: of the views from triangles for which there is time the
/// one with the least error, or else the one that is done first. The frame is replaced if its error exceeds the aim's and that of the view that
/// would replace it.
pub(super) fn fallback(offers: &[Offer], aim: &Aim) -> Option<Fallback> {
    let direct = || offers.iter().filter(|offer| matches!(offer.plan, Plan::Direct { .. }));
    let best = least_error(direct().filter(|offer| offer.is_carried(aim))).or_else(|| earliest(direct()))?;
    Some(Fallback { plan: best.plan.clone(), max_excess: aim.max_excess.max(best.excess) })
}

/// Milliseconds of the cheapest way to render all of a view within its bound; `None` if no such cost is known.
pub(super) fn worth_ms(offers: &[Offer], aim: &Aim) -> Option<f64> {
    let within = offers.iter().filter(|offer| offer.is_whole() && offer.keeps_bound(aim));
    within.filter_map(|offer| offer.render_ms).min_by(f64::total_cmp)
}

/// Milliseconds of the cheapest offer, however large its error; `None` if no cost is known.
pub(super) fn least_ms(offers: &[Offer]) -> Option<f64> {
    offers.iter().filter_map(|offer| offer.render_ms).min_by(f64::total_cmp)
}

/// The offer with the earliest finish; of equal ones, that of the worker with the shorter queue.
fn earliest<'a>(offers: impl Iterator<Item = &'a Offer>) -> Option<&'a Offer> {
    offers.min_by(|a, b| {
        let key = |offer: &Offer| (offer.tie_break, offer.worker);
        a.finish_ms().total_cmp(&b.finish_ms()).then(key(a).cmp(&key(b)))
    })
}

/// The offer with the earliest finish of those with the least error.
fn least_error<'a>(offers: impl Iterator<Item = &'a Offer> + Clone) -> Option<&'a Offer> {
    let least = offers.clone().map(Offer::error_step).min()?;
    earliest(offers.filter(|offer| offer.error_step() == least))
}

/// Why an offer was chosen among these.
fn reason(chosen: &Offer, offers: &[Offer], aim: &Aim) -> Reason {
    if !chosen.keeps_bound(aim) {
        return Reason::TimeFirst;
    }
    if !chosen.is_whole() {
        return Reason::LessDetail;
    }
    let from_samples = || offers.iter().filter(|offer| matches!(offer.plan, Plan::Warp(_)));
    match &chosen.plan {
        Plan::Direct { .. } if from_samples().next().is_none() => Reason::NoSamples,
        Plan::Direct { .. } if !from_samples().any(|offer| offer.keeps_bound(aim)) => {
            Reason::SamplesFallShort
        }
        Plan::Direct { .. } | Plan::Warp(_) => Reason::Soonest,
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{SampleId, Warp};

    use super::*;

    fn direct(worker: u64, wait_ms: f64, render_ms: Option<f64>) -> Offer {
        let plan = Plan::direct(1);
        Offer {
            worker: WorkerId(worker),
            tie_break: (0, 0),
            plan,
            wait_ms,
            render_ms,
            excess: 0.0,
            meets_coverage: true,
            repeats: false,
        }
    }

    fn warp(worker: u64, wait_ms: f64, render_ms: Option<f64>, coverage: Coverage) -> Offer {
        let samples = vec![SampleId { version: 0, camera: 7 }];
        let (excess, meets_coverage) = predicted_excess(Some(coverage), 1.0);
        let plan = Plan::Warp(Warp { samples, ..Warp::default() });
        Offer { plan, excess, meets_coverage, ..direct(worker, wait_ms, render_ms) }
    }

    const FULL: Coverage = Coverage { covered: 1.0, fine: 1.0 };

    fn chosen(offers: Vec<Offer>, request: PlanRequest) -> (u64, bool, Reason) {
        let (offer, decision) = choose(offers, &Aim::of(&request)).unwrap();
        (offer.worker.0, matches!(offer.plan, Plan::Warp(_)), decision.reason)
    }

    fn by_default(offers: Vec<Offer>) -> (u64, bool, Reason) {
        chosen(offers, PlanRequest::default())
    }

    #[test]
    fn the_cheaper_of_triangles_and_samples_is_chosen() {
        let offers =
            |direct_ms, warp_ms| vec![direct(1, 0.0, Some(direct_ms)), warp(1, 0.0, Some(warp_ms), FULL)];
        assert_eq!(by_default(offers(20.0, 10.0)), (1, true, Reason::Soonest));
        assert_eq!(by_default(offers(10.0, 20.0)), (1, false, Reason::Soonest));
    }

    #[test]
    fn a_worker_with_a_long_queue_loses_to_a_slower_one_that_is_idle() {
        let offers = vec![warp(1, 50.0, Some(10.0), FULL), direct(2, 0.0, Some(40.0))];
        assert_eq!(by_default(offers), (2, false, Reason::Soonest));
    }

    #[test]
    fn samples_that_miss_a_part_or_are_too_coarse_lose_however_fast_they_are() {
        for coverage in [Coverage { covered: 0.95, fine: 0.95 }, Coverage { covered: 1.0, fine: 0.9 }] {
            let offers = || vec![direct(1, 0.0, Some(40.0)), warp(1, 0.0, Some(1.0), coverage)];
            assert_eq!(by_default(offers()), (1, false, Reason::SamplesFallShort));
            let interactive = PlanRequest { preset: Some(Preset::Interactive), ..PlanRequest::default() };
            assert_eq!(chosen(offers(), interactive), (1, true, Reason::TimeFirst));
            let soon = PlanRequest { deadline_ms: Some(10.0), ..PlanRequest::default() };
            assert_eq!(chosen(offers(), soon), (1, true, Reason::TimeFirst));
        }
        assert_eq!(by_default(vec![direct(1, 0.0, Some(40.0))]), (1, false, Reason::NoSamples));
    }

    #[test]
    fn under_overload_an_offer_beyond_the_bound_is_chosen_and_labelled() {
        let half = Coverage { covered: 0.5, fine: 0.5 };
        let at = |wait| vec![direct(1, wait, Some(40.0)), warp(1, wait, Some(4.0), half)];
        assert_eq!(by_default(at(100.0)).2, Reason::SamplesFallShort);
        assert_eq!(by_default(at(2.0 * OVERLOADED_MS)), (1, true, Reason::TimeFirst));
    }

    /// An offer from triangles in some detail, which takes this share of the time in full.
    fn reduced(detail: Detail, wait_ms: f64, render_ms: f64) -> Offer {
        let plan = Plan::Direct { samples_per_pixel: 1, detail, light: None };
        Offer { plan, excess: excess_of(detail), ..direct(1, wait_ms, Some(render_ms)) }
    }

    #[test]
    fn less_detail_is_chosen_only_if_load_leaves_no_time_for_all_and_then_as_much_as_it_leaves() {
        let times =
            [(Detail::Full, 100.0), (Detail::FewRays, 50.0), (Detail::Half, 26.0), (Detail::Quarter, 5.0)];
        let chosen = |most_ms: f64| {
            let offers = times.map(|(detail, ms)| reduced(detail, 0.0, ms)).to_vec();
            let aim = Aim { most_ms, ..Aim::of(&PlanRequest::default()) };
            let (offer, decision) = choose(offers, &aim).unwrap();
            let Plan::Direct { detail, .. } = offer.plan else { panic!("from triangles") };
            (detail, decision.reason)
        };
        assert_eq!(chosen(f64::INFINITY), (Detail::Full, Reason::NoSamples));
        assert_eq!(chosen(60.0), (Detail::FewRays, Reason::LessDetail));
        assert_eq!(chosen(40.0), (Detail::Half, Reason::TimeFirst), "beyond the bound");
        assert_eq!(chosen(10.0), (Detail::Quarter, Reason::TimeFirst));
        assert_eq!(chosen(1.0), (Detail::Quarter, Reason::TimeFirst), "there is time for none");
    }

    #[test]
    fn a_frame_that_falls_short_is_replaced_by_what_there_is_time_for() {
        let offers = [
            reduced(Detail::Full, 0.0, 100.0),
            reduced(Detail::Half, 0.0, 25.0),
            reduced(Detail::Quarter, 0.0, 5.0),
        ];
        let of = |most_ms: f64| {
            let fallback = fallback(&offers, &Aim { most_ms, ..Aim::of(&PlanRequest::default()) }).unwrap();
            let Plan::Direct { detail, .. } = fallback.plan else { panic!("from triangles") };
            (detail, fallback.max_excess)
        };
        assert_eq!(of(f64::INFINITY), (Detail::Full, BALANCED_EXCESS));
        assert_eq!(of(30.0), (Detail::Half, excess_of(Detail::Half)));
        assert_eq!(of(1.0), (Detail::Quarter, excess_of(Detail::Quarter)), "there is time for none");
        assert_eq!(fallback(&[], &Aim::of(&PlanRequest::default())), None);
    }

    #[test]
    fn under_load_samples_within_the_bound_precede_less_detail_that_is_worse() {
        let aim = Aim { most_ms: 30.0, ..Aim::of(&PlanRequest::default()) };
        let offers = vec![reduced(Detail::Full, 0.0, 100.0), reduced(Detail::Half, 0.0, 25.0)];
        let with_samples: Vec<Offer> =
            offers.iter().cloned().chain([warp(1, 0.0, Some(16.0), FULL)]).collect();
        assert!(matches!(choose(with_samples, &aim).unwrap().0.plan, Plan::Warp(_)));
        let half = Coverage { covered: 0.5, fine: 0.5 };
        let with_coarse: Vec<Offer> = offers.into_iter().chain([warp(1, 0.0, Some(1.0), half)]).collect();
        assert!(matches!(choose(with_coarse, &aim).unwrap().0.plan, Plan::Direct { .. }));
    }

    #[test]
    fn views_of_one_moment_spread_over_the_workers() {
        let aim = Aim { most_ms: 60.0, ..Aim::of(&PlanRequest::default()) };
        let busy = reduced(Detail::FewRays, 100.0, 50.0);
        let idle = Offer { worker: WorkerId(2), ..reduced(Detail::FewRays, 0.0, 55.0) };
        assert_eq!(choose(vec![busy, idle], &aim).unwrap().0.worker, WorkerId(2));
    }

    #[test]
    fn an_unmeasured_cost_loses_to_any_measured_one() {
        let offers = vec![warp(1, 0.0, None, FULL), direct(2, 0.0, Some(400.0))];
        assert_eq!(by_default(offers).0, 2);
        let mut idle = direct(3, 0.0, None);
        idle.tie_break = (0, 5);
        let mut busy = direct(2, 0.0, None);
        busy.tie_break = (2, 1);
        assert_eq!(by_default(vec![busy, idle]).0, 3, "without costs, the queues decide");
        assert_eq!(choose(Vec::new(), &Aim::of(&PlanRequest::default())), None);
    }

    #[test]
    fn samples_whose_corrected_error_exceeds_the_bound_lose() {
        let offers = |factor: f64| {
            let (excess, meets_coverage) = predicted_excess(Some(FULL), factor);
            vec![
                direct(1, 0.0, Some(40.0)),
                Offer { excess, meets_coverage, ..warp(1, 0.0, Some(1.0), FULL) },
            ]
        };
        assert_eq!(by_default(offers(1.9)), (1, true, Reason::Soonest));
        assert_eq!(by_default(offers(2.1)), (1, false, Reason::SamplesFallShort));
        assert!(predicted_excess(None, 3.0).0 > predicted_excess(None, 1.0).0);
    }

    #[test]
    fn typical_samples_exceed_the_bound_of_exact_frames() {
        let exact = PlanRequest { preset: Some(Preset::Exact), ..PlanRequest::default() };
        let offers = vec![direct(1, 0.0, Some(40.0)), warp(1, 0.0, Some(1.0), FULL)];
        assert_eq!(chosen(offers, exact), (1, false, Reason::SamplesFallShort));
    }
}
