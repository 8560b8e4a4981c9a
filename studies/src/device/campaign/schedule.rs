//! Divides a campaign's time: each step gets up to its limit, in order of value, from the time that is left.

use std::time::Duration;

use super::Step;

/// A step with less time than this is skipped: processes take some seconds to start.
const LEAST: Duration = Duration::from_secs(10);

/// A step's time limit, given the campaign's remaining time; or the reason why it is skipped.
pub(super) fn allot(step: &Step, quick: bool, left: Duration) -> Result<Duration, String> {
    if left < LEAST {
        return Err(format!("no time left: {:.0} s; give more --minutes", left.as_secs_f64()));
    }
    Ok(step.most(quick).min(left))
}

#[cfg(test)]
mod tests {
    use super::super::STEPS;
    use super::*;

    /// The time limits of all steps, if each step uses all of its time.
    fn run_through(total: Duration, quick: bool) -> Vec<Option<Duration>> {
        let mut left = total;
        let mut next = |step: &Step| {
            let limit = allot(step, quick, left).ok()?;
            left -= limit;
            Some(limit)
        };
        STEPS.iter().map(&mut next).collect()
    }

    #[test]
    fn a_campaign_keeps_its_time_and_skips_its_last_steps_first() {
        for (minutes, quick) in [(1.0, false), (10.0, true), (30.0, false), (0.0, true)] {
            let total = Duration::from_secs_f64(minutes * 60.0);
            let limits = run_through(total, quick);
            assert!(limits.iter().flatten().sum::<Duration>() <= total, "{minutes} min");
            assert!(limits.is_sorted_by_key(Option::is_none), "{limits:?}");
        }
    }

    #[test]
    fn a_step_gets_the_time_that_is_left_and_is_skipped_in_the_last_seconds() {
        let step = &STEPS[1];
        assert_eq!(allot(step, false, Duration::from_secs(1000)), Ok(step.most(false)));
        assert_eq!(allot(step, false, Duration::from_secs(42)), Ok(Duration::from_secs(42)));
        assert!(allot(step, false, Duration::from_secs(9)).unwrap_err().contains("--minutes"));
        assert_eq!(allot(step, true, Duration::from_secs(1000)), Ok(step.most(true)));
    }
}
