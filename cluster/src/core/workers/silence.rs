//! Decides when a worker that stopped reporting is suspected.
//!
//! If other workers report on time, a missing report soon says something about its worker. If all reports are
//! missing, this process or a shared machine was held up. Reports that came during such a pause are read after it, so
//! silence is counted from its end. A worker that reported late a moment ago, as on an overloaded machine, may do so
//! again.

use std::time::Duration;

use crate::core::time::Uptime;

/// The next gap between reports may be this many times the longest recent one.
const LONGER: u32 = 2;

/// A gap shrinks by this part of the passing time: the longest one that counts is forgotten after six seconds.
const FORGOTTEN: u32 = 16;

/// The regularity of a worker's reports.
#[derive(Debug, Clone, Default)]
pub(super) struct Rhythm {
    /// The longest gap between two of its reports, which shrinks with time.
    gap: Duration,
}

impl Rhythm {
    /// Records a report, `gap` after the one before.
    pub(super) fn reported(&mut self, gap: Duration) {
        self.gap = self.gap.saturating_sub(gap / FORGOTTEN).max(gap);
    }

    /// Whether no recent gap was as long as this.
    pub(super) fn is_steady(&self, gap: Duration) -> bool {
        self.gap < gap
    }

    /// Longest silence before suspicion, from `least` to `most`.
    pub(super) fn patience(&mut self, least: Duration, most: Duration) -> Duration {
        // Longer gaps make no difference, and would only take longer to forget.
        self.gap = self.gap.min(most / LONGER);
        (self.gap * LONGER).max(least)
    }
}

/// A process was held up if it did not tick for this long: it ticks ten times a second.
pub(super) const PAUSE: Duration = Duration::from_millis(250);

/// The time since this process was last held up, judged by its ticks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Awake {
    since: Uptime,
    ticked: Uptime,
}

impl Awake {
    /// Records a tick. If the last one is `pause` or longer ago, the process was held up.
    pub(super) fn tick(&mut self, pause: Duration, now: Uptime) {
        if now.since(std::mem::replace(&mut self.ticked, now)) >= pause {
            self.since = now;
        }
    }

    /// The silence since `heard`, not counting the time before the last hold-up.
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
    fn a_gap_between_reports_raises_patience_for_a_while() {
        let millis = Duration::from_millis;
        let patience = |rhythm: &mut Rhythm| rhythm.patience(millis(750), millis(1500));
        let mut rhythm = Rhythm::default();
        (0..100).for_each(|_| rhythm.reported(millis(260)));
        assert_eq!(patience(&mut rhythm), millis(750));
        rhythm.reported(millis(500));
        assert_eq!(patience(&mut rhythm), millis(1000));
        (0..4).for_each(|_| rhythm.reported(millis(250)));
        assert!((millis(750)..millis(1000)).contains(&patience(&mut rhythm)));
        // The patience is bounded.
        rhythm.reported(millis(4000));
        assert_eq!(patience(&mut rhythm), millis(1500));
        let reports = (0..).take_while(|_| {
            rhythm.reported(millis(250));
            patience(&mut rhythm) > millis(750)
        });
        assert!((20..30).contains(&reports.count()));
    }

    #[test]
    fn silence_is_not_counted_while_the_process_was_held_up() {
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
