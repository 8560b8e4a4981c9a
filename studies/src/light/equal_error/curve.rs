//! The time at which a renderer reaches an error.

/// A renderer's measured settings.
#[derive(Debug, Clone, Default)]
pub(super) struct Curve {
    /// Milliseconds of a view, and its mean FLIP.
    points: Vec<[f64; 2]>,
}

impl Curve {
    /// A curve through measured settings in any order.
    pub(super) fn new(mut points: Vec<[f64; 2]>) -> Self {
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self { points }
    }

    /// Milliseconds of a view whose error is at most `flip`; `None` if no measured setting is that good.
    ///
    /// Between a setting that misses the error and the next, which reaches it, the logarithms are interpolated: noise is a
    /// power of time. If the cheapest setting reaches it, its time is the answer.
    pub(super) fn ms_at(&self, flip: f64) -> Option<f64> {
        let reached = self.points.iter().position(|[_, error]| *error <= flip)?;
        let [ms, error] = self.points[reached];
        let Some([ms_before, error_before]) = reached.checked_sub(1).map(|before| self.points[before]) else {
            return Some(ms);
        };
        let share = (error_before / flip).ln() / (error_before / error).ln();
        let found = (ms_before.ln() + share * (ms / ms_before).ln()).exp();
        Some(if found.is_finite() { found } else { ms })
    }

    /// The slowest measured setting: milliseconds and error.
    pub(super) fn last(&self) -> Option<[f64; 2]> {
        self.points.last().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_between_two_settings_takes_a_time_between_theirs() {
        // Error falls with the root of time.
        let curve = Curve::new(vec![[400.0, 0.1], [100.0, 0.2]]);
        let found = curve.ms_at(0.1 * 2f64.sqrt()).unwrap();
        assert!((found - 200.0).abs() < 1e-9, "{found}");
        assert_eq!(curve.ms_at(0.2), Some(100.0));
        assert!((curve.ms_at(0.1).unwrap() - 400.0).abs() < 1e-9);
        assert_eq!(curve.last(), Some([400.0, 0.1]));
    }

    #[test]
    fn the_cheapest_setting_is_taken_where_it_is_good_enough() {
        assert_eq!(Curve::new(vec![[10.0, 0.05], [20.0, 0.01]]).ms_at(0.3), Some(10.0));
    }

    #[test]
    fn an_error_that_no_setting_reaches_has_no_time() {
        assert_eq!(Curve::new(vec![[10.0, 0.05], [20.0, 0.04]]).ms_at(0.03), None);
        assert_eq!(Curve::default().ms_at(0.03), None);
        assert_eq!(Curve::new(vec![[1.0, f64::NAN]]).ms_at(0.03), None);
    }

    #[test]
    fn an_error_of_zero_takes_the_time_of_the_setting_without_error() {
        let curve = Curve::new(vec![[10.0, 0.05], [20.0, 0.0]]);
        assert_eq!(curve.ms_at(0.0), Some(20.0));
    }
}
