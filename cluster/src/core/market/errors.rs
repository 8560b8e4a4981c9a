//! Which error each kind of offer has in this scene, learnt from probes of real frames.
//!
//! Errors are mean FLIP beyond that of the same view from triangles at one sample a pixel, both against 16 samples. Details have one
//! number each. Warps have a line: a part that every warp has by how often a pixel of its source was sampled, a part by parallax, a
//! part for uncovered and a part for disoccluded pixels that are guessed. Each probe corrects the parts by their share in its
//! prediction (the normalised least-mean-squares rule).

use std::collections::VecDeque;

use argus_scene::Detail;

use super::offer_kind::OfferKind;

/// Weight of a probe.
///
/// Tuned: probes of a few hundred pixels scatter by about .005, so that about eight are averaged.
const RATE: f64 = 0.25;

/// Most factor between a number and its start, and its inverse: a scene may have places unlike those that were probed.
///
/// Tuned: the fitted numbers of three scenes differ by up to 3 (`crowd/params.py`).
const MOST_FACTOR: f64 = 8.0;

/// Most probed errors that are kept, of each group.
const MOST_KEPT: usize = 200;

/// Share of frames whose error stays below a promised bound.
pub const CONFIDENCE: f64 = 0.95;

/// Excess of views from triangles in less detail, at first, in the order of [`Detail::ALL`].
///
/// Tuned: the largest of `argus-lab study views detail` in five scenes (docs/results.md).
const DETAILS: [f64; 5] = [0.0, 0.022, 0.042, 0.051, 0.108];

/// The line of warps, at first: from sources of one sample a pixel, from those of four or more, by parallax, by uncovered, by
/// disoccluded share.
///
/// Tuned: .005, −.007, .035, 1, .2 (CROWD.md, rule 2, and `crowd/params.py`).
const WARP: [f64; 5] = [0.005, -0.007, 0.035, 1.0, 0.2];

/// What the error of a warp follows from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WarpFeatures {
    /// Samples a pixel of the nearest source.
    pub samples_per_pixel: u32,
    /// Parallax of the nearest source.
    pub parallax: f64,
    /// Share of the view that no source sees, as it is beyond the borders of all.
    pub uncovered: f64,
    /// Share of the rest that is disoccluded in all sources.
    pub disoccluded: f64,
}

impl WarpFeatures {
    /// Share of the view that is guessed or traced.
    pub fn holes(&self) -> f64 {
        self.uncovered + (1.0 - self.uncovered) * self.disoccluded
    }

    fn terms(&self, guessed: bool) -> [f64; 5] {
        let (one, four) = if self.samples_per_pixel < 4 { (1.0, 0.0) } else { (0.0, 1.0) };
        let holes = if guessed { [self.uncovered, self.disoccluded] } else { [0.0; 2] };
        [one, four, self.parallax, holes[0], holes[1]]
    }
}

/// The errors of one scene.
#[derive(Debug, Clone)]
pub struct Errors {
    details: [f64; 5],
    warp: [f64; 5],
    /// Excess beyond the predicted one, by probe: of views from triangles in full, of details, of warps.
    residuals: [VecDeque<f64>; 2],
    probes: u64,
}

impl Default for Errors {
    fn default() -> Self {
        Self { details: DETAILS, warp: WARP, residuals: Default::default(), probes: 0 }
    }
}

impl Errors {
    /// Predicted excess of a view from triangles in a detail.
    pub fn of_detail(&self, detail: Detail) -> f64 {
        Detail::ALL.iter().position(|other| *other == detail).map_or(0.0, |i| self.details[i])
    }

    /// Predicted excess of a warp. Gains of antialiasing count as 0.
    pub fn of_warp(&self, features: &WarpFeatures, guessed: bool) -> f64 {
        let [one, four, rest @ ..] = self.parts(features, guessed);
        (one + four).max(0.0) + rest.iter().sum::<f64>()
    }

    /// Predicted excess of a warp from a source at the viewer's eye, with its sign.
    pub fn of_source(&self, samples_per_pixel: u32) -> f64 {
        if samples_per_pixel < 4 { self.warp[0] } else { self.warp[1] }
    }

    /// Share of uncovered pixels whose guesses are off by this excess.
    pub fn holes_of(&self, excess: f64) -> f64 {
        excess / self.warp[3]
    }

    /// Number of probes so far.
    pub fn probes(&self) -> u64 {
        self.probes
    }

    /// Bound on the excess of an offer that is kept with [`CONFIDENCE`], from its predicted excess and the conformal quantile of what
    /// probes of such offers were off by. `None` until there are enough probes to promise anything.
    pub fn bound(&self, kind: OfferKind, predicted: f64) -> Option<f64> {
        let residuals = match kind {
            OfferKind::Direct(Detail::Full) => return Some(predicted),
            OfferKind::Direct(_) => &self.residuals[0],
            OfferKind::Guessed | OfferKind::Traced => &self.residuals[1],
        };
        let rank = (CONFIDENCE * (residuals.len() + 1) as f64).ceil() as usize;
        let mut sorted: Vec<f64> = residuals.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(rank.checked_sub(1)?).map(|residual| predicted + residual.max(0.0))
    }

    /// Learns the measured excess of a view in less detail.
    pub fn learn_detail(&mut self, detail: Detail, excess: f64) {
        let Some(i) = Detail::ALL.iter().position(|other| *other == detail) else { return };
        if i == 0 || !excess.is_finite() {
            return;
        }
        self.note(0, excess - self.details[i]);
        let learnt = self.details[i] + RATE * (excess - self.details[i]);
        self.details[i] = learnt.clamp(DETAILS[i] / MOST_FACTOR, DETAILS[i] * MOST_FACTOR);
    }

    /// Learns the measured excess of a warp.
    pub fn learn_warp(&mut self, features: &WarpFeatures, guessed: bool, excess: f64) {
        let parts = self.parts(features, guessed);
        let predicted: f64 = parts.iter().sum();
        if !(excess.is_finite() && predicted.is_finite()) {
            return;
        }
        self.note(1, excess - self.of_warp(features, guessed));
        let terms = features.terms(guessed);
        // In units of each number's start, in which all are alike.
        let scaled: Vec<f64> = terms.iter().zip(WARP).map(|(term, start)| term * start.abs()).collect();
        let squares: f64 = scaled.iter().map(|term| term * term).sum();
        if !(squares > 0.0) {
            return;
        }
        let off = (excess - predicted).clamp(-0.1, 0.1);
        for (i, start) in WARP.into_iter().enumerate() {
            let learnt = self.warp[i] + RATE * off * scaled[i] / squares * start.abs();
            self.warp[i] = match i {
                // What a source has or lacks by its sampling has either sign.
                0 | 1 => learnt.clamp(-0.05, 0.05),
                _ => learnt.clamp(start / MOST_FACTOR, start * MOST_FACTOR),
            };
        }
    }

    fn note(&mut self, group: usize, residual: f64) {
        self.probes += 1;
        let residuals = &mut self.residuals[group];
        if residuals.len() == MOST_KEPT {
            residuals.pop_front();
        }
        residuals.push_back(residual);
    }

    fn parts(&self, features: &WarpFeatures, guessed: bool) -> [f64; 5] {
        let terms = features.terms(guessed);
        std::array::from_fn(|i| self.warp[i] * terms[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn features(parallax: f64, uncovered: f64, disoccluded: f64) -> WarpFeatures {
        WarpFeatures { samples_per_pixel: 1, parallax, uncovered, disoccluded }
    }

    #[test]
    fn errors_rise_with_parallax_and_with_what_is_guessed() {
        let errors = Errors::default();
        let near = errors.of_warp(&features(0.0, 0.0, 0.0), true);
        assert!((near - 0.005).abs() < 1e-12);
        assert!(errors.of_warp(&features(0.2, 0.0, 0.0), true) > near);
        let holes = features(0.0, 0.1, 0.05);
        assert!(errors.of_warp(&holes, true) > errors.of_warp(&holes, false));
        let four = WarpFeatures { samples_per_pixel: 4, ..features(0.0, 0.0, 0.0) };
        assert_eq!(errors.of_warp(&four, true), 0.0, "gains count as none");
        assert!(errors.of_source(4) < 0.0);
    }

    #[test]
    fn probes_correct_the_numbers_of_their_kind() {
        let mut errors = Errors::default();
        // A scene where parallax costs three times as much, and a quarter of the size half as much.
        for i in 0..2000 {
            let features = features(f64::from(i % 7) * 0.05, f64::from(i % 3) * 0.02, 0.0);
            let truth = 0.008 + 0.1 * features.parallax + 0.6 * features.uncovered;
            errors.learn_warp(&features, true, truth);
            errors.learn_detail(Detail::Quarter, 0.05);
        }
        let at = |parallax, uncovered| errors.of_warp(&features(parallax, uncovered, 0.0), true);
        assert!((at(0.0, 0.0) - 0.008).abs() < 0.003, "{}", at(0.0, 0.0));
        assert!((at(0.3, 0.0) - 0.038).abs() < 0.006, "{}", at(0.3, 0.0));
        assert!((at(0.0, 0.04) - 0.032).abs() < 0.008, "{}", at(0.0, 0.04));
        assert!((errors.of_detail(Detail::Quarter) - 0.05).abs() < 0.002);
        assert_eq!(errors.of_detail(Detail::Half), DETAILS[2]);
        assert_eq!(errors.of_detail(Detail::Full), 0.0);
    }

    #[test]
    fn a_bound_is_promised_once_enough_was_probed_and_holds_for_what_was_probed() {
        let mut errors = Errors::default();
        let kind = OfferKind::Guessed;
        assert_eq!(errors.bound(kind, 0.01), None);
        assert_eq!(errors.bound(OfferKind::Direct(Detail::Full), 0.0), Some(0.0));
        let excess = |i: u32| 0.02 * (f64::from(i) * 0.618_033_988_75).fract();
        (0..200).for_each(|i| errors.learn_warp(&features(0.05, 0.0, 0.0), true, excess(i)));
        let predicted = errors.of_warp(&features(0.05, 0.0, 0.0), true);
        let bound = errors.bound(kind, predicted).unwrap();
        let kept = (200..1200).filter(|i| excess(*i) <= bound).count();
        assert!((900..=1000).contains(&kept) && bound < 0.04, "{kept} kept by {bound}");
    }

    #[test]
    fn accidents_and_nonsense_move_no_number_far() {
        let mut errors = Errors::default();
        for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            errors.learn_warp(&features(0.1, 0.0, 0.0), true, odd);
            errors.learn_detail(Detail::Half, odd);
        }
        assert_eq!((errors.probes(), errors.warp, errors.details), (0, WARP, DETAILS));
        (0..10_000).for_each(|_| errors.learn_warp(&features(0.1, 0.1, 0.1), true, 1.0));
        assert!(errors.of_warp(&features(0.1, 0.0, 0.0), false) < 0.1 * 8.0 * 0.035 + 0.051);
    }
}
