//! How much time a view may take, by what is asked of the cluster.
//!
//! Demand is counted in milliseconds of one process: each view that leaves the way open as its cheapest way within its error bound,
//! all others as they are. While all of it fits into the time that the processes have, every view gets the way that it is worth. Beyond,
//! a view gets its share of the time that there is, so that what is asked is carried and no queue grows. Ways take the times that they
//! take: what one view leaves of its share is another's.

use crate::core::time::Uptime;

/// Least time over which demand is averaged, milliseconds. A crowd that arrives is noticed sooner, by its queue.
const AVERAGE_MS: f64 = 2000.0;

/// Views over whose time demand is averaged at least: a few large views are no crowd.
const AVERAGE_VIEWS: f64 = 4.0;

/// Part of the processes' time that views may ask for, at first. More, and views would wait for one another longer than they are
/// rendered. How much more or less it is depends on what else the machine does and on how exact prices are, so it follows the queue.
const CARRIED: f64 = 0.6;

/// Least and most of that part.
const LEAST_CARRIED: f64 = 0.3;
const MOST_CARRIED: f64 = 0.9;

/// The queue that it follows, per process: milliseconds, or views where these take longer.
const QUEUE_MS: f64 = 80.0;
const QUEUE_VIEWS: f64 = 1.2;

/// Change of that part in a second in which the queue is empty, or at least twice as long.
const CHANGE_A_SECOND: f64 = 0.15;

/// Milliseconds in which a queue shall be worked off, and the least number of views that may wait.
const DRAIN_MS: f64 = 200.0;
const DRAIN_VIEWS: f64 = 3.0;

/// Milliseconds asked for in a millisecond, averaged over the last seconds.
#[derive(Debug, Clone, Copy)]
struct Rate {
    per_ms: f64,
    at: Uptime,
    /// Milliseconds in which it fades to a third.
    average_ms: f64,
}

impl Default for Rate {
    fn default() -> Self {
        Self { per_ms: 0.0, at: Uptime::default(), average_ms: AVERAGE_MS }
    }
}

impl Rate {
    /// The rate at a time. It fades while nothing is asked.
    fn at(&self, now: Uptime) -> f64 {
        self.per_ms * (-now.since(self.at).as_secs_f64() * 1e3 / self.average_ms).exp()
    }

    fn add(&mut self, ms: f64, now: Uptime) {
        let before = self.at(now);
        self.average_ms = AVERAGE_MS.max(AVERAGE_VIEWS * ms);
        (self.per_ms, self.at) = (before + ms.max(0.0) / self.average_ms, now);
    }
}

/// What the cluster has to do, and who does it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Work {
    /// Milliseconds of one process for the views that wait or are in work.
    pub(super) queued_ms: f64,
    /// Workers that answer views, in those that would take as long as predicted: two that take twice as long are one.
    pub(super) processes: f64,
}

/// What is asked of the cluster.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// Of views that leave the way open, by the cheapest ways within their bounds.
    open: Rate,
    /// Of the same views, by the cheapest ways of all.
    least: Rate,
    /// Of views that name their plan.
    fixed: Rate,
    /// Milliseconds that views left of their shares; negative where they took more.
    left_ms: f64,
    /// Part of the processes' time that views may ask for.
    carried: f64,
    /// When that part followed the queue.
    followed: Uptime,
}

impl Default for Load {
    fn default() -> Self {
        let (open, least, fixed) = (Rate::default(), Rate::default(), Rate::default());
        Self { open, least, fixed, left_ms: 0.0, carried: CARRIED, followed: Uptime::default() }
    }
}

impl Load {
    /// Counts a view that leaves the way open, by the milliseconds of its cheapest way within its bound, and of the cheapest of all.
    pub(super) fn asks_openly(&mut self, ms: f64, least_ms: f64, now: Uptime) {
        self.open.add(ms, now);
        self.least.add(least_ms, now);
    }

    /// Counts what an open view, which might take `most_ms`, took.
    pub(super) fn took(&mut self, ms: f64, most_ms: f64) {
        // Nothing is saved up while all is carried, and no more than one view leaves.
        let share_ms = most_ms - self.left_ms;
        self.left_ms = if most_ms.is_finite() { (most_ms - ms).clamp(-share_ms, share_ms) } else { 0.0 };
    }

    /// Counts a view that names its plan, by its milliseconds.
    pub(super) fn asks(&mut self, ms: f64, now: Uptime) {
        self.fixed.add(ms, now);
    }

    /// The milliseconds that a view may take whose cheapest way within its bound takes `ms`; infinite while all that is asked
    /// is carried.
    pub(super) fn most_ms(&self, ms: f64, Work { queued_ms, processes }: Work, now: Uptime) -> f64 {
        let there_is = self.there_is(processes, now);
        let asked = self.open.at(now) + queued_ms / DRAIN_MS.max(DRAIN_VIEWS * ms);
        // Where nothing is asked and no process is there, all that is asked is carried.
        if asked > there_is { ms * (there_is / asked).max(0.0) + self.left_ms } else { f64::INFINITY }
    }

    /// Processes that are asked for by views, each by the cheapest way within its bound.
    pub(super) fn asked(&self, now: Uptime) -> f64 {
        self.open.at(now) + self.fixed.at(now)
    }

    /// Processes that open views lack, since all that is asked is more than is carried; 0 if it is carried.
    pub(super) fn lacking(&self, processes: f64, now: Uptime) -> f64 {
        (self.open.at(now) - self.there_is(processes, now).max(0.0)).max(0.0)
    }

    /// Whether this many workers carry all views by their cheapest ways, however large the errors.
    pub(super) fn is_carried_somehow(&self, processes: f64, now: Uptime) -> bool {
        self.least.at(now) <= MOST_CARRIED * processes - self.fixed.at(now)
    }

    /// Processes that there are for open views.
    fn there_is(&self, processes: f64, now: Uptime) -> f64 {
        self.carried * processes - self.fixed.at(now)
    }

    /// Follows the queue when a view is planned that takes `ms` and might take `most_ms`: while not all that is asked is carried,
    /// more is while the queue is short, and less while it is long.
    pub(super) fn follow(&mut self, (ms, most_ms): (f64, f64), work: Work, now: Uptime) {
        let secs = now.since(self.followed).as_secs_f64().min(1.0);
        self.followed = now;
        let queue = work.queued_ms / work.processes.max(1.0) / QUEUE_MS.max(QUEUE_VIEWS * ms);
        let rises =
            if most_ms.is_finite() { 1.0 - queue } else { (CARRIED - self.carried) / CHANGE_A_SECOND };
        let carried = self.carried + CHANGE_A_SECOND * secs * rises.clamp(-1.0, 1.0);
        self.carried = carried.clamp(LEAST_CARRIED, MOST_CARRIED);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn secs(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    fn work(queued_ms: f64, processes: usize) -> Work {
        Work { queued_ms, processes: processes as f64 }
    }

    /// The load after views of some milliseconds at some rate, for ten seconds.
    fn after(ms: f64, per_sec: f64) -> (Load, Uptime) {
        let mut load = Load::default();
        let count = (10.0 * per_sec) as u32;
        (0..count).for_each(|i| load.asks_openly(ms, ms, secs(f64::from(i) / per_sec)));
        (load, secs(10.0))
    }

    #[test]
    fn slow_viewers_have_all_the_time() {
        let (load, now) = after(150.0, 2.0);
        assert_eq!(load.most_ms(150.0, work(0.0, 2), now), f64::INFINITY);
        assert_eq!(load.most_ms(150.0, work(150.0, 2), now), f64::INFINITY, "one waits");
        assert_eq!(
            Load::default().most_ms(150.0, work(0.0, 0), now),
            f64::INFINITY,
            "without views, no worker is needed"
        );
    }

    #[test]
    fn two_views_that_take_long_are_no_crowd() {
        let (load, now) = after(5000.0, 0.2);
        assert_eq!(load.most_ms(5000.0, work(5000.0, 2), now), f64::INFINITY);
    }

    #[test]
    fn under_load_the_times_of_all_views_are_what_the_processes_have() {
        for times in [2.0, 4.0, 16.0] {
            let (load, now) = after(100.0, times * 20.0);
            let all = load.most_ms(100.0, work(0.0, 2), now) * times * 20.0;
            assert!((all / (CARRIED * 2000.0) - 1.0).abs() < 0.1, "{times}: {all}");
        }
    }

    #[test]
    fn a_queue_leaves_less_time_before_the_average_has_risen() {
        let mut load = Load::default();
        load.asks_openly(150.0, 150.0, secs(0.0));
        assert!(load.most_ms(150.0, work(1500.0, 2), secs(0.1)) < 75.0);
    }

    #[test]
    fn views_that_name_their_plan_leave_less() {
        let (mut load, now) = after(100.0, 20.0);
        let alone = load.most_ms(100.0, work(0.0, 2), now);
        (0..200).for_each(|i| load.asks(50.0, secs(f64::from(i) / 20.0)));
        assert!(load.most_ms(100.0, work(0.0, 2), now) < 0.5 * alone);
        (0..2000).for_each(|_| load.asks(50.0, now));
        assert_eq!(load.most_ms(100.0, work(0.0, 2), now), 0.0, "nothing is left");
    }

    #[test]
    fn what_views_leave_of_their_shares_others_take() {
        let (mut load, now) = after(100.0, 80.0);
        let share = load.most_ms(100.0, work(0.0, 2), now);
        // Ways that take more than the share and less.
        let ways = [0.7 * share, 1.4 * share];
        let mut taken = 0.0;
        for _ in 0..100 {
            let most = load.most_ms(100.0, work(0.0, 2), now);
            let took = ways.into_iter().filter(|way| *way <= most).fold(ways[0], f64::max);
            load.took(took, most);
            taken += took;
        }
        assert!((taken / (100.0 * share) - 1.0).abs() < 0.02, "{taken} of {share}");
        load.took(0.0, f64::INFINITY);
        assert_eq!(load.most_ms(100.0, work(0.0, 2), now), share, "nothing is saved up while all is carried");
    }

    #[test]
    fn what_is_lacking_is_what_is_asked_beyond_what_is_carried() {
        let (load, now) = after(100.0, 80.0);
        assert!((load.lacking(2.0, now) - (8.0 - CARRIED * 2.0)).abs() < 0.5, "{}", load.lacking(2.0, now));
        assert!((load.asked(now) - 8.0).abs() < 0.5);
        assert_eq!(load.lacking(20.0, now), 0.0);
        assert!(load.lacking(0.0, now) > 7.0, "without workers, all is lacking");
    }

    #[test]
    fn more_is_carried_while_the_queue_is_short_and_less_while_it_is_long() {
        let after = |queued_ms: f64, view_ms: f64| {
            let mut load = Load::default();
            let views = |load: &mut Load, most_ms: f64, from: f64| {
                (0..1000).for_each(|i| {
                    load.follow((view_ms, most_ms), work(queued_ms, 2), secs(from + f64::from(i) * 0.05));
                });
            };
            views(&mut load, view_ms, 0.0);
            let carried = load.carried;
            views(&mut load, f64::INFINITY, 50.0);
            assert!((load.carried - CARRIED).abs() < 1e-6, "{} once all is carried", load.carried);
            carried
        };
        assert_eq!(after(0.0, 10.0), MOST_CARRIED);
        assert_eq!(after(400.0, 10.0), LEAST_CARRIED);
        assert_eq!(after(160.0, 10.0), CARRIED);
        assert_eq!(after(400.0, 1000.0), MOST_CARRIED, "less than a view a worker");
        assert_eq!(after(f64::INFINITY, 10.0), LEAST_CARRIED);
        let mut pause = Load::default();
        pause.follow((10.0, 10.0), work(0.0, 2), secs(1e6));
        assert!(pause.carried <= CARRIED + CHANGE_A_SECOND, "nothing is learnt from a pause");
    }

    #[test]
    fn views_may_be_carried_by_their_cheapest_ways_alone() {
        let mut load = Load::default();
        (0..800).for_each(|i| load.asks_openly(100.0, 10.0, secs(f64::from(i) / 80.0)));
        let now = secs(10.0);
        assert!(load.lacking(2.0, now) > 5.0);
        assert!(load.is_carried_somehow(1.0, now) && !load.is_carried_somehow(0.5, now));
        assert!(Load::default().is_carried_somehow(0.0, now), "nothing is asked");
    }

    #[test]
    fn demand_fades_when_viewers_leave() {
        let (load, now) = after(100.0, 80.0);
        assert!(load.most_ms(100.0, work(0.0, 2), now) < 30.0);
        assert_eq!(load.most_ms(100.0, work(0.0, 2), secs(20.0)), f64::INFINITY);
    }
}
