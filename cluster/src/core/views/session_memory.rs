//! A session's memory of its last view, so that frames change only for a visible reason.
//!
//! There are two rules. While a session's camera stands still, its frames repeat the last plan, and so its bytes,
//! until another plan has less predicted error; that frame is labelled an upgrade. A frame that was warped from direct
//! frames is replaced by a direct one even if that takes longer. A session changes between
//! triangles and samples at most once in [`CALM`]. Neither rule holds if the last offer is lost: its samples are
//! gone, or its error exceeds the bound. The first rule also yields to time: if repeating the frame would be too
//! late, an earlier offer is chosen, once [`CALM`] has passed.

use std::time::Duration;

use argus_scene::frame::{Decision, Provenance, Reason};
use argus_scene::{FaceMask, Plan, SampleId, SceneState, View};

use super::planner::{Aim, Offer, choose};
use crate::core::event::LastView;

/// Least time between two changes of a session's way. Each change is visible, and two ways of nearly equal time would
/// alternate.
const CALM: Duration = Duration::from_secs(2);

/// Least gain in predicted mean FLIP for which a standing camera's frame changes. Less than a tenth of the default
/// bound is invisible, but the change is visible.
const LEAST_GAIN: f64 = 0.003;

/// What the planner needs to know about a session's last view.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Memory {
    /// Provenance of a frame that repeats the last one; `None` if the camera moved.
    repeated: Option<Provenance>,
    /// Whether the last frame was from samples of the set. A view that is warped from direct frames looks like them.
    needs_samples: bool,
    /// Whether the last frame exceeded its bound to save time.
    time_first: bool,
    /// Whether enough time has passed since the last change of way.
    is_calm: bool,
}

impl Memory {
    /// The memory for a view; `None` if the last view's request was different.
    pub(super) fn of(view: &View, last: LastView) -> Option<Self> {
        let LastView { view: before, provenance, reason, since_change } = last;
        let size = |view: &View| (view.width, view.height);
        let stands = before.camera == view.camera && size(&before) == size(view);
        (before.plan == view.plan).then(|| Self {
            needs_samples: provenance.plan.needs_samples(),
            repeated: stands.then_some(provenance),
            time_first: reason == Reason::TimeFirst,
            is_calm: since_change.is_none_or(|since| since >= CALM),
        })
    }

    /// Whether a frame of this plan, state and kind of device has the bytes of the last one.
    pub(super) fn is_repeated_by(&self, plan: &Plan, state: SceneState, device: &str) -> bool {
        let is_same = |last: &Provenance| last.plan == *plan && last.state == state && last.device == device;
        self.repeated.as_ref().is_some_and(is_same)
    }

    /// The samples of the frame to be repeated, without reflection maps; empty if there are none.
    pub(super) fn samples(&self) -> impl Iterator<Item = SampleId> {
        let ids = match self.repeated.as_ref().map(|last| &last.plan) {
            Some(Plan::Warp(warp)) => &warp.samples[..],
            Some(Plan::Direct { .. }) | None => &[],
        };
        ids.iter().copied().filter(|id| !id.is_reflection_probe())
    }

    /// The faces that the frame which is to be repeated uses of each sample.
    pub(super) fn faces(&self, camera: u64) -> FaceMask {
        match self.repeated.as_ref().map(|last| &last.plan) {
            Some(Plan::Warp(warp)) => warp.faces.of(camera),
            Some(Plan::Direct { .. }) | None => FaceMask::ALL,
        }
    }

    /// Whether an offer keeps the way of the last frame.
    fn keeps_way(&self, offer: &Offer) -> bool {
        self.needs_samples == offer.plan.needs_samples()
    }

    /// Whether an offer's error is acceptable: within the bound, or beyond it like the last frame's.
    fn bears(&self, offer: &Offer, aim: &Aim) -> bool {
        offer.keeps_bound(aim) || aim.time_first || self.time_first
    }
}

/// The best offer for a view, and the reason, given its session's memory; `None` without offers.
pub(super) fn choose_after(
    offers: Vec<Offer>,
    aim: &Aim,
    memory: Option<&Memory>,
) -> Option<(Offer, Decision)> {
    let Some(memory) = memory else { return choose(offers, aim) };
    let best = choose(offers.clone(), aim)?;
    let (repeats, others): (Vec<Offer>, Vec<Offer>) = offers.into_iter().partition(|offer| offer.repeats);
    if let Some(again) = choose(repeats, aim) {
        let best = rendered_anew(&again.0, &others, aim).unwrap_or(best);
        return Some(repeat(again, best, aim, memory));
    }
    if memory.is_calm || memory.keeps_way(&best.0) {
        return Some(best);
    }
    let same_way = others.into_iter().filter(|offer| memory.keeps_way(offer) && memory.bears(offer, aim));
    Some(choose(same_way.collect(), aim).map_or(best, kept))
}

/// The best offer with less error than a repeated frame that was warped from other frames. A camera that stands still
/// gets its own direct frame, which costs time only once.
fn rendered_anew(again: &Offer, others: &[Offer], aim: &Aim) -> Option<(Offer, Decision)> {
    let is_better = |offer: &&Offer| offer.excess + LEAST_GAIN <= again.excess && !offer.is_late(aim);
    let better = others.iter().filter(is_better).cloned().collect();
    choose(better, aim).filter(|_| !again.plan.frames().is_empty())
}

/// Repeats the last frame, unless the best offer is an upgrade, or repeating takes too long.
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

/// Labels an offer that is kept from the last frame. A bound that it exceeds is still labelled.
fn kept((offer, decision): (Offer, Decision)) -> (Offer, Decision) {
    let reason = if decision.reason == Reason::TimeFirst { Reason::TimeFirst } else { Reason::Kept };
    (offer, Decision { reason, ..decision })
}

#[cfg(test)]
mod tests;
