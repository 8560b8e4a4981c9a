//! Correction of the predicted errors of frames from samples: one factor per scene, learnt from probes.
//!
//! The planner predicts errors by constants that fit no scene exactly. Workers trace some pixels of some frames, and
//! report the measured errors. The factor converges to where a set share of measured errors lies below the
//! predictions: an error above one raises it by much, an error below one lowers it by little.

/// Share of probed frames whose error may exceed the prediction. A prediction is meant as an upper bound for 95% of
/// frames, and the error of a few hundred pixels scatters more than a frame's.
const MOST_EXCEEDED: f64 = 0.1;

/// Difference between the steps up and down of the factor's logarithm.
const STEP: f64 = 0.2;

/// Least factor: a scene may have places worse than those that were probed.
const LEAST: f64 = 0.5;

/// Greatest factor: with it no frame from samples is within any bound.
const MOST: f64 = 8.0;

/// Half-life of the learnt correction, seconds. If predictions leave no frame from samples within bound, nothing is
/// probed any more, while samples may have improved.
const HALF_LIFE_SECS: f64 = 600.0;

/// The factor of the served scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct CalibratedError {
    log_factor: f64,
}

impl CalibratedError {
    /// The factor on predicted errors.
    pub(super) fn factor(&self) -> f64 {
        self.log_factor.exp()
    }

    /// Learns from a measured error and its prediction, which includes the factor. Values that are not finite and
    /// positive are ignored.
    pub(super) fn observe(&mut self, measured: f64, predicted: f64) {
        if !(measured.is_finite() && measured >= 0.0 && predicted.is_finite() && predicted > 0.0) {
            return;
        }
        let step = if measured > predicted { 1.0 - MOST_EXCEEDED } else { -MOST_EXCEEDED };
        self.log_factor = (self.log_factor + STEP * step).clamp(LEAST.ln(), MOST.ln());
    }

    /// Forgets part of the correction after a time in seconds.
    pub(super) fn relax(&mut self, secs: f64) {
        self.log_factor *= 0.5_f64.powf(secs.max(0.0) / HALF_LIFE_SECS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The correction after errors that are uniform from 0 to `most`, predicted as `usual` times the factor.
    fn learnt(most: f64, usual: f64) -> CalibratedError {
        let mut error = CalibratedError::default();
        for i in 0..2000 {
            let measured = most * (f64::from(i) * 0.618_033_988_75).fract();
            error.observe(measured, usual * error.factor());
        }
        error
    }

    #[test]
    fn without_probes_predictions_are_not_corrected() {
        assert_eq!(CalibratedError::default().factor(), 1.0);
    }

    #[test]
    fn the_factor_converges_to_where_a_tenth_of_the_errors_exceeds_the_prediction() {
        for most in [0.02, 0.04, 0.08] {
            let factor = learnt(most, 0.015).factor();
            let expected = (1.0 - MOST_EXCEEDED) * most / 0.015;
            assert!((factor / expected).ln().abs() < 0.25, "{most}: {factor}, not {expected}");
        }
    }

    #[test]
    fn the_factor_stays_within_its_limits() {
        assert!((learnt(0.0, 0.015).factor() - LEAST).abs() < 1e-9);
        assert!((learnt(1e6, 0.015).factor() - MOST).abs() < 1e-9);
        let mut error = CalibratedError::default();
        for odd in [f64::NAN, f64::INFINITY, -1.0] {
            error.observe(odd, 0.015);
            error.observe(0.1, odd);
        }
        error.observe(0.1, 0.0);
        assert_eq!(error, CalibratedError::default());
    }

    #[test]
    fn the_correction_decays_without_probes() {
        let mut error = learnt(1e6, 0.015);
        error.relax(HALF_LIFE_SECS);
        assert!((error.factor() - MOST.sqrt()).abs() < 1e-9);
        error.relax(1e9);
        assert!((error.factor() - 1.0).abs() < 1e-9);
        error.relax(-1.0);
        assert!(error.factor().is_finite());
    }
}
