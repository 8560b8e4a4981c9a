//! When a better split is worth changing roles for.
//!
//! A change of roles drains a worker and moves samples, so it must pay: the predicted tick must shrink by a
//! margin, and be predicted to for a dwell time without a break. Costs and demand that merely tremble about a
//! boundary of K_fd then never move a role. Among a thousand processes K can be far from the best and yet within that
//! margin: a gain of [`LEAST_GAIN`] is taken as well, once it has been predicted on the mean for
//! [`PATIENT_DWELLS`] times as long, which trembling does not outlast; and it is not taken back for a small gain, since
//! what is measured under either of two splits may well speak for the other one. For the same reason a change that was made
//! lately is undone only for the square of the margin. One case does not wait: a stage with work and
//! nobody to do it, whose predicted tick is infinite.

use std::time::Duration;

use super::balance::Split;
use crate::core::time::Uptime;

/// The least gain that a change is made for.
const LEAST_GAIN: f64 = 1.03;

/// Dwell times that a gain below the margin must be predicted for.
const PATIENT_DWELLS: u32 = 8;

/// Dwell times over which the gain is averaged, and how much it trembles.
const MEAN_DWELLS: f64 = 1.0;
const TREMBLE_DWELLS: f64 = 10.0;

/// How many times as much as it trembles the mean must gain, at the least.
const TREMBLES: f64 = 3.0;

/// Small gains are averaged over so many dwell times, and must be so many times as much as they tremble: the longer the
/// mean, the less it trembles.
const LONG_DWELLS: f64 = 10.0;
const LONG_TREMBLES: f64 = 2.0;

/// Dwell times for which a change is harder to undo than to make.
const REMEMBERED_DWELLS: u32 = 60;

/// Decides between the split there is and the split the formula wants.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    margin: f64,
    dwell: Duration,
    idle_secs: f64,
    /// Since when a gain of the margin has been predicted, and of what.
    pending: Option<(Direction, Uptime)>,
    /// Since when a mean gain of [`LEAST_GAIN`] has been predicted, and of what.
    patient: Option<(Direction, Uptime)>,
    /// Mean of the logarithm of the gain, positive towards more samplers.
    mean: f64,
    /// Mean of the logarithm of the gain over a longer time.
    long_mean: f64,
    /// Mean absolute deviation from the mean.
    tremble: f64,
    /// When it was looked at.
    looked: Option<Uptime>,
    /// Where small gains have led since the last large one.
    leaning: Option<Direction>,
    /// The latest change, among these processes.
    changed: Option<(Direction, Uptime)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    MoreSamplers,
    FewerSamplers,
}

/// How many sample under a split, for comparing two of the same number of processes.
fn samplers_of(split: Split, processes: u32) -> u32 {
    match split {
        Split::Nobody => 0,
        Split::Alone => 1,
        Split::AllDirect => processes,
        Split::Divided(k) => k,
    }
}

impl Hysteresis {
    /// A change pays if it divides the tick by `margin` or more; it is never made while the predicted tick is
    /// below `idle_secs`.
    pub fn new(margin: f64, dwell: Duration, idle_secs: f64) -> Self {
        Self {
            margin,
            dwell,
            idle_secs,
            pending: None,
            patient: None,
            mean: 0.0,
            long_mean: 0.0,
            tremble: 0.0,
            looked: None,
            leaning: None,
            changed: None,
        }
    }

    /// Whether to change now from `current` to `wanted`, each with the seconds that a tick is predicted to take under
    /// it. Called once a tick or more often.
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
        // Written so that NaN is no gain.
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
        // Counts of a few dear views a tick tremble by more than any margin that would still follow demand: it is the
        // mean that must gain, and by more the more it trembles.
        let signed = if direction == Direction::MoreSamplers { gain.ln() } else { -gain.ln() };
        let passed = self.looked.map_or(0.0, |looked| now.since(looked).as_secs_f64());
        let dwell = self.dwell.as_secs_f64().max(1e-9);
        let weight = |dwells: f64| -(-passed / (dwells * dwell)).exp_m1();
        self.mean += weight(MEAN_DWELLS) * (signed - self.mean);
        self.long_mean += weight(LONG_DWELLS) * (signed - self.long_mean);
        // A change of demand is no trembling, however large.
        let apart = (signed - self.mean).abs().min(self.margin.ln());
        self.tremble += weight(TREMBLE_DWELLS) * (apart - self.tremble);
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
        let at_once = towards(self.mean, margin.ln().max(TREMBLES * self.tremble));
        let in_time = towards(self.long_mean, LEAST_GAIN.ln().max(LONG_TREMBLES * self.tremble));
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

    /// Starts the dwell anew, because the processes changed.
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
        /// Whether a change pays by the formula's own prediction.
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
    fn a_change_that_pays_is_made_after_the_dwell_and_not_before() {
        let mut h = hysteresis();
        for secs in [0.0, 1.0, 2.0, 2.9] {
            assert!(!h.pays_for(at(secs), HEAVY, 4, Split::Divided(1), Split::Divided(3)), "{secs}");
        }
        assert!(h.pays_for(at(3.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn a_break_starts_the_dwell_anew() {
        let mut h = hysteresis();
        assert!(!h.pays_for(at(0.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays_for(at(2.0), HEAVY, 4, Split::Divided(1), Split::Divided(1)));
        assert!(!h.pays_for(at(3.5), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays_for(at(5.0), HEAVY, 4, Split::Divided(2), Split::Divided(1)), "the other direction");
        assert!(!h.pays_for(at(6.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn what_gains_less_than_the_margin_is_left() {
        let mut h = hysteresis();
        // On either side of a tie the tick is nearly the same.
        let tie = Load { sampling_secs: 1.01, compositing_secs: 1.0 };
        for secs in 0..100 {
            assert!(!h.pays_for(at(f64::from(secs)), tie, 3, Split::Divided(1), Split::Divided(2)));
        }
    }

    #[test]
    fn a_small_gain_that_lasts_is_taken_and_one_that_trembles_is_not() {
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
    fn a_small_gain_is_not_taken_back_for_another_one_but_for_a_large_one() {
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
    fn a_late_change_is_undone_for_much_at_once_and_for_the_margin_once_it_is_old() {
        let (few, more) = (Split::Divided(1), Split::Divided(2));
        let mut h = hysteresis();
        let mut quarters = 0..;
        let mut look = |h: &mut Hysteresis, (from, to), gain, most| {
            let paid = |i: u32| h.pays(at(f64::from(i) * 0.25), (from, gain), (to, 1.0), 3);
            quarters.by_ref().take(most).position(paid)
        };
        // Sixty dwells of three seconds are 720 quarters of a second.
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
    fn work_that_nobody_does_is_not_kept_waiting() {
        let mut h = hysteresis();
        assert!(h.pays_for(at(0.0), HEAVY, 4, Split::AllDirect, Split::Divided(3)));
    }
}
