//! How a view is answered whose request leaves that open, and by which worker.
//!
//! Both are one decision, taken when the view is given to a worker, and again at each retry. Every worker with room makes
//! *offers*: from triangles, which any worker that holds the scene can do, and from the samples that this worker holds.
//! The offer with the least predicted finish wins, among those whose predicted error is within the view's bound.
//! Nothing here waits for a sample: one that the worker does not hold is no part of an offer.

use argus_scene::frame::{Decision, Reason};
use argus_scene::rig::Coverage;
use argus_scene::{Plan, PlanRequest, Preset};

use crate::core::event::WorkerId;

/// Mean FLIP above that of a direct view that a frame may have by default.
const BALANCED_EXCESS: f64 = 0.03;

/// Mean FLIP above that of a direct view that a frame may have with [`Preset::Exact`].
const EXACT_EXCESS: f64 = 0.005;

/// Samples of a plan at most: further ones cost more than they show.
pub(super) const MOST_SAMPLES: usize = 4;

/// A frame from samples is within bound only where they see this share of what the view shows at least.
pub(super) const LEAST_COVERED: f64 = 0.99;

/// A frame from samples is within bound only where texels are fine for this share of what the view shows at least.
pub(crate) const LEAST_FINE: f64 = 0.95;

/// A texel is fine where it covers at most this many pixels of the view to a side.
pub(crate) const MOST_TEXEL_PIXELS: f64 = 1.5;

/// Predicted mean FLIP above that of a direct view, of a frame from samples that cover the view with fine texels: samples
/// are rendered with several sub-samples, and lose a little in fetching. `study service` found 0.008 for Sponza at 320×240,
/// 0.009 for `terrain:20000` at 96×72, and 0.014 to 0.018 for `terrain:500000` at 128×96, all with `--walk stand`; probes
/// correct it for the scene that is served.
const EXCESS_OF_FINE: f64 = 0.015;

/// What each uncovered part of the view adds to the predicted error: its pixels show something else, whose FLIP is about that
/// of two unrelated parts of a scene. A guess that no measurement backs yet; such frames are outside of every bound anyway.
const EXCESS_OF_UNCOVERED: f64 = 0.4;

/// What each part of the view with coarse texels adds to the predicted error: the excess of a `terrain:500000` that is seen from
/// near the ground, all of whose texels are coarse, is 0.12.
const EXCESS_OF_COARSE: f64 = 0.15;

/// Where the best offer within bound waits longer than this, milliseconds, the cluster has too much to do: an offer beyond the bound
/// that keeps the rate is taken, and labelled.
const OVERLOADED_MS: f64 = 500.0;

/// What a view's request asks of the choice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// Greatest mean FLIP above that of a direct view.
    pub most_excess: f64,
    /// Milliseconds until the frame is worthless to its viewer.
    pub deadline_ms: Option<f64>,
    /// Time goes before error: the least finish, whatever its error.
    pub time_first: bool,
}

impl Aim {
    /// What a request that leaves the way open asks for.
    pub fn of(request: &PlanRequest) -> Self {
        let most_excess = match request.preset {
            Some(Preset::Exact) => EXACT_EXCESS,
            Some(Preset::Balanced | Preset::Interactive) | None => BALANCED_EXCESS,
        };
        let time_first = request.preset == Some(Preset::Interactive);
        Self { most_excess, deadline_ms: request.deadline_ms, time_first }
    }
}

/// What one worker could do about a view.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// Who.
    pub worker: WorkerId,
    /// Views in its queue, and views that it was ever given: whose tie_break it is among equals.
    pub tie_break: (usize, u64),
    /// How.
    pub plan: Plan,
    /// Milliseconds until it can begin.
    pub wait_ms: f64,
    /// Milliseconds of rendering; `None` where no worker has measured any.
    pub render_ms: Option<f64>,
    /// Predicted mean FLIP above that of a direct view.
    pub excess: f64,
    /// Whether the samples of the plan pass the tests of coverage and fineness; a direct view does.
    pub is_sound: bool,
    /// Whether its frame would have the bytes of the session's last one, whose camera stands still.
    pub repeats: bool,
}

impl Offer {
    /// Milliseconds until its frame would be done; what is unknown comes after all that is known.
    pub(super) fn finish_ms(&self) -> f64 {
        self.render_ms.map_or(f64::INFINITY, |render_ms| self.wait_ms + render_ms)
    }

    /// Whether its predicted error is within the bound.
    pub(super) fn keeps_bound(&self, aim: &Aim) -> bool {
        self.is_sound && self.excess <= aim.most_excess
    }

    /// Whether its frame comes too late: for the request, or for a cluster that has too much to do.
    pub(super) fn is_late(&self, aim: &Aim) -> bool {
        self.wait_ms > OVERLOADED_MS || aim.deadline_ms.is_some_and(|most| self.finish_ms() > most)
    }
}

/// Predicted mean FLIP above that of a direct view of a frame from samples that cover the view so, by the factor that probes of
/// the scene have found, and whether they pass the tests by which a frame is within bound. Where nothing is known of the view,
/// a frame shows how good it is.
pub fn predicted_excess(coverage: Option<Coverage>, factor: f64) -> (f64, bool) {
    let Some(Coverage { covered, fine }) = coverage else { return (EXCESS_OF_FINE * factor, true) };
    let excess = EXCESS_OF_FINE + EXCESS_OF_UNCOVERED * (1.0 - covered) + EXCESS_OF_COARSE * (covered - fine);
    (excess * factor, covered >= LEAST_COVERED && fine >= LEAST_FINE)
}

/// The best offer, and why it is; `None` of none.
pub fn choose(offers: Vec<Offer>, aim: &Aim) -> Option<(Offer, Decision)> {
    let within = |offer: &&Offer| offer.keeps_bound(aim);
    let best_of = |offers: &mut dyn Iterator<Item = &Offer>| -> Option<Offer> {
        offers
            .min_by(|a, b| {
                let key = |offer: &Offer| (offer.tie_break, offer.worker);
                a.finish_ms().total_cmp(&b.finish_ms()).then(key(a).cmp(&key(b)))
            })
            .cloned()
    };
    let in_bound = best_of(&mut offers.iter().filter(within));
    let any = best_of(&mut offers.iter());
    let (chosen, beyond) = match in_bound {
        Some(offer) if !(aim.time_first || offer.is_late(aim)) => (offer, false),
        in_bound => {
            let any = any?;
            // Beyond the bound only for what is gained by it.
            match in_bound.filter(|offer| offer.finish_ms() <= any.finish_ms()) {
                Some(offer) => (offer, false),
                None => (any, true),
            }
        }
    };
    let from_samples = offers.iter().filter(|offer| matches!(offer.plan, Plan::Warp(_)));
    let reason = match (&chosen.plan, beyond) {
        (_, true) => Reason::TimeFirst,
        (Plan::Warp(_), false) => Reason::Soonest,
        (Plan::Direct { .. }, false) => {
            let (held, sound) =
                from_samples.fold((false, false), |(_, sound), o| (true, sound || within(&o)));
            match (held, sound) {
                (false, _) => Reason::NoSamples,
                (true, false) => Reason::SamplesFallShort,
                (true, true) => Reason::Soonest,
            }
        }
    };
    let decision = Decision {
        reason,
        wait_ms: chosen.wait_ms,
        render_ms: chosen.render_ms.unwrap_or(0.0),
        excess: chosen.excess,
    };
    Some((chosen, decision))
}

#[cfg(test)]
mod tests {
    use argus_scene::{SampleId, Warp};

    use super::*;

    fn direct(worker: u64, wait_ms: f64, render_ms: Option<f64>) -> Offer {
        let plan = Plan::Direct { samples_per_pixel: 1 };
        Offer {
            worker: WorkerId(worker),
            tie_break: (0, 0),
            plan,
            wait_ms,
            render_ms,
            excess: 0.0,
            is_sound: true,
            repeats: false,
        }
    }

    fn warp(worker: u64, wait_ms: f64, render_ms: Option<f64>, coverage: Coverage) -> Offer {
        let samples = vec![SampleId { version: 0, camera: 7 }];
        let (excess, is_sound) = predicted_excess(Some(coverage), 1.0);
        let plan = Plan::Warp(Warp { samples, ..Warp::default() });
        Offer { plan, excess, is_sound, ..direct(worker, wait_ms, render_ms) }
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
    fn swapping_two_measured_costs_swaps_the_way() {
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
    fn samples_that_miss_a_part_or_are_too_coarse_are_no_way_however_fast() {
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
    fn where_views_would_queue_for_long_the_bound_gives_way_and_the_frame_says_so() {
        let half = Coverage { covered: 0.5, fine: 0.5 };
        let at = |wait| vec![direct(1, wait, Some(40.0)), warp(1, wait, Some(4.0), half)];
        assert_eq!(by_default(at(100.0)).2, Reason::SamplesFallShort);
        assert_eq!(by_default(at(2.0 * OVERLOADED_MS)), (1, true, Reason::TimeFirst));
    }

    #[test]
    fn a_cost_that_nobody_measured_is_never_taken_for_none() {
        let offers = vec![warp(1, 0.0, None, FULL), direct(2, 0.0, Some(400.0))];
        assert_eq!(by_default(offers).0, 2);
        let mut idle = direct(3, 0.0, None);
        idle.tie_break = (0, 5);
        let mut busy = direct(2, 0.0, None);
        busy.tie_break = (2, 1);
        assert_eq!(by_default(vec![busy, idle]).0, 3, "by their queues, where nothing is known");
        assert_eq!(choose(Vec::new(), &Aim::of(&PlanRequest::default())), None);
    }

    #[test]
    fn samples_whose_frames_were_found_worse_than_the_bound_are_no_way() {
        let offers = |factor: f64| {
            let (excess, is_sound) = predicted_excess(Some(FULL), factor);
            vec![direct(1, 0.0, Some(40.0)), Offer { excess, is_sound, ..warp(1, 0.0, Some(1.0), FULL) }]
        };
        assert_eq!(by_default(offers(1.9)), (1, true, Reason::Soonest));
        assert_eq!(by_default(offers(2.1)), (1, false, Reason::SamplesFallShort));
        assert!(predicted_excess(None, 3.0).0 > predicted_excess(None, 1.0).0);
    }

    #[test]
    fn exact_frames_come_from_samples_only_within_a_bound_that_these_do_not_keep() {
        let exact = PlanRequest { preset: Some(Preset::Exact), ..PlanRequest::default() };
        let offers = vec![direct(1, 0.0, Some(40.0)), warp(1, 0.0, Some(1.0), FULL)];
        assert_eq!(chosen(offers, exact), (1, false, Reason::SamplesFallShort));
    }
}
