//! How much slower a worker answers views than predicted.
//!
//! Prices are those of a view alone. Workers that share a machine, encoding, and whatever else runs there make views slower, and
//! that shows within a few views: in the time between two answers while more views wait.

/// Part of the sums that stays after each view: they span about ten.
const STAYS: f64 = 0.9;

/// Predicted milliseconds that count besides, without a slowdown: few views are no measurement.
const PRIOR_MS: f64 = 50.0;

/// Least and most slowdown. Beyond is an accident, such as a compiled program.
const LEAST: f64 = 0.5;
const MOST: f64 = 8.0;

/// The slowdown of one worker.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slowdown {
    predicted_ms: f64,
    took_ms: f64,
}

impl Slowdown {
    /// Learns the time between two answers, during all of which views waited.
    pub(super) fn learn(&mut self, predicted_ms: f64, took_ms: f64) {
        if predicted_ms > 0.0 && took_ms >= 0.0 && took_ms.is_finite() {
            self.predicted_ms = STAYS * self.predicted_ms + predicted_ms;
            self.took_ms = STAYS * self.took_ms + took_ms.min(MOST * predicted_ms);
        }
    }

    /// Forgets, since no view waits.
    pub(super) fn relax(&mut self) {
        (self.predicted_ms, self.took_ms) = (STAYS * self.predicted_ms, STAYS * self.took_ms);
    }

    /// Time of a view over its predicted time.
    pub(super) fn factor(&self) -> f64 {
        ((self.took_ms + PRIOR_MS) / (self.predicted_ms + PRIOR_MS)).clamp(LEAST, MOST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_views_show_that_all_take_twice_as_long() {
        let mut slowdown = Slowdown::default();
        assert_eq!(slowdown.factor(), 1.0);
        (0..5).for_each(|_| slowdown.learn(100.0, 200.0));
        assert!((1.8..2.0).contains(&slowdown.factor()), "{}", slowdown.factor());
        // Small and large views count by their time.
        (0..50)
            .for_each(|i| if i % 2 == 0 { slowdown.learn(1.0, 9.0) } else { slowdown.learn(100.0, 200.0) });
        assert!((1.8..2.2).contains(&slowdown.factor()), "{}", slowdown.factor());
        (0..100).for_each(|_| slowdown.relax());
        assert!((slowdown.factor() - 1.0).abs() < 0.01, "nothing waits any more");
    }

    #[test]
    fn accidents_are_bounded() {
        let mut slowdown = Slowdown::default();
        for (predicted, took) in
            [(0.0, 5.0), (-1.0, 5.0), (f64::NAN, 5.0), (5.0, f64::NAN), (5.0, -1.0), (5.0, f64::INFINITY)]
        {
            slowdown.learn(predicted, took);
        }
        assert_eq!(slowdown.factor(), 1.0);
        slowdown.learn(1000.0, 1e9);
        assert!(slowdown.factor() <= MOST);
        (0..100).for_each(|_| slowdown.learn(1000.0, 0.0));
        assert_eq!(slowdown.factor(), LEAST);
    }
}
