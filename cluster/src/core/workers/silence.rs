//! Decides when a worker that stopped reporting is suspected.
//!
//! That depends on which other workers are heard. Reports that fail to come while others come on time say something of their worker,
//! soon; reports that all fail to come say as much of this process, or of the machine that all share. What came while this
//! process stood still is read only after it went on, so that no silence begins before that. And whoever reported late a
//! moment ago, as on a machine with more to do than it has cores for, may do so again.

use std::time::Duration;

use crate::core::time::Uptime;

/// Of a gap between two reports, how long the next one may be before it says something.
const LONGER: u32 = 2;

/// A gap is forgotten by this part of the time that passes: the longest that counts makes no difference six seconds later.
const FORGOTTEN: u32 = 16;

/// How regularly a worker reports.
#[derive(Debug, Clone, Default)]
pub(super) struct Rhythm {
    /// The longest gap between two of its reports, but for what is forgotten of it.
    gap: Duration,
}

impl Rhythm {
    /// It reported, for the first time in so long.
    pub(super) fn reported(&mut self, gap: Duration) {
        self.gap = self.gap.saturating_sub(gap / FORGOTTEN).max(gap);
    }

    /// Whether it has lately left out no report for that long.
    pub(super) fn is_steady(&self, gap: Duration) -> bool {
        self.gap < gap
    }

    /// How long it may be silent, from `least` to `most`.
    pub(super) fn patience(&mut self, least: Duration, most: Duration) -> Duration {
        // What is longer than makes a difference would only take longer to forget.
        self.gap = self.gap.min(most / LONGER);
        (self.gap * LONGER).max(least)
    }
}

/// A process that ticks ten times a second stood still if it did not for so long, however short leases are.
pub(super) const PAUSE: Duration = Duration::from_millis(250);

/// Since when this process has gone on without a pause, as far as its ticks say.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Awake {
    since: Uptime,
    ticked: Uptime,
}

impl Awake {
    /// Another tick, before which it stood still if that is `pause` or longer ago.
    pub(super) fn tick(&mut self, pause: Duration, now: Uptime) {
        if now.since(std::mem::replace(&mut self.ticked, now)) >= pause {
            self.since = now;
        }
    }

    /// How long nothing was heard that was last heard then.
    pub(super) fn silence(self, heard: Uptime, now: Uptime) -> Duration {
        now.since(heard.max(self.since))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    #[test]
    fn gaps_between_reports_make_patient_for_a_while() {
        let millis = Duration::from_millis;
        let patience = |rhythm: &mut Rhythm| rhythm.patience(millis(750), millis(1500));
        let mut rhythm = Rhythm::default();
        (0..100).for_each(|_| rhythm.reported(millis(260)));
        assert_eq!(patience(&mut rhythm), millis(750));
        rhythm.reported(millis(500));
        assert_eq!(patience(&mut rhythm), millis(1000));
        (0..4).for_each(|_| rhythm.reported(millis(250)));
        assert!((millis(750)..millis(1000)).contains(&patience(&mut rhythm)));
        // However long one was.
        rhythm.reported(millis(4000));
        assert_eq!(patience(&mut rhythm), millis(1500));
        let reports = (0..).take_while(|_| {
            rhythm.reported(millis(250));
            patience(&mut rhythm) > millis(750)
        });
        assert!((20..30).contains(&reports.count()));
    }

    #[test]
    fn what_was_silent_while_nobody_listened_was_not() {
        let pause = Duration::from_millis(375);
        let mut awake = Awake::default();
        for tick in 1..=10 {
            awake.tick(pause, at(0.1 * f64::from(tick)));
        }
        assert_eq!(awake.silence(at(0.4), at(1.0)), Duration::from_millis(600));
        awake.tick(pause, at(4.0));
        assert_eq!(awake.silence(at(0.4), at(4.1)), Duration::from_millis(100));
        assert_eq!(awake.silence(at(4.05), at(4.1)), Duration::from_millis(50));
    }
}
