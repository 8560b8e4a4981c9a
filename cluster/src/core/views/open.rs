//! Views that leave the way open: the workers that may answer them, and the plan of the offer that they take.

use argus_scene::frame::{Decision as Reported, Reason};
use argus_scene::{Detail, FaceMasks, FrameSource, Holes, Plan, Search, Warp};

use super::cluster::Cluster;
use super::market::Market;
use super::open_view::OpenView;
use super::pending::Pending;
use crate::core::event::{Fallback, WorkerId};
use crate::core::market::{Allowed, Chosen, Decision, Hand, OfferKind};
use crate::core::time::Uptime;
use crate::core::workers::Worker;

/// Most workers that are asked for offers: those with the shortest queues.
const MOST_ASKED: usize = 64;

/// Views of a worker whose price is not known.
const MOST_UNPRICED: usize = 4;

/// Mean time that a view waits for a slice of background work, seconds: half of a slice.
const HALF_SLICE_SECS: f64 = 0.01;

/// Excess by which a frame from sources may be worse than predicted before it is replaced, mean FLIP: a frame that is thrown away costs
/// its viewer the time of both, and looks unlike those before and after it.
///
/// Tuned: at 0, 4 to 6% of a crowd's views are replaced at 3×, for .5 to 3% of missing pixels, and p99 doubles.
const SLACK: f64 = 0.02;

/// Time of views at a worker that renders a source, over their time alone: views get three quarters of it.
const BESIDE_SLICES: f64 = 4.0 / 3.0;

/// Time that a view waits for a worker that measures, seconds. Most measurements run in slices, but drivers compile a program in one
/// piece.
const MEASURING_SECS: f64 = 0.2;

impl Cluster<'_> {
    /// Workers that may answer a view, with what they know.
    pub(super) fn hands<'a>(&'a self, view: &Pending, market: &'a Market, now: Uptime) -> Vec<Hand<'a>> {
        let hand = |worker: &'a Worker| {
            let entry = worker.queue_entry();
            Hand {
                worker: worker.id(),
                tie_break: (entry.queued, entry.dispatched),
                wait_secs: self.wait_secs(worker, now),
                prices: market.prices_of(worker, self.workers),
                warps: worker.report().frame_cost.is_some(),
            }
        };
        self.asked(view).into_iter().map(hand).collect()
    }

    /// Workers that are asked for offers: healthy, with room, and without a failure at this view.
    fn asked(&self, view: &Pending) -> Vec<&Worker> {
        let has_room = |worker: &&Worker| worker.queued() < self.room_of(worker);
        let front = self.workers.queues().anyone().iter().take(MOST_ASKED + view.tried.len());
        let ids: Vec<WorkerId> = front.map(|entry| entry.worker).collect();
        let asked = ids.iter().filter_map(|id| self.workers.get(*id)).filter(|worker| worker.answers());
        let asked: Vec<&Worker> = asked.filter(has_room).collect();
        let untried: Vec<&Worker> =
            asked.iter().copied().filter(|worker| !view.tried.contains(&worker.id())).collect();
        // A worker that measures leaves views to the others.
        let calm: Vec<&Worker> = untried.iter().copied().filter(|worker| !worker.is_measuring()).collect();
        if !calm.is_empty() {
            return calm;
        }
        if !untried.is_empty() {
            return untried;
        }
        if !asked.is_empty() || !self.workers.queues().anyone().is_empty() {
            return asked;
        }
        // Suspected and failing workers are the last resort.
        self.workers.iter().filter(|w| w.is_ready()).filter(has_room).collect()
    }

    /// Number of views that a worker may have. Until its price is known, all but a few wait here: then there is time for each, or
    /// less detail.
    fn room_of(&self, worker: &Worker) -> usize {
        match worker.report().direct_cost {
            Some(_) => self.config.max_views_per_worker,
            None => MOST_UNPRICED.min(self.config.max_views_per_worker),
        }
    }

    /// Number of workers that answer views.
    pub(super) fn answering(&self) -> f64 {
        self.workers.iter().filter(|worker| worker.answers()).count() as f64
    }

    /// Predicted seconds until a worker can begin another view.
    pub(super) fn wait_secs(&self, worker: &Worker, now: Uptime) -> f64 {
        let samples = f64::from(worker.report().queued_samples) * worker.report().sample_ms.unwrap_or(0.0);
        let renders = self.samples.pool().coming().iter().any(|coming| coming.worker == worker.id());
        let slices = renders || self.samples.is_refining(worker);
        let measuring = if worker.is_measuring() { MEASURING_SECS } else { 0.0 };
        let queued = (worker.queued_ms(now) + samples) * 1e-3;
        measuring + if slices { queued * BESIDE_SLICES + HALF_SLICE_SECS } else { queued }
    }

    /// Mean predicted seconds until workers can begin another view.
    pub(super) fn mean_wait_secs(&self, now: Uptime) -> f64 {
        let waits = self.workers.iter().filter(|worker| worker.answers());
        let sum: f64 = waits.map(|worker| self.wait_secs(worker, now)).sum();
        sum / self.answering().max(1.0)
    }

    /// What a view allows, where time is scarce or not.
    pub(super) fn allowed(&self, view: &Pending, open: &OpenView, market: &Market, now: Uptime) -> Allowed {
        let scarce = market.time.is_scarce(self.answering(), now);
        // A viewer at rest gets the exact view, unless others wait for it.
        let exact = open.rests.is_some() && !(market.time.of_queue() > 0.0);
        let spent_ms = now.since(view.requested).as_secs_f64() * 1e3;
        let within_secs = open.deadline_ms.map_or(f64::INFINITY, |ms| (ms - spent_ms) * 1e-3);
        Allowed {
            reduced: scarce && open.may_guess() && !exact,
            warped: open.may_warp && !exact,
            guesses: open.may_guess(),
            max_excess: open.max_excess(),
            within_secs,
        }
    }

    /// The plan of an offer.
    pub(super) fn plan_of(&self, chosen: &Chosen, direct: &FrameSource) -> Plan {
        match chosen.kind {
            OfferKind::Direct(detail) => {
                Plan::Direct { samples_per_pixel: direct.samples_per_pixel, detail, light: None }
            }
            OfferKind::Guessed | OfferKind::Traced => {
                let held = chosen.sources.iter().filter_map(|id| self.samples.pool().get(*id));
                let search = Search::default();
                Plan::Warp(Warp {
                    search,
                    steps: self.config.steps_of(search),
                    supersampling: direct.samples_per_pixel.isqrt(),
                    samples: Vec::new(),
                    frames: held.map(|held| held.source).collect(),
                    faces: FaceMasks::default(),
                    holes: if chosen.kind == OfferKind::Traced { Holes::Trace } else { Holes::Mark },
                })
            }
        }
    }

    /// What replaces a frame from sources: the best view from triangles. The share of pixels that no source saw, beyond which it does,
    /// is where guessing them is predicted to cost more than that view does.
    pub(super) fn fallback(
        &self,
        decision: &Decision,
        direct: &FrameSource,
        (market, price): (&Market, f64),
    ) -> Option<Fallback> {
        let Decision { chosen, from_triangles, .. } = decision;
        let plan = self.plan_of(from_triangles, direct);
        let spared = from_triangles.excess + price * from_triangles.secs - chosen.excess;
        let holes = market.errors.holes_of(spared.max(0.0) + SLACK);
        let max_uncovered = chosen.features.holes() + holes;
        chosen.kind.is_warped().then_some(Fallback { plan, max_uncovered: max_uncovered.min(1.0) })
    }
}

/// What people are told of a decision.
pub(super) fn reported(decision: &Decision, open: &OpenView, has_sources: bool) -> Reported {
    let Decision { chosen, meets_demands, .. } = decision;
    let reason = match chosen.kind {
        _ if !meets_demands => Reason::TimeFirst,
        OfferKind::Direct(Detail::Full) => match open.rests {
            Some(true) => Reason::Kept,
            Some(false) => Reason::Upgrade,
            None if has_sources => Reason::SamplesFallShort,
            None => Reason::NoSamples,
        },
        OfferKind::Direct(_) => Reason::LessDetail,
        OfferKind::Guessed | OfferKind::Traced => Reason::Soonest,
    };
    Reported { reason, wait_ms: chosen.wait_secs * 1e3, render_ms: chosen.secs * 1e3, excess: chosen.excess }
}
