//! When a better split is worth changing roles for.
//!
//! A change of roles drains a worker and moves samples, so it must pay: the predicted tick must shrink by a
//! margin, and be predicted to for a dwell time without a break. Costs and demand that merely tremble about a
//! boundary of K_fd then never move a role. One case does not wait: a stage with work and nobody to do it,
//! whose predicted tick is infinite.

use std::time::Duration;

use super::balance::{Load, Split, tick_secs};
use super::time::Uptime;

/// Decides between the split there is and the split the formula wants.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    margin: f64,
    dwell: Duration,
    idle_secs: f64,
    pending: Option<(Direction, Uptime)>,
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
        Self { margin, dwell, idle_secs, pending: None }
    }

    /// Whether to change now from `current` to `wanted`. Called once a tick or more often.
    pub fn pays(&mut self, now: Uptime, load: Load, processes: u32, current: Split, wanted: Split) -> bool {
        if current == wanted {
            self.pending = None;
            return false;
        }
        let tick = tick_secs(load, processes, current);
        let better = tick_secs(load, processes, wanted);
        if tick.is_infinite() {
            self.pending = None;
            return better.is_finite();
        }
        if !(tick >= better * self.margin && tick > self.idle_secs) {
            self.pending = None;
            return false;
        }
        let direction = match samplers_of(wanted, processes) > samplers_of(current, processes) {
            true => Direction::MoreSamplers,
            false => Direction::FewerSamplers,
        };
        let since = match self.pending {
            Some((pending, since)) if pending == direction => since,
            _ => now,
        };
        self.pending = Some((direction, since));
        if now.since(since) >= self.dwell {
            self.pending = None;
            return true;
        }
        false
    }

    /// Starts the dwell anew, because the processes changed.
    pub fn reset(&mut self) {
        self.pending = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            assert!(!h.pays(at(secs), HEAVY, 4, Split::Divided(1), Split::Divided(3)), "{secs}");
        }
        assert!(h.pays(at(3.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn a_break_starts_the_dwell_anew() {
        let mut h = hysteresis();
        assert!(!h.pays(at(0.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays(at(2.0), HEAVY, 4, Split::Divided(1), Split::Divided(1)));
        assert!(!h.pays(at(3.5), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
        assert!(!h.pays(at(5.0), HEAVY, 4, Split::Divided(2), Split::Divided(1)), "the other direction");
        assert!(!h.pays(at(6.0), HEAVY, 4, Split::Divided(1), Split::Divided(3)));
    }

    #[test]
    fn what_gains_less_than_the_margin_is_left() {
        let mut h = hysteresis();
        // On either side of a tie the tick is nearly the same.
        let tie = Load { sampling_secs: 1.01, compositing_secs: 1.0 };
        for secs in 0..100 {
            assert!(!h.pays(at(f64::from(secs)), tie, 3, Split::Divided(1), Split::Divided(2)));
        }
    }

    #[test]
    fn an_idle_cluster_keeps_its_roles() {
        let mut h = hysteresis();
        let idle = Load { sampling_secs: 0.004, compositing_secs: 0.0001 };
        for secs in 0..100 {
            assert!(!h.pays(at(f64::from(secs)), idle, 4, Split::Divided(1), Split::Divided(3)));
        }
    }

    #[test]
    fn work_that_nobody_does_is_not_kept_waiting() {
        let mut h = hysteresis();
        assert!(h.pays(at(0.0), HEAVY, 4, Split::AllDirect, Split::Divided(3)));
    }
}
