//! What a second of a worker is worth: the price that all views share.
//!
//! Two things make time scarce. While views wait, each second that one takes delays the others: the price of the queue rises with the
//! predicted wait. And time that views leave is spent on sources: a second is worth what the best purchase on offer would bring
//! for it, smoothed over a second so that a purchase does not move the price at once. The sum of both is bounded. A view's own price is
//! at least what its preset says that its time is worth, which keeps views from changing their way with every relief of the queue.
//!
//! Below a share of the load that all views from triangles would be, time is not scarce: the price is the preset's, and nothing is
//! bought. The measure is what is asked, not how busy workers are, since that follows from the price itself.

use argus_scene::Preset;

use crate::core::time::Uptime;

/// Most that a second is worth, FLIP.
///
/// Tuned: `crowd/rule.py`, `cap`.
pub const MOST: f64 = 20.0;

/// Wait that costs nothing, seconds.
///
/// Tuned: .02 (CROWD.md, q₀).
const FREE_WAIT: f64 = 0.02;

/// Wait beyond it at which a second is worth one FLIP, in views from triangles.
///
/// Tuned: .2 (CROWD.md, V).
const WAIT_OF_ONE: f64 = 0.2;

/// Seconds over which the worth of the best purchase is smoothed.
///
/// Tuned: 1 (CROWD.md, "What each part is for").
const SMOOTH_SECS: f64 = 1.0;

/// Seconds over which the load is averaged.
///
/// Tuned: 2 (CROWD.md, rule 5).
const AVERAGE_SECS: f64 = 2.0;

/// Share of the workers' time that all views from triangles would take, from which on time is scarce.
///
/// Tuned: .6 (CROWD.md, rule 5).
const SCARCE: f64 = 0.6;

/// What the time of a view from triangles is worth by a preset, mean FLIP.
///
/// Tuned: 0, .01, .05 (issue 54; with .01 no viewer changes its way at 1×, without it 45% of consecutive views do).
pub fn worth_of_view(preset: Option<Preset>) -> f64 {
    match preset {
        Some(Preset::Exact) => 0.0,
        None | Some(Preset::Balanced) => 0.01,
        Some(Preset::Interactive) => 0.05,
    }
}

/// The state of the price.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TimePrice {
    /// Seconds of one worker that views asked for in a second, each from triangles in full.
    asked: f64,
    asked_at: Uptime,
    /// Mean seconds of these views.
    view_secs: f64,
    /// Smoothed worth of the best purchase, FLIP a second.
    worth: f64,
    worth_at: Uptime,
    /// Price of the queue, FLIP a second.
    queue: f64,
}

impl TimePrice {
    /// Counts a view, by its seconds from triangles in full.
    pub fn ask(&mut self, secs: f64, now: Uptime) {
        // Written so that NaN counts nothing.
        if !(secs > 0.0 && secs.is_finite()) {
            return;
        }
        self.asked = self.asked_secs(now) + secs / AVERAGE_SECS;
        self.asked_at = now;
        self.view_secs = if self.view_secs > 0.0 { 0.9 * self.view_secs + 0.1 * secs } else { secs };
    }

    /// Seconds of one worker that views ask for in a second, each from triangles in full.
    pub fn asked_secs(&self, now: Uptime) -> f64 {
        self.asked * (-now.since(self.asked_at).as_secs_f64() / AVERAGE_SECS).exp()
    }

    /// u: the load if all views were from triangles, in shares of so many workers.
    pub fn load(&self, workers: f64, now: Uptime) -> f64 {
        self.asked_secs(now) / workers.max(1.0)
    }

    /// Whether time is scarce.
    pub fn is_scarce(&self, workers: f64, now: Uptime) -> bool {
        self.load(workers, now) >= SCARCE
    }

    /// Follows the wait of views, in mean seconds a worker, and the worth of the best purchase on offer.
    pub fn follow(&mut self, wait_secs: f64, best_worth: f64, workers: f64, now: Uptime) {
        let scarce = self.is_scarce(workers, now);
        let free = if scarce { FREE_WAIT } else { f64::INFINITY };
        let waits = (wait_secs - free).max(0.0);
        self.queue = match self.view_secs > 0.0 {
            true => (waits / (WAIT_OF_ONE * self.view_secs)).min(MOST),
            false => 0.0,
        };
        let keeps = (-now.since(self.worth_at).as_secs_f64() / SMOOTH_SECS).exp();
        let best = if scarce { best_worth.clamp(0.0, MOST) } else { 0.0 };
        (self.worth, self.worth_at) = (keeps * self.worth + (1.0 - keeps) * best, now);
    }

    /// λ_q: the price of the queue, FLIP a second.
    pub fn of_queue(&self) -> f64 {
        self.queue
    }

    /// r̄: the smoothed worth of the best purchase, FLIP a second.
    pub fn worth(&self) -> f64 {
        self.worth
    }

    /// λ of a view, FLIP a second: `full_secs` is its time from triangles in full.
    pub fn of_view(&self, preset: Option<Preset>, full_secs: f64, workers: f64, now: Uptime) -> f64 {
        let own = if full_secs > 0.0 { worth_of_view(preset) / full_secs } else { 0.0 };
        match self.is_scarce(workers, now) {
            true => own.max((self.worth + self.queue).min(MOST)),
            false => own,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    /// The price after views of .1 s at a rate, for ten seconds.
    fn after(per_sec: f64) -> (TimePrice, Uptime) {
        let mut price = TimePrice::default();
        (0..(10.0 * per_sec) as u32).for_each(|i| price.ask(0.1, at(f64::from(i) / per_sec)));
        (price, at(10.0))
    }

    #[test]
    fn the_load_is_what_views_from_triangles_would_take() {
        let (price, now) = after(60.0);
        assert!((price.load(2.0, now) - 3.0).abs() < 0.2, "{}", price.load(2.0, now));
        assert!(price.is_scarce(2.0, now) && !price.is_scarce(20.0, now));
        assert!(!price.is_scarce(2.0, at(30.0)), "demand fades when viewers leave");
    }

    #[test]
    fn below_the_load_that_is_scarce_time_is_worth_what_the_preset_says() {
        let (mut price, now) = after(5.0);
        price.follow(10.0, 5.0, 2.0, now);
        for (preset, worth) in [(Preset::Exact, 0.0), (Preset::Balanced, 0.01), (Preset::Interactive, 0.05)] {
            assert_eq!(price.of_view(Some(preset), 0.1, 2.0, now), worth / 0.1);
        }
        assert_eq!((price.of_queue(), price.of_view(None, 0.0, 2.0, now)), (0.0, 0.0));
    }

    #[test]
    fn a_queue_raises_the_price_at_once_and_the_worth_of_a_purchase_within_a_second() {
        let (mut price, now) = after(60.0);
        price.follow(FREE_WAIT + WAIT_OF_ONE * 0.1, 0.0, 2.0, now);
        assert!((price.of_queue() - 1.0).abs() < 1e-9);
        let mut price = TimePrice { worth_at: now, ..price };
        price.follow(0.0, 3.0, 2.0, at(10.1));
        assert!(price.worth() < 0.4);
        (0..40).for_each(|i| price.follow(0.0, 3.0, 0.1, at(10.1 + 0.1 * f64::from(i))));
        assert!((price.worth() - 3.0).abs() < 0.2);
    }

    #[test]
    fn the_price_is_bounded_and_nonsense_counts_nothing() {
        let (mut price, now) = after(60.0);
        price.follow(1e9, 1e9, 2.0, now);
        assert_eq!(price.of_view(None, 0.1, 2.0, now), MOST);
        let mut price = TimePrice::default();
        [f64::NAN, -1.0, 0.0, f64::INFINITY].into_iter().for_each(|secs| price.ask(secs, at(0.0)));
        assert_eq!(price, TimePrice::default());
    }
}
