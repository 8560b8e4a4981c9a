//! Hysteresis: when a better split is worth a change of roles.
//!
//! A change of roles drains workers and moves samples, so it must pay, and noise must not cause it. The rule is a
//! cumulative sum (CUSUM, Page 1954) of predicted gains. A gain is the binary logarithm of the predicted tick over
//! that of the better split, and counts as 1 at most. Gains towards more samplers add to the sum, gains towards fewer
//! subtract, each times the seconds that it lasted. A slack takes the sum back towards zero. Roles change once the sum
//! reaches the dwell time: after at least that time for a tick that would halve, later for smaller gains, and never
//! for gains below the slack.
//!
//! The slack is proportional to the share of the workers that would change. A few of a thousand workers change for a
//! small gain, one of three only for a large one. Noise needs that as well: the fewer the workers, the noisier the
//! demand. After a change the sum is kept, so that rising demand is followed at once.
//!
//! Measurements under either of two splits may favour the other. So a recent change is undone only for a gain that
//! would let half of the workers change. One change is immediate: when a stage has work and no worker, so that the
//! predicted tick is infinite.

use std::time::Duration;

use super::balance::Split;
use crate::core::time::Uptime;

/// Dwell times for which a change is harder to undo than to make.
const REMEMBERED_DWELLS: u32 = 60;

/// Decides between the present split and the one that the formula wants.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    margin: f64,
    dwell: Duration,
    idle_secs: f64,
    /// The sum of gains, in seconds of a tick that would halve; positive towards more samplers.
    evidence: f64,
    /// The time of the last observation.
    looked: Option<Uptime>,
    /// The direction (1: more samplers, -1: fewer) and the time of the latest change among these processes.
    changed: Option<(f64, Uptime)>,
}

/// Number of samplers under a split, to compare two splits of the same number of processes.
fn samplers_of(split: Split, processes: u32) -> u32 {
    match split {
        Split::NoWorkers => 0,
        Split::Alone => 1,
        Split::AllDirect => processes,
        Split::Divided(k) => k,
    }
}

impl Hysteresis {
    /// A change of all workers pays if it divides the tick by more than `margin`; a change of a share of them, by more
    /// than that power of `margin`. A gain of one halving must last for at least `dwell`. No change is made while the
    /// predicted tick is below `idle_secs`.
    pub fn new(margin: f64, dwell: Duration, idle_secs: f64) -> Self {
        Self { margin, dwell, idle_secs, evidence: 0.0, looked: None, changed: None }
    }

    /// Whether to change now from `current` to `wanted`, each with its predicted seconds of a tick. Called once a
    /// tick or more often.
    pub fn pays(&mut self, now: Uptime, current: (Split, f64), wanted: (Split, f64), processes: u32) -> bool {
        let ((current, tick), (wanted, better)) = (current, wanted);
        if tick.is_infinite() && current != wanted {
            self.reset();
            return better.is_finite();
        }
        let (samplers, aim) = (samplers_of(current, processes), samplers_of(wanted, processes));
        let direction = if aim > samplers { 1.0 } else { -1.0 };
        // A NaN is no gain.
        let is_gain = aim != samplers && tick > self.idle_secs && tick > better;
        let gain = if is_gain { (tick / better).log2().min(1.0) } else { 0.0 };
        let share = f64::from(aim.abs_diff(samplers).max(1)) / f64::from(processes.max(1));
        let undoes = self.changed.is_some_and(|(changed, when)| {
            changed != direction && now.since(when) < self.dwell * REMEMBERED_DWELLS
        });
        let slack = self.margin.log2() * if undoes { share.max(0.5) } else { share };
        let dwell_secs = self.dwell.as_secs_f64();
        // One observation after a pause of the coordinator is not enough.
        let passed = self.looked.map_or(0.0, |looked| now.since(looked).as_secs_f64().min(dwell_secs));
        self.looked = Some(now);
        let evidence = self.evidence + direction * gain * passed;
        let left = (evidence.abs() - slack * passed).clamp(0.0, dwell_secs);
        self.evidence = left.copysign(evidence);
        let pays = gain > 0.0 && direction * self.evidence >= dwell_secs;
        if pays {
            self.changed = Some((direction, now));
        }
        pays
    }

    /// Forgets all evidence, because the processes changed.
    pub fn reset(&mut self) {
        (self.evidence, self.looked, self.changed) = (0.0, None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::super::balance::{Load, tick_secs};
    use super::*;

    impl Hysteresis {
        /// Whether a change pays by the formula's prediction.
        fn pays_for(&mut self, now: Uptime, load: Load, processes: u32, from: Split, to: Split) -> bool {
            let with = |split| (split, tick_secs(load, processes, split));
            self.pays(now, with(from), with(to), processes)
        }
    }

    /// Time as the hysteresis sees it: four observations a second.
    #[derive(Default)]
    struct Quarters(u32);

    impl Quarters {
        /// Seconds until a change pays, at most `secs`, with the predicted gain as a function of the observation.
        fn until(
            &mut self,
            h: &mut Hysteresis,
            (from, to): (u32, u32),
            processes: u32,
            secs: u32,
            gain: impl Fn(u32) -> f64,
        ) -> Option<f64> {
            let paid = (0..secs * 4).find(|i| {
                self.0 += 1;
                let splits = ((Split::Divided(from), gain(*i)), (Split::Divided(to), 1.0));
                h.pays(at(f64::from(self.0) * 0.25), splits.0, splits.1, processes)
            });
            paid.map(|i| f64::from(i) * 0.25)
        }
    }

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    fn hysteresis() -> Hysteresis {
        Hysteresis::new(1.6, Duration::from_secs(3), 0.01)
    }

    const HEAVY: Load = Load { sampling_secs: 0.8, compositing_secs: 0.2 };

    #[test]
    fn a_change_that_pays_is_made_after_the_dwell_time() {
        let secs = Quarters::default().until(&mut hysteresis(), (1, 3), 4, 60, |_| 3.0).unwrap();
        assert!((3.0..6.0).contains(&secs), "{secs}");
    }

    #[test]
    fn an_observation_after_a_pause_changes_nothing() {
        let mut h = hysteresis();
        assert!(!h.pays_for(at(0.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays_for(at(100.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn gains_in_opposite_directions_cancel() {
        let (mut h, mut time) = (hysteresis(), Quarters::default());
        for _ in 0..20 {
            assert_eq!(time.until(&mut h, (2, 3), 4, 2, |_| 2.0), None);
            assert_eq!(time.until(&mut h, (2, 1), 4, 2, |_| 2.0), None);
        }
    }

    #[test]
    fn a_gain_below_the_margin_changes_nothing() {
        let mut h = hysteresis();
        // On both sides of a tie the tick is nearly the same.
        let tie = Load { sampling_secs: 1.01, compositing_secs: 1.0 };
        for secs in 0..100 {
            assert!(!h.pays_for(at(f64::from(secs)), tie, 3, Split::Divided(1), Split::Divided(2)));
        }
        assert_eq!(Quarters::default().until(&mut hysteresis(), (1, 2), 3, 600, |_| 1.15), None);
    }

    #[test]
    fn a_small_gain_is_taken_if_few_workers_change_and_it_is_steady() {
        let until = |secs: u32, gain: &dyn Fn(u32) -> f64| {
            Quarters::default().until(&mut hysteresis(), (60, 64), 1024, secs, gain)
        };
        let secs = until(120, &|_| 1.07).unwrap();
        assert!((24.0..60.0).contains(&secs), "{secs}");
        assert!(until(120, &|i| if i % 16 == 0 { 1.0 } else { 1.07 }).is_some(), "on the mean");
        assert_eq!(until(120, &|i| if i % 4 == 0 { 1.07 } else { 1.0 }), None);
        assert_eq!(until(600, &|_| 1.001), None);
        assert_eq!(until(600, &|_| f64::NAN), None);
    }

    #[test]
    fn a_recent_change_is_undone_only_for_more_than_the_margin() {
        for (few, more, processes, gain) in [(1, 2, 3, 1.25), (60, 64, 1024, 1.07)] {
            let (mut h, mut time) = (hysteresis(), Quarters::default());
            assert!(time.until(&mut h, (few, more), processes, 120, |_| gain).is_some());
            assert_eq!(time.until(&mut h, (more, few), processes, 175, |_| gain), None);
            assert!(time.until(&mut h, (more, few), processes, 120, |_| gain).is_some(), "it is old");
            let rises = time.until(&mut h, (few, more), processes, 120, |_| 1.6);
            assert!(rises.is_some_and(|secs| secs < 15.0), "demand that rises is followed: {rises:?}");
        }
    }

    #[test]
    fn a_change_that_grows_while_it_is_made_is_followed_at_once() {
        let (mut h, mut time) = (hysteresis(), Quarters::default());
        assert!(time.until(&mut h, (1, 20), 100, 60, |_| 10.0).is_some());
        assert!(time.until(&mut h, (20, 40), 100, 60, |_| 1.5).is_some_and(|secs| secs <= 1.0));
    }

    #[test]
    fn an_idle_cluster_keeps_its_roles() {
        let mut h = hysteresis();
        let idle = Load { sampling_secs: 0.004, compositing_secs: 0.0001 };
        for secs in 0..100 {
            assert!(!h.pays_for(at(f64::from(secs)), idle, 4, Split::Divided(1), Split::Divided(3)));
        }
    }

    #[test]
    fn a_stage_with_work_and_no_worker_is_staffed_at_once() {
        let mut h = hysteresis();
        assert!(h.pays_for(at(0.0), HEAVY, 4, Split::AllDirect, Split::Divided(3)));
    }
}
