//! How long a worker takes for each kind of offer, and for a source.
//!
//! Prices begin as ratios to a view from triangles in full, so that a kind that was never tried has a price. Each answer corrects the
//! price of its kind: by a tenth of the difference of logarithms, so that one slow answer changes little. A price has a fixed part and a
//! part a pixel, and an answer corrects each by its share of the predicted time (the normalised least-mean-squares rule).

use argus_scene::Detail;

use super::buy::Purchasable;
use super::offer_kind::OfferKind;
use crate::core::quality::Cost;

/// Time of one warp over that of the view from triangles in full.
///
/// Tuned: .09 with all waits (CROWD.md, "What warping costs and errs").
const WARP: f64 = 0.09;

/// Time of each further source of a warp, in warps.
///
/// Tuned: .03 to .05 (CROWD.md).
const FURTHER: f64 = 0.05;

/// Time of tracing the first uncovered pixels over that of the view in full, reached at [`FEW_HOLES`].
///
/// Tuned: .1 to .2 (CROWD.md).
const TRACE_FIRST: f64 = 0.12;

/// Share of uncovered pixels from which on [`TRACE_FIRST`] is paid in full.
///
/// Tuned: `crowd/sim.py`, `t0`.
const FEW_HOLES: f64 = 0.002;

/// Time of tracing all pixels as holes, over that of the view in full.
///
/// Tuned: about 2 (CROWD.md).
const TRACE_ALL: f64 = 2.0;

/// Least predicted time of traced pixels, in warps, that is learnt from.
const LEAST_TRACED: f64 = 0.2;

/// Weight of an answer in the logarithm of its kind's price.
///
/// Tuned: .1 (CROWD.md, "What must hold").
const RATE: f64 = 0.1;

/// Most ratio of a time to the predicted one that counts, and its inverse: a delayed view is no measurement.
///
/// Tuned: e^.7, as in the prototype (`crowd/proto.py`, `learn`).
const MOST_RATIO: f64 = 2.0;

/// The prices of one worker.
#[derive(Debug, Clone)]
pub struct Prices {
    full: Cost,
    /// By [`slot`]; `None` until an answer of that kind: then it is its ratio of the price in full.
    learnt: [Option<Cost>; SLOTS],
    /// Time of traced pixels over the predicted one.
    tracing: f64,
}

/// Kinds with a price of their own: four reduced details, warps, two kinds of sources.
const SLOTS: usize = 7;
const WARP_SLOT: usize = 4;

/// The slot of a detail other than full.
fn slot(detail: Detail) -> Option<usize> {
    Detail::ALL.iter().position(|other| *other == detail)?.checked_sub(1)
}

/// The first ratio of each slot to the view in full.
///
/// Tuned: few rays .95 (Sponza; .79 to .98), half .43, half with few rays .4, quarter .24 (CROWD.md); sources by
/// [`Purchasable::ratio`].
fn ratio(slot: usize) -> f64 {
    const RATIOS: [f64; 5] = [0.95, 0.43, 0.4, 0.24, WARP];
    RATIOS.get(slot).copied().unwrap_or_else(|| Purchasable::ALL[slot - RATIOS.len()].ratio())
}

impl Prices {
    /// Prices by the cost of views from triangles in full, by the pixels that are rendered.
    pub fn new(full: Cost) -> Self {
        Self { full, learnt: [None; SLOTS], tracing: 1.0 }
    }

    /// Prices by the first answer: a view from triangles in full of this many pixels.
    pub fn of_first(pixels: u64, ms: f64) -> Option<Self> {
        let full = Cost { fixed_ms: 0.0, ms_per_megapixel: ms / (pixels as f64 * 1e-6) };
        (ms > 0.0 && full.ms_per_megapixel.is_finite()).then(|| Self::new(full))
    }

    /// Seconds of a view from triangles in full.
    pub fn full_secs(&self, pixels: u64) -> f64 {
        self.full.ms(pixels) * 1e-3
    }

    /// Seconds of a view from triangles in a detail. `pixels` are those of the view, with sub-pixels.
    pub fn direct_secs(&self, detail: Detail, pixels: u64) -> f64 {
        slot(detail).map_or_else(|| self.full_secs(pixels), |slot| self.secs(slot, pixels))
    }

    /// Seconds of a view that is warped from so many sources.
    pub fn warp_secs(&self, sources: usize, pixels: u64) -> f64 {
        self.secs(WARP_SLOT, pixels) * (1.0 + FURTHER * sources.saturating_sub(1) as f64)
    }

    /// Seconds of tracing the uncovered share of a view's pixels.
    pub fn tracing_secs(&self, uncovered: f64, pixels: u64) -> f64 {
        let first = TRACE_FIRST * (uncovered / FEW_HOLES).min(1.0);
        self.tracing * self.full_secs(pixels) * (first + TRACE_ALL * uncovered)
    }

    /// Seconds of a source that is bought for views of so many pixels.
    pub fn source_secs(&self, kind: Purchasable, pixels: u64) -> f64 {
        self.secs(WARP_SLOT + 1 + kind.index(), pixels)
    }

    fn secs(&self, slot: usize, pixels: u64) -> f64 {
        match self.learnt[slot] {
            Some(cost) => cost.ms(pixels) * 1e-3,
            None => ratio(slot) * self.full_secs(pixels),
        }
    }

    /// Learns from the seconds of an answered view of so many pixels. `uncovered`: share of its pixels that no source saw.
    pub fn learn(&mut self, kind: OfferKind, (sources, uncovered): (usize, f64), pixels: u64, secs: f64) {
        match kind {
            OfferKind::Direct(Detail::Full) => correct(&mut self.full, pixels, secs),
            OfferKind::Direct(detail) => {
                if let Some(slot) = slot(detail) {
                    self.learn_slot(slot, pixels, secs);
                }
            }
            OfferKind::Guessed => {
                let further = self.warp_secs(sources, pixels) / self.warp_secs(1, pixels);
                self.learn_slot(WARP_SLOT, pixels, secs / further);
            }
            OfferKind::Traced => {
                let warp = self.warp_secs(sources, pixels);
                let predicted = self.tracing_secs(uncovered, pixels);
                // What is far below the warp's own time cannot be told from it.
                if predicted > LEAST_TRACED * warp {
                    self.tracing *= step(secs - warp, predicted).unwrap_or(1.0);
                }
            }
        }
    }

    /// Learns from the seconds of a source that was bought for views of so many pixels.
    pub fn learn_source(&mut self, kind: Purchasable, pixels: u64, secs: f64) {
        self.learn_slot(WARP_SLOT + 1 + kind.index(), pixels, secs);
    }

    fn learn_slot(&mut self, slot: usize, pixels: u64, secs: f64) {
        let Cost { fixed_ms, ms_per_megapixel } = self.full;
        let ratio = ratio(slot);
        let first = Cost { fixed_ms: ratio * fixed_ms, ms_per_megapixel: ratio * ms_per_megapixel };
        correct(self.learnt[slot].get_or_insert(first), pixels, secs);
    }
}

/// The factor by which a time corrects a price; `None` for a time that is none.
fn step(secs: f64, predicted: f64) -> Option<f64> {
    let ratio = secs / predicted;
    (ratio > 0.0 && ratio.is_finite()).then(|| (RATE * ratio.clamp(1.0 / MOST_RATIO, MOST_RATIO).ln()).exp())
}

/// Corrects each part of a cost by its share of the time of a view of so many pixels.
fn correct(cost: &mut Cost, pixels: u64, secs: f64) {
    let all = cost.ms(pixels);
    let Some(step) = step(secs * 1e3, all) else { return };
    let shares = [cost.fixed_ms / all, 1.0 - cost.fixed_ms / all];
    let squares = shares[0] * shares[0] + shares[1] * shares[1];
    cost.fixed_ms *= step.powf(shares[0] / squares);
    cost.ms_per_megapixel *= step.powf(shares[1] / squares);
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: u64 = 200 * 150;

    fn prices() -> Prices {
        Prices::new(Cost { fixed_ms: 5.0, ms_per_megapixel: 2500.0 })
    }

    #[test]
    fn a_kind_that_was_never_tried_has_a_price() {
        let prices = prices();
        let full = prices.full_secs(PIXELS);
        assert!((full - 0.08).abs() < 1e-12);
        assert!((prices.direct_secs(Detail::Quarter, PIXELS) / full - 0.24).abs() < 1e-12);
        assert!((prices.warp_secs(1, PIXELS) / full - WARP).abs() < 1e-12);
        assert!(prices.warp_secs(2, PIXELS) > prices.warp_secs(1, PIXELS));
        assert!(prices.source_secs(Purchasable::Four, PIXELS) > 3.0 * full);
        assert_eq!(prices.tracing_secs(0.0, PIXELS), 0.0);
    }

    #[test]
    fn prices_follow_answers_at_every_size() {
        let mut prices = prices();
        for _ in 0..300 {
            for (pixels, ms) in [(PIXELS, 4.0), (16 * PIXELS, 34.0)] {
                prices.learn(OfferKind::Guessed, (1, 0.0), pixels, ms * 1e-3);
            }
        }
        assert!((prices.warp_secs(1, PIXELS) * 1e3 / 4.0 - 1.0).abs() < 0.1);
        assert!((prices.warp_secs(1, 16 * PIXELS) * 1e3 / 34.0 - 1.0).abs() < 0.1);
        assert!((prices.full_secs(PIXELS) - 0.08).abs() < 1e-12, "of another kind");
    }

    #[test]
    fn one_slow_answer_changes_a_price_by_a_few_hundredths_and_nonsense_changes_nothing() {
        let mut prices = prices();
        let full = |prices: &Prices| prices.full_secs(PIXELS);
        prices.learn(OfferKind::Direct(Detail::Full), (0, 0.0), PIXELS, 1e6);
        assert!(full(&prices) < 0.08 * 1.15);
        let before = full(&prices);
        for odd in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            prices.learn(OfferKind::Direct(Detail::Full), (0, 0.0), PIXELS, odd);
        }
        assert_eq!(full(&prices), before);
        assert!(Prices::of_first(0, 5.0).is_none() && Prices::of_first(PIXELS, f64::NAN).is_none());
    }

    #[test]
    fn traced_pixels_are_priced_apart_from_the_warp() {
        let mut prices = prices();
        let (uncovered, warp) = (0.02, prices.warp_secs(2, PIXELS));
        let predicted = prices.tracing_secs(uncovered, PIXELS);
        for _ in 0..200 {
            prices.learn(OfferKind::Traced, (2, uncovered), PIXELS, warp + 0.5 * predicted);
        }
        assert!((prices.tracing_secs(uncovered, PIXELS) / predicted - 0.5).abs() < 0.05);
        assert_eq!(prices.warp_secs(2, PIXELS), warp);
    }
}
