//! Smoothing of measurements: costs with outliers, and counts per tick.

/// Observations in the median: two of five may be outliers.
const WINDOW: usize = 5;

/// A smoothed cost: the moving average of the median of the last five observations.
///
/// First renders compile pipelines, and a busy machine stalls one batch in a hundred. A mean would carry such
/// outliers for seconds, the median ignores them. A real change passes the median at the third observation.
#[derive(Debug, Clone)]
pub struct Smoothed {
    weight: f64,
    recent: Vec<f64>,
    value: Option<f64>,
}

impl Smoothed {
    /// Starts without measurements; `weight` of the newest median is in (0, 1].
    pub fn new(weight: f64) -> Self {
        Self { weight, recent: Vec::with_capacity(WINDOW), value: None }
    }

    /// Adds an observation. One that is not positive and finite is ignored.
    pub fn observe(&mut self, x: f64) {
        if !(x > 0.0 && x.is_finite()) {
            return;
        }
        if self.recent.len() == WINDOW {
            self.recent.remove(0);
        }
        self.recent.push(x);
        let mut sorted = self.recent.clone();
        sorted.sort_by(f64::total_cmp);
        // Of two middle values the lower one, since the first observations are slow.
        let median = sorted[(sorted.len() - 1) / 2];
        self.value = Some(match self.value {
            Some(value) if self.recent.len() == WINDOW => value + self.weight * (median - value),
            _ => median,
        });
    }

    /// The smoothed cost; `None` without measurements.
    pub fn value(&self) -> Option<f64> {
        self.value
    }
}

/// The median of the finite values; of two middle ones the lower, since disturbances only add time.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}

/// After this many empty ticks a rate is zero. A moving average alone would never reach zero, but whether there is
/// any demand decides about the roles.
const EMPTY_TICKS: u32 = 10;

/// A count per tick, averaged over ticks.
#[derive(Debug, Clone)]
pub struct Rate {
    weight: f64,
    current: u64,
    average: f64,
    empty_ticks: u32,
}

impl Rate {
    /// Starts without counts; `weight` of the newest tick is in (0, 1].
    pub fn new(weight: f64) -> Self {
        Self { weight, current: 0, average: 0.0, empty_ticks: 0 }
    }

    /// Counts `n` in the current tick.
    pub fn count(&mut self, n: u64) {
        self.current += n;
    }

    /// Closes the tick.
    pub fn roll(&mut self) {
        self.average += self.weight * (self.current as f64 - self.average);
        self.empty_ticks = if self.current == 0 { self.empty_ticks.saturating_add(1) } else { 0 };
        if self.empty_ticks >= EMPTY_TICKS {
            self.average = 0.0;
        }
        self.current = 0;
    }

    /// The average count per closed tick.
    pub fn per_tick(&self) -> f64 {
        self.average
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_outliers_of_five_do_not_change_the_cost() {
        let mut cost = Smoothed::new(0.3);
        for x in [400.0, 10.0, 10.2, 9.8, 500.0, 10.0, 10.1, 9.9] {
            cost.observe(x);
        }
        let value = cost.value().unwrap();
        assert!((value - 10.0).abs() < 0.3, "{value}");
    }

    #[test]
    fn a_real_change_is_followed_within_ten_observations() {
        let mut cost = Smoothed::new(0.3);
        (0..20).for_each(|_| cost.observe(10.0));
        (0..10).for_each(|_| cost.observe(40.0));
        let value = cost.value().unwrap();
        assert!(value > 35.0 && value <= 40.0, "{value}");
    }

    #[test]
    fn values_that_are_no_measurement_are_ignored() {
        let mut cost = Smoothed::new(0.3);
        for x in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            cost.observe(x);
        }
        assert_eq!(cost.value(), None);
        cost.observe(2.0);
        cost.observe(f64::NAN);
        assert_eq!(cost.value(), Some(2.0));
    }

    #[test]
    fn a_rate_follows_demand_and_falls_to_zero() {
        let mut rate = Rate::new(0.3);
        for _ in 0..20 {
            rate.count(100);
            rate.roll();
        }
        assert!((rate.per_tick() - 100.0).abs() < 0.2);
        for _ in 0..10 {
            rate.roll();
        }
        assert_eq!(rate.per_tick(), 0.0);
    }
}
