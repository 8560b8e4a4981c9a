//! Smoothing of what is measured: costs with outliers, counts per tick.

/// Observations that the median looks at: two of five may be wild.
const WINDOW: usize = 5;

/// A cost as it is believed: the moving average of the median of the last five observations.
///
/// First renders compile pipelines, a busy machine stalls one batch in a hundred: a mean would carry each such
/// outlier for seconds, the median never sees it. A real change passes the median at the third observation.
#[derive(Debug, Clone)]
pub struct Smoothed {
    weight: f64,
    recent: Vec<f64>,
    value: Option<f64>,
}

impl Smoothed {
    /// Nothing measured yet; `weight` of the newest median in (0, 1].
    pub fn new(weight: f64) -> Self {
        Self { weight, recent: Vec::with_capacity(WINDOW), value: None }
    }

    /// Takes an observation in; one that is not a positive finite number is no measurement and is ignored.
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
        // The lower of two middles: the first observations are the slow ones.
        let median = sorted[(sorted.len() - 1) / 2];
        self.value = Some(match self.value {
            Some(value) if self.recent.len() == WINDOW => value + self.weight * (median - value),
            _ => median,
        });
    }

    /// What is believed, if anything was measured.
    pub fn value(&self) -> Option<f64> {
        self.value
    }
}

/// After this many ticks without a count a rate is zero: a moving average alone would never get there, and
/// whether there is any demand at all decides between rendering everything directly and dividing the roles.
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
    /// Nothing counted yet; `weight` of the newest tick in (0, 1].
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

    /// Per tick, over the ticks that are closed.
    pub fn per_tick(&self) -> f64 {
        self.average
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_wild_observations_of_five_leave_the_cost_where_it_was() {
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
    fn what_is_not_a_measurement_is_ignored() {
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
