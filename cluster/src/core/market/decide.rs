//! Which offer a view takes: the one with the least E + λ·C, plus a little for each second that its viewer waits.
//!
//! Way and worker are one decision. Each worker with room offers the view from triangles, in full and in less detail, and warped from
//! sources. Sources that another worker holds can be had, for the time of a transfer. What a request demands removes offers; it never
//! changes the price.

use argus_scene::{Detail, SampleId};

use super::errors::{Errors, WarpFeatures};
use super::offer_kind::OfferKind;
use super::pool::Near;
use super::prices::Prices;
use super::source_grid::POINTS;
use crate::core::event::WorkerId;

/// Most sources of a warp.
const MOST_SOURCES: usize = 4;

/// Seconds that a view waits for a source that its worker fetches, and of these the worker's own.
///
/// Tuned: transfer of 250×188 texels between processes of one machine.
const FETCH_SECS: f64 = 0.01;
const FETCH_WORK_SECS: f64 = 0.003;

/// What a second of waiting costs the viewer, FLIP: it takes nobody's time, so that the price of time says nothing of it.
///
/// Tuned: .1 (`crowd/proto.py`, `mu`). At the price of time, views under load would leave near sources for idle workers.
const WAITING: f64 = 0.1;

/// What a view allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allowed {
    /// Less detail.
    pub reduced: bool,
    /// Warps from sources.
    pub warped: bool,
    /// Pixels that no source saw and that are guessed.
    pub guesses: bool,
    /// Greatest predicted excess, mean FLIP.
    pub max_excess: f64,
    /// Seconds until its frame is worthless.
    pub within_secs: f64,
}

/// A view that leaves its way open.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// Pixels, with sub-pixels.
    pub pixels: u64,
    /// What it allows.
    pub allowed: Allowed,
    /// λ: what a second is worth, FLIP.
    pub price: f64,
    /// The sources near it, nearest first.
    pub near: &'a [Near<'a>],
}

/// A worker with room for a view.
#[derive(Debug, Clone, Copy)]
pub struct Hand<'a> {
    /// The worker.
    pub worker: WorkerId,
    /// Views in its queue, and views that it ever got: the order among equal offers.
    pub tie_break: (usize, u64),
    /// Predicted seconds until it can begin.
    pub wait_secs: f64,
    /// Its prices; `None` until it answered a view.
    pub prices: Option<&'a Prices>,
    /// Whether its programs for warps are prepared.
    pub warps: bool,
}

/// An offer of one worker for one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The worker.
    pub worker: WorkerId,
    /// The way.
    pub kind: OfferKind,
    /// The sources of a warp, best first.
    pub sources: Vec<SampleId>,
    /// What its predicted error follows from, if it is warped.
    pub features: WarpFeatures,
    /// Predicted excess: mean FLIP beyond that of the view from triangles.
    pub excess: f64,
    /// Predicted seconds of a worker; 0 if none is known.
    pub secs: f64,
    /// Predicted seconds until the worker can begin.
    pub wait_secs: f64,
    /// E + λ·C, and the price of waiting.
    pub cost: f64,
    /// Order among equal offers.
    pub tie_break: (usize, u64),
}

impl Chosen {
    fn meets(&self, allowed: &Allowed) -> bool {
        self.excess <= allowed.max_excess && self.wait_secs + self.secs <= allowed.within_secs
    }
}

/// A view's offers that matter.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The offer that it takes.
    pub chosen: Chosen,
    /// The best offer from triangles.
    pub from_triangles: Chosen,
    /// The best warp at the chosen worker, taken or not.
    pub warped: Option<Chosen>,
    /// Whether the chosen offer has what the view demands.
    pub meets_demands: bool,
}

/// The decision for a view; `None` without workers.
///
/// If no offer has what the view demands, it takes the earliest of those with the least excess beyond the demand.
pub fn decide(asked: &Asked<'_>, hands: &[Hand<'_>], errors: &Errors) -> Option<Decision> {
    let offers: Vec<Chosen> = hands.iter().flat_map(|hand| offers(asked, hand, errors)).collect();
    let from_triangles = best(offers.iter().filter(|offer| !offer.kind.is_warped()))?;
    let met = best(offers.iter().filter(|offer| offer.meets(&asked.allowed)));
    let meets_demands = met.is_some();
    let soonest = || {
        let within = |offer: &&Chosen| offer.excess <= asked.allowed.max_excess;
        let finish = |offer: &&Chosen| offer.wait_secs + offer.secs;
        offers.iter().filter(within).min_by(|a, b| finish(a).total_cmp(&finish(b)))
    };
    let chosen = met.or_else(soonest).unwrap_or(from_triangles).clone();
    let warps = offers.iter().filter(|offer| offer.kind.is_warped() && offer.worker == chosen.worker);
    let (from_triangles, warped) = (from_triangles.clone(), best(warps).cloned());
    Some(Decision { chosen, from_triangles, warped, meets_demands })
}

/// The offer of least cost; of equal ones the first kind, and the worker with the shorter queue.
fn best<'a>(offers: impl Iterator<Item = &'a Chosen>) -> Option<&'a Chosen> {
    offers.min_by(|a, b| {
        let key = |offer: &Chosen| (offer.kind, offer.tie_break, offer.worker);
        a.cost.total_cmp(&b.cost).then(key(a).cmp(&key(b)))
    })
}

/// The offers of one worker.
fn offers(asked: &Asked<'_>, hand: &Hand<'_>, errors: &Errors) -> Vec<Chosen> {
    let Some(prices) = hand.prices else {
        // One that was never tried is tried in full.
        return vec![offer(asked, hand, OfferKind::Direct(Detail::Full), 0.0, 0.0)];
    };
    let mut offers = Vec::with_capacity(Detail::ALL.len() + 2);
    let details = if asked.allowed.reduced { &Detail::ALL[..] } else { &Detail::ALL[..1] };
    for &detail in details {
        let secs = prices.direct_secs(detail, asked.pixels);
        offers.push(offer(asked, hand, OfferKind::Direct(detail), errors.of_detail(detail), secs));
    }
    if asked.allowed.warped && hand.warps {
        let modes = [(OfferKind::Guessed, asked.allowed.guesses), (OfferKind::Traced, true)];
        let allowed = modes.into_iter().filter(|(_, allowed)| *allowed);
        offers.extend(allowed.filter_map(|(kind, _)| warped(asked, hand, prices, errors, kind)));
    }
    offers
}

fn offer(asked: &Asked<'_>, hand: &Hand<'_>, kind: OfferKind, excess: f64, secs: f64) -> Chosen {
    Chosen {
        worker: hand.worker,
        kind,
        sources: Vec::new(),
        features: WarpFeatures::default(),
        excess,
        secs,
        wait_secs: hand.wait_secs,
        cost: excess + asked.price * secs + WAITING * hand.wait_secs,
        tie_break: hand.tie_break,
    }
}

/// The best warp of a kind: sources are added one by one, each the one that lowers the cost most, while one does.
fn warped(
    asked: &Asked<'_>,
    hand: &Hand<'_>,
    prices: &Prices,
    errors: &Errors,
    kind: OfferKind,
) -> Option<Chosen> {
    let guessed = kind == OfferKind::Guessed;
    let priced = |sources: &[&Near<'_>]| {
        let features = features(sources);
        let missing = sources.iter().filter(|near| !near.held.holders.contains(&hand.worker)).count();
        let mut secs = prices.warp_secs(sources.len(), asked.pixels) + FETCH_WORK_SECS * missing as f64;
        if !guessed {
            secs += prices.tracing_secs(features.holes(), asked.pixels);
        }
        let excess = errors.of_warp(&features, guessed);
        let offer = offer(asked, hand, kind, excess, secs);
        // Sources are fetched beside one another.
        let cost = offer.cost + if missing > 0 { WAITING * FETCH_SECS } else { 0.0 };
        Chosen { features, cost, ..offer }
    };
    let mut sources: Vec<&Near<'_>> = Vec::new();
    let mut best: Option<Chosen> = None;
    while sources.len() < MOST_SOURCES {
        let others =
            asked.near.iter().filter(|near| !sources.iter().any(|other| other.held.id == near.held.id));
        let with = |near: &&Near<'_>| priced(&[&sources[..], &[*near]].concat());
        let next = others.map(|near| (with(&near), near)).min_by(|a, b| a.0.cost.total_cmp(&b.0.cost));
        let Some((offer, near)) = next else { break };
        // A further source must bring something.
        if best.as_ref().is_some_and(|best| !(offer.cost < best.cost)) {
            break;
        }
        sources.push(near);
        best = Some(offer);
    }
    let best = best.filter(|best| best.cost.is_finite() && best.features.uncovered < 1.0)?;
    // The compositor prefers the first of equally good sources: the nearest.
    sources.sort_by(|a, b| a.seen.parallax.total_cmp(&b.seen.parallax));
    Some(Chosen { sources: sources.iter().map(|near| near.held.id).collect(), ..best })
}

/// What a warp's error follows from: the nearest source's sampling and parallax, and what all of them together do not see.
fn features(sources: &[&Near<'_>]) -> WarpFeatures {
    let nearest = sources.iter().min_by(|a, b| a.seen.parallax.total_cmp(&b.seen.parallax));
    let Some(nearest) = nearest else { return WarpFeatures::default() };
    let points = sources.iter().fold(0_u128, |points, near| points | near.seen.points);
    WarpFeatures {
        samples_per_pixel: nearest.held.source.samples_per_pixel,
        parallax: nearest.seen.parallax,
        uncovered: 1.0 - f64::from(points.count_ones()) / POINTS as f64,
        disoccluded: sources.iter().map(|near| near.seen.disoccluded).product(),
    }
}
