//! What a session remembers of its last view, so that its frames do not change without a reason that its viewer would see.
//!
//! Two rules. While a session's camera stands still, its frames repeat the plan of the last one, and so its bytes, until
//! another plan is predicted to have less error: an upgrade, which the frame names. And a session changes its way, from
//! triangles or from samples, at most once in [`CALM`]. Both give way where the remembered offer is none any more: the
//! samples were lost, or its error is beyond the bound. The first also gives way to time: where repeating a frame would take
//! too long, under load or for a request's deadline, what is done sooner is chosen, once the way has been calm.

use std::time::Duration;

use argus_scene::frame::{Decision, Provenance, Reason};
use argus_scene::{Plan, SampleId, View};

use super::planner::{Aim, Offer, choose};
use crate::core::event::LastView;

/// A session changes its way at most once in this time: each change shows, and two ways that take nearly the same time would
/// alternate.
const CALM: Duration = Duration::from_secs(2);

/// A standing camera's frame changes only where the predicted mean FLIP falls by this at least: less than a tenth of the
/// default's bound is not seen, but the change is.
const LEAST_GAIN: f64 = 0.003;

/// What the planner goes by of a session's last view.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Memory {
    /// What a frame is made of that repeats the last one; its camera stands still.
    repeated: Option<Provenance>,
    is_direct: bool,
    /// The last frame was beyond its bound for time's sake.
    time_first: bool,
    /// The way may change.
    is_calm: bool,
}

impl Memory {
    /// Of a view and the last one of its session. One that was requested otherwise says nothing of this one.
    pub(super) fn of(view: &View, last: LastView) -> Option<Self> {
        let LastView { view: before, provenance, reason, since_change } = last;
        let size = |view: &View| (view.width, view.height);
        let stands = before.camera == view.camera && size(&before) == size(view);
        (before.plan == view.plan).then(|| Self {
            is_direct: matches!(provenance.plan, Plan::Direct { .. }),
            repeated: stands.then_some(provenance),
            time_first: reason == Reason::TimeFirst,
            is_calm: since_change.is_none_or(|since| since >= CALM),
        })
    }

    /// Whether a frame of that plan and epoch, made on that kind of device, has the bytes of the last one.
    pub(super) fn is_repeated_by(&self, plan: &Plan, epoch: u64, device: &str) -> bool {
        let is_same = |last: &Provenance| last.plan == *plan && last.epoch == epoch && last.device == device;
        self.repeated.as_ref().is_some_and(is_same)
    }

    /// The samples of the frame that is to be repeated, without those of what surrounds the scene; empty where there is none.
    pub(super) fn samples(&self) -> impl Iterator<Item = SampleId> {
        let ids = match self.repeated.as_ref().map(|last| &last.plan) {
            Some(Plan::Warp(warp)) => &warp.samples[..],
            Some(Plan::Direct { .. }) | None => &[],
        };
        ids.iter().copied().filter(|id| !id.is_surroundings())
    }

    /// Whether a frame of that offer comes the way of the last one.
    fn keeps_way(&self, offer: &Offer) -> bool {
        self.is_direct == matches!(offer.plan, Plan::Direct { .. })
    }

    /// Whether that offer's error is borne: where the last frame gave the bound up for time, so may this one.
    fn bears(&self, offer: &Offer, aim: &Aim) -> bool {
        offer.keeps_bound(aim) || aim.time_first || self.time_first
    }
}

/// The best offer for a view, and why it is, where its session may remember its last view; `None` of no offers.
pub(super) fn choose_after(
    offers: Vec<Offer>,
    aim: &Aim,
    memory: Option<&Memory>,
) -> Option<(Offer, Decision)> {
    let Some(memory) = memory else { return choose(offers, aim) };
    let best = choose(offers.clone(), aim)?;
    let (repeats, others): (Vec<Offer>, Vec<Offer>) = offers.into_iter().partition(|offer| offer.repeats);
    if let Some(again) = choose(repeats, aim) {
        return Some(repeat(again, best, aim, memory));
    }
    if memory.is_calm || memory.keeps_way(&best.0) {
        return Some(best);
    }
    let same_way = others.into_iter().filter(|offer| memory.keeps_way(offer) && memory.bears(offer, aim));
    Some(choose(same_way.collect(), aim).map_or(best, kept))
}

/// The last frame again, or the best offer where that is an upgrade, or where repeating it takes too long.
fn repeat(
    again: (Offer, Decision),
    best: (Offer, Decision),
    aim: &Aim,
    memory: &Memory,
) -> (Offer, Decision) {
    if best.0.repeats {
        return best;
    }
    let may_change = memory.is_calm || memory.keeps_way(&best.0) || !memory.bears(&again.0, aim);
    let returns_to_bound = best.0.keeps_bound(aim) && !again.0.keeps_bound(aim);
    let is_better = returns_to_bound || best.0.excess + LEAST_GAIN <= again.0.excess;
    let is_sooner = again.0.is_late(aim) && best.0.finish_ms() < again.0.finish_ms();
    match may_change {
        true if is_better => (best.0, Decision { reason: Reason::Upgrade, ..best.1 }),
        true if is_sooner => best,
        _ => kept(again),
    }
}

/// An offer that is taken since the last frame was like it. That it is beyond the bound is still to be said.
fn kept((offer, decision): (Offer, Decision)) -> (Offer, Decision) {
    let reason = if decision.reason == Reason::TimeFirst { Reason::TimeFirst } else { Reason::Kept };
    (offer, Decision { reason, ..decision })
}

#[cfg(test)]
mod tests;
