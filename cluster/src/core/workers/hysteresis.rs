//! Hysteresis: when a better split is worth a change of roles.
//!
//! A change of roles drains a worker and moves samples, so it must pay. The predicted tick must shrink by a margin,
//! and must be predicted to for a dwell time without interruption. So costs and demand that fluctuate around a
//! boundary of K_fd never move a role.
//!
//! Among a thousand processes, K can be far from the best and still within that margin. So a mean gain of
//! [`LEAST_GAIN`] is enough if it is predicted for [`PATIENT_DWELLS`] times as long, which fluctuations do not
//! outlast. It is not undone for a small gain, since measurements under either of two splits may favour the other.
//! For the same reason a recent change is undone only for the square of the margin. One change is immediate: when a
//! stage has work and no worker, so that the predicted tick is infinite.

use std::time::Duration;

use super::balance::Split;
use crate::core::time::Uptime;

/// The least gain for a change.
const LEAST_GAIN: f64 = 1.03;

/// Dwell times for which a gain below the margin must be predicted.
const PATIENT_DWELLS: u32 = 8;

/// Dwell times over which the gain, and its mean absolute deviation, are averaged.
const MEAN_DWELLS: f64 = 1.0;
const DEVIATION_DWELLS: f64 = 10.0;

/// The mean gain must be at least this many deviations.
const DEVIATIONS: f64 = 3.0;

/// Small gains are averaged over this many dwell times, and must be at least this many deviations: a longer mean
/// deviates less.
const LONG_DWELLS: f64 = 10.0;
const LONG_DEVIATIONS: f64 = 2.0;

/// Dwell times for which a change is harder to undo than to make.
const REMEMBERED_DWELLS: u32 = 60;

/// Decides between the present split and the one that the formula wants.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    margin: f64,
    dwell: Duration,
    idle_secs: f64,
    /// The direction and the start of the present prediction of a gain of the margin.
    pending: Option<(Direction, Uptime)>,
    /// The direction and the start of the present prediction of a mean gain of [`LEAST_GAIN`].
    patient: Option<(Direction, Uptime)>,
    /// Mean of the gain's logarithm, positive towards more samplers.
    mean: f64,
    /// Mean of the gain's logarithm over a longer time.
    long_mean: f64,
    /// Mean absolute deviation of the gain's logarithm.
    deviation: f64,
    /// The time of the last observation.
    looked: Option<Uptime>,
    /// The direction of small changes since the last large one.
    leaning: Option<Direction>,
    /// The direction and the time of the latest change among these processes.
    changed: Option<(Direction, Uptime)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    MoreSamplers,
    FewerSamplers,
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
    /// A change pays if it divides the tick by `margin` or more. No change is made while the predicted tick is below
    /// `idle_secs`.
    pub fn new(margin: f64, dwell: Duration, idle_secs: f64) -> Self {
        Self {
            margin,
            dwell,
            idle_secs,
            pending: None,
            patient: None,
            mean: 0.0,
            long_mean: 0.0,
            deviation: 0.0,
            looked: None,
            leaning: None,
            changed: None,
        }
    }

    /// Whether to change now from `current` to `wanted`, each with its predicted seconds of a tick. Called once a
    /// tick or more often.
    pub fn pays(&mut self, now: Uptime, current: (Split, f64), wanted: (Split, f64), processes: u32) -> bool {
        let ((current, tick), (wanted, better)) = (current, wanted);
        if tick.is_infinite() && current != wanted {
            self.reset();
            return better.is_finite();
        }
        let direction = match samplers_of(wanted, processes) > samplers_of(current, processes) {
            true => Direction::MoreSamplers,
            false => Direction::FewerSamplers,
        };
        // A NaN is no gain.
        let gain =
            if current != wanted && tick > self.idle_secs && tick > better { tick / better } else { 1.0 };
        let lasting = |since: &mut Option<(Direction, Uptime)>, goes: Option<Direction>| {
            *since = match (*since, goes) {
                (_, None) => None,
                (Some((pending, since)), Some(direction)) if pending == direction => Some((pending, since)),
                (_, Some(direction)) => Some((direction, now)),
            };
            since.map(|(_, since)| now.since(since))
        };
        // With few expensive views a tick, counts fluctuate by more than any useful margin. So the mean must gain, by
        // more the more it deviates.
        let signed = if direction == Direction::MoreSamplers { gain.ln() } else { -gain.ln() };
        let passed = self.looked.map_or(0.0, |looked| now.since(looked).as_secs_f64());
        let dwell = self.dwell.as_secs_f64().max(1e-9);
        let weight = |dwells: f64| -(-passed / (dwells * dwell)).exp_m1();
        self.mean += weight(MEAN_DWELLS) * (signed - self.mean);
        self.long_mean += weight(LONG_DWELLS) * (signed - self.long_mean);
        // A change of demand must not count as a large deviation.
        let apart = (signed - self.mean).abs().min(self.margin.ln());
        self.deviation += weight(DEVIATION_DWELLS) * (apart - self.deviation);
        self.looked = Some(now);
        let towards = |mean: f64, least: f64| match mean {
            mean if mean >= least => Some(Direction::MoreSamplers),
            mean if mean <= -least => Some(Direction::FewerSamplers),
            _ => None,
        };
        let is_undone =
            |(changed, when)| changed != direction && now.since(when) < self.dwell * REMEMBERED_DWELLS;
        let undoes = self.changed.is_some_and(is_undone);
        let margin = if undoes { self.margin.powi(2) } else { self.margin };
        let at_once = towards(self.mean, margin.ln().max(DEVIATIONS * self.deviation));
        let in_time = towards(self.long_mean, LEAST_GAIN.ln().max(LONG_DEVIATIONS * self.deviation));
        let goes = (gain >= margin).then_some(direction);
        let lasted = lasting(&mut self.pending, goes);
        let large = lasted.is_some_and(|lasted| lasted >= self.dwell) && at_once == Some(direction);
        let lasted = lasting(&mut self.patient, in_time);
        let patience = lasted.is_some_and(|lasted| lasted >= self.dwell * PATIENT_DWELLS)
            && self.leaning.is_none_or(|leaning| leaning == direction);
        let small = patience && !undoes && in_time == Some(direction) && gain >= LEAST_GAIN;
        if large || small {
            self.reset();
            self.leaning = (!large).then_some(direction);
            self.changed = Some((direction, now));
        }
        large || small
    }

    /// Starts the dwell time anew, because the processes changed.
    pub fn reset(&mut self) {
        (self.pending, self.patient, self.looked) = (None, None, None);
        (self.mean, self.long_mean, self.leaning, self.changed) = (0.0, 0.0, None, None);
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

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    fn hysteresis() -> Hysteresis {
        Hysteresis::new(1.15, Duration::from_secs(3), 0.01)
    }

    const HEAVY: Load = Load { sampling_secs: 0.8, compositing_secs: 0.2 };

    #[test]
    fn a_change_that_pays_is_made_after_the_dwell_time() {
        let mut h = hysteresis();
        for secs in [0.0, 1.0, 2.0, 2.9] {
            assert!(!h.pays_for(at(secs), HEAVY, 4, Split::Divided(1), Split::Divided(3)), "{secs}");
        }
        assert!(h.pays_for(at(3.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn an_interruption_starts_the_dwell_time_anew() {
        let mut h = hysteresis();
        assert!(!h.pays_for(at(0.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays_for(at(2.0), HEAVY, 4, Split::Divided(1), Split::Divided(1)));
        assert!(!h.pays_for(at(3.5), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays_for(at(5.0), HEAVY, 4, Split::Divided(2), Split::Divided(1)), "the other direction");
        assert!(!h.pays_for(at(6.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn a_gain_below_the_margin_changes_nothing() {
        let mut h = hysteresis();
        // On both sides of a tie the tick is nearly the same.
        let tie = Load { sampling_secs: 1.01, compositing_secs: 1.0 };
        for secs in 0..100 {
            assert!(!h.pays_for(at(f64::from(secs)), tie, 3, Split::Divided(1), Split::Divided(2)));
        }
    }

    #[test]
    fn a_small_gain_is_taken_only_if_it_is_steady() {
        let (few, more) = (Split::Divided(60), Split::Divided(64));
        let gains = |h: &mut Hysteresis, gain: &dyn Fn(u32) -> f64| {
            (0..480)
                .map(|i| h.pays(at(f64::from(i) * 0.25), (few, gain(i)), (more, 1.0), 1024))
                .position(|p| p)
        };
        let when = gains(&mut hysteresis(), &|_| 1.07).unwrap();
        assert!(
            (96..480).contains(&when),
            "after eight dwells of 3 s, and not at {when} quarters of a second"
        );
        assert!(gains(&mut hysteresis(), &|i| if i % 16 == 0 { 1.0 } else { 1.07 }).is_some(), "on the mean");
        assert_eq!(gains(&mut hysteresis(), &|i| if i % 4 == 0 { 1.07 } else { 1.0 }), None);
        assert_eq!(gains(&mut hysteresis(), &|_| 1.02), None);
        assert_eq!(gains(&mut hysteresis(), &|_| f64::NAN), None);
    }

    #[test]
    fn a_small_change_is_undone_only_for_a_large_gain() {
        let (few, more) = (Split::Divided(60), Split::Divided(64));
        let mut h = hysteresis();
        let mut quarters = 0..;
        let mut look = |h: &mut Hysteresis, (from, to), gain, most| {
            let paid = |i: u32| h.pays(at(f64::from(i) * 0.25), (from, gain), (to, 1.0), 1024);
            quarters.by_ref().take(most).any(paid)
        };
        assert!(look(&mut h, (few, more), 1.07, 480));
        assert!(!look(&mut h, (more, few), 1.07, 4800));
        assert!(look(&mut h, (more, few), 1.3, 480));
        assert!(look(&mut h, (few, more), 1.07, 1200), "after a large one it begins anew, once that is old");
    }

    #[test]
    fn a_recent_change_is_undone_only_for_more_than_the_margin() {
        let (few, more) = (Split::Divided(1), Split::Divided(2));
        let mut h = hysteresis();
        let mut quarters = 0..;
        let mut look = |h: &mut Hysteresis, (from, to), gain, most| {
            let paid = |i: u32| h.pays(at(f64::from(i) * 0.25), (from, gain), (to, 1.0), 3);
            quarters.by_ref().take(most).position(paid)
        };
        // Sixty dwell times of three seconds are 720 quarters of a second.
        assert!(look(&mut h, (few, more), 1.25, 480).is_some());
        assert_eq!(look(&mut h, (more, few), 1.25, 700), None);
        assert!(look(&mut h, (more, few), 1.25, 480).is_some(), "it is old");
        assert!(
            look(&mut h, (few, more), 1.6, 480).is_some_and(|when| when < 40),
            "demand that rises is followed"
        );
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
