//! The balance formula K_fd: how many of P processes render samples, and how long a tick then takes.
//!
//! # The model
//!
//! Two stages run side by side. K processes *sample*: per tick they render S samples of the scene at g
//! seconds each, D direct views at g_direct, and R single rays at g_ray, so that all of sampling is
//!
//! ```text
//! a = S·g + D·g_direct + R·g_ray      seconds of one process per tick
//! ```
//!
//! P − K processes *composite*: V views at c seconds each, b = V·c. Direct views whose request leaves the way open
//! are answered by any process, and count here as well: b = V·c + D_open·g_open, where g_open is the cheapest way within a
//! view's bound. What is rendered in less detail, since there is no time, counts in full: the demand is what views ask for, not
//! what they get. Both kinds of work divide freely
//! among the processes of their stage. The next tick's samples are rendered while this tick's views are composed, so
//! a tick takes as long as the slower stage (the cluster paper's eq. 2 with a = S·g, b = V·c):
//!
//! ```text
//! T(K) = max(a / K, b / (P − K)),   1 ≤ K ≤ P − 1
//! ```
//!
//! # The best whole K
//!
//! a/K falls and b/(P−K) rises with K. Going from K − 1 to K pays, or at least costs nothing, exactly if the
//! sampling stage before is no faster than the compositing stage after:
//!
//! ```text
//! T(K) ≤ T(K−1)  ⇔  b/(P−K) ≤ a/(K−1)  ⇔  b·(K−1) ≤ a·(P−K)  ⇔  K ≤ (a·P + b) / (a + b)
//! ```
//!
//! (⇒: were b/(P−K) > a/(K−1), then T(K) ≥ b/(P−K), which exceeds both a/(K−1) and b/(P−K+1), the two terms
//! of T(K−1). ⇐: both terms of T(K) are then at most a/(K−1) ≤ T(K−1).) The right-hand side does not depend
//! on K, so the steps that pay come first and the last of them is the minimum:
//!
//! ```text
//! K_fd = floor((a·P + b) / (a + b)), clamped to 1..P−1       (eq. 3)
//! ```
//!
//! The clamp keeps both stages staffed: with b = 0 the quotient is P, with a = 0 it is 1. If the quotient is a whole
//! number, T(K) = T(K−1), so a rounding error that lowers K costs nothing.
//!
//! # What it cannot do
//!
//! With whole K, one stage waits. The processes do a + b seconds of work in P·T(K) seconds, so efficiency is at most
//! (a + b) / (P·T(K_fd)) ([`efficiency_bound`]): 0.91 for one idle sampler of eleven processes.
//!
//! # Samplers that compose
//!
//! A sampler that has rendered its samples may compose until the next ones are due. All processes are then busy as
//! long as sampling fits, and a tick takes max(a/K, (a + b)/P): every K that sampling fits into is as good. But
//! composing beside sampling is slower, since batches are small, and a sample waits for the batch in work. It counts
//! as [`HELPING`] of a compositor's pace: a tick's views are composed in (P − K)·T + h·(K·T − a) = b, so
//!
//! ```text
//! T(K) = max(a / K, (b + h·a) / (P − K + h·K))
//! ```
//!
//! The first term falls with K and the second rises, so the best K is one of the two whole numbers around the point
//! where they meet, K = a·P / (a + b) ([`helping_samplers`]).
//!
//! # Where the formula is off
//!
//! * P = 0: no process; P = 1: one process plays both roles and a tick takes a + b.
//! * Only direct views (S = R = V = 0 < D): compositors would be idle, so all P render directly
//!   ([`Split::AllDirect`]). This is also the fair baseline of every comparison.
//! * No work at all: K = 1, the fewest processes that need the triangles.
//! * A cost or demand that is NaN, infinite or negative was not measured, and counts as zero.

use serde::Serialize;

/// Demand per tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Demand {
    /// S: samples to render.
    pub samples: f64,
    /// D: views to render from the triangles.
    pub direct: f64,
    /// R: single rays.
    pub rays: f64,
    /// V: views to reconstruct.
    pub views: f64,
    /// Views from triangles that any process answers: those whose request leaves the way open.
    pub direct_anywhere: f64,
    /// Their seconds by the cheapest ways within their bounds; 0 if unknown, and then each counts as a direct view.
    pub anywhere_secs: f64,
}

/// Costs, seconds of one process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Costs {
    /// g: a sample.
    pub sample_secs: f64,
    /// g_direct: a direct view.
    pub direct_secs: f64,
    /// g_ray: a single ray.
    pub ray_secs: f64,
    /// c: a reconstructed view.
    pub view_secs: f64,
}

/// Work of the two stages, seconds of one process per tick; finite and not negative.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Load {
    /// a: samples, direct views, single rays.
    pub sampling_secs: f64,
    /// b: reconstructed views.
    pub compositing_secs: f64,
}

/// A division of P processes between the roles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// There is no process.
    NoWorkers,
    /// The only process plays both roles.
    Alone,
    /// All render directly; no process composites.
    AllDirect,
    /// This many samplers, at least one; the other processes composite, at least one.
    Divided(u32),
}

/// A measured number; zero if it was not measured.
fn measured(x: f64) -> f64 {
    if x > 0.0 && x.is_finite() { x } else { 0.0 }
}

impl Load {
    /// The work of a demand at the given costs.
    pub fn of(demand: &Demand, costs: &Costs) -> Self {
        let work = |count: f64, secs: f64| measured(measured(count) * measured(secs));
        let samples = work(demand.samples, costs.sample_secs);
        let direct = work(demand.direct, costs.direct_secs);
        let rays = work(demand.rays, costs.ray_secs);
        let anywhere = match measured(demand.anywhere_secs) {
            0.0 => work(demand.direct_anywhere, costs.direct_secs),
            secs => secs,
        };
        Self {
            sampling_secs: measured(samples + direct + rays),
            compositing_secs: measured(work(demand.views, costs.view_secs) + anywhere),
        }
    }
}

/// K_fd: the number of samplers among `processes`. 0 of 0, 1 of 1 (which composites as well), else 1..P−1.
pub fn samplers(load: Load, processes: u32) -> u32 {
    if processes < 2 {
        return processes;
    }
    let (a, b) = (measured(load.sampling_secs), measured(load.compositing_secs));
    // Only the ratio matters; dividing by the larger keeps a·P from overflowing.
    let larger = a.max(b);
    if !(larger > 0.0) {
        return 1;
    }
    let (a, b) = (a / larger, b / larger);
    let k = ((a * f64::from(processes) + b) / (a + b)).floor();
    (k as u32).clamp(1, processes - 1)
}

/// Pace of a sampler that composes in spare time, relative to a compositor.
pub const HELPING: f64 = 0.9;

/// The number of samplers among `processes` if samplers compose in spare time. 0 of 0, 1 of 1, else 1..P−1.
pub fn helping_samplers(load: Load, processes: u32) -> u32 {
    if processes < 2 {
        return processes;
    }
    let (a, b) = (measured(load.sampling_secs), measured(load.compositing_secs));
    let larger = a.max(b);
    if !(larger > 0.0) {
        return 1;
    }
    let meeting = (a / larger) * f64::from(processes) / (a / larger + b / larger);
    let within = |k: f64| (k as u32).clamp(1, processes - 1);
    let (below, above) = (within(meeting.floor()), within(meeting.ceil()));
    let tick = |k| helping_tick_secs(load, processes, Split::Divided(k));
    if tick(above) < tick(below) { above } else { below }
}

/// Seconds of a tick under a split, if samplers compose in spare time.
pub fn helping_tick_secs(load: Load, processes: u32, split: Split) -> f64 {
    let Split::Divided(k) = split else { return tick_secs(load, processes, split) };
    let (a, b) = (measured(load.sampling_secs), measured(load.compositing_secs));
    let k = f64::from(k.clamp(1, processes.max(1)));
    let pace = f64::from(processes) - k + HELPING * k;
    (a / k).max(b / pace + HELPING * a / pace)
}

/// The best split of `processes` for a demand.
pub fn split(demand: &Demand, costs: &Costs, processes: u32) -> Split {
    let others = [demand.samples, demand.rays, demand.views, demand.direct_anywhere];
    let only_direct = others.iter().all(|&n| measured(n) == 0.0);
    match processes {
        0 => Split::NoWorkers,
        1 => Split::Alone,
        _ if only_direct && measured(demand.direct) > 0.0 => Split::AllDirect,
        _ => Split::Divided(samplers(Load::of(demand, costs), processes)),
    }
}

/// Seconds of a tick under a split; infinite if a stage has work and no process.
pub fn tick_secs(load: Load, processes: u32, split: Split) -> f64 {
    let (a, b) = (measured(load.sampling_secs), measured(load.compositing_secs));
    let stage = |work: f64, count: u32| match (work > 0.0, count) {
        (false, _) => 0.0,
        (true, 0) => f64::INFINITY,
        (true, n) => work / f64::from(n),
    };
    match split {
        Split::NoWorkers => stage(a + b, 0),
        Split::Alone => a + b,
        Split::AllDirect => stage(a, processes).max(stage(b, 0)),
        Split::Divided(k) => stage(a, k.min(processes)).max(stage(b, processes.saturating_sub(k))),
    }
}

/// The greatest efficiency with whole K: work over process time, (a + b) / (P·T(K_fd)). 1 without work, 0 without
/// processes.
pub fn efficiency_bound(load: Load, processes: u32) -> f64 {
    let (a, b) = (measured(load.sampling_secs), measured(load.compositing_secs));
    if processes == 0 {
        return 0.0;
    }
    let split = if processes == 1 { Split::Alone } else { Split::Divided(samplers(load, processes)) };
    let tick = tick_secs(load, processes, split);
    if tick > 0.0 { (a / tick + b / tick) / f64::from(processes) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn load(a: f64, b: f64) -> Load {
        Load { sampling_secs: a, compositing_secs: b }
    }

    /// Tries every K.
    fn brute_force_tick(load: Load, processes: u32) -> f64 {
        (1..processes).map(|k| tick_secs(load, processes, Split::Divided(k))).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn no_whole_k_is_faster_than_k_fd(
            samples in 0u32..200, g in 1e-6f64..10.0, views in 0u32..100_000, c in 1e-7f64..1.0, p in 2u32..200,
        ) {
            let demand = Demand { samples: samples.into(), views: views.into(), ..Demand::default() };
            let costs = Costs { sample_secs: g, view_secs: c, ..Costs::default() };
            let load = Load::of(&demand, &costs);
            let k = samplers(load, p);
            prop_assert!((1..p).contains(&k));
            // Ties round either way. Both sides take the same time except for the last bits.
            let tick = tick_secs(load, p, Split::Divided(k));
            prop_assert!(tick <= brute_force_tick(load, p) * (1.0 + 1e-12), "K = {k}: {tick}");
        }

        #[test]
        fn both_sides_of_an_exact_tie_are_equally_fast(k in 2u32..50, rest in 1u32..50, unit in 1e-9f64..1e9) {
            // a·(P − K) = b·(K − 1): the quotient of eq. 3 is the whole number K.
            let p = k + rest;
            let load = load(f64::from(k - 1) * unit, f64::from(rest) * unit);
            let chosen = samplers(load, p);
            prop_assert!(chosen == k || chosen == k - 1);
            let tick = tick_secs(load, p, Split::Divided(chosen));
            prop_assert!(tick <= brute_force_tick(load, p) * (1.0 + 1e-12));
        }

        #[test]
        fn any_numbers_give_a_valid_split(a: f64, b: f64, p in 0u32..100) {
            let k = samplers(load(a, b), p);
            match p {
                0 | 1 => prop_assert_eq!(k, p),
                _ => prop_assert!((1..p).contains(&k)),
            }
            let bound = efficiency_bound(load(a, b), p);
            prop_assert!((0.0..=1.0 + 1e-12).contains(&bound), "{bound}");
        }

        #[test]
        fn no_whole_k_is_faster_than_the_one_for_samplers_that_compose(
            a in 0.0f64..10.0, b in 0.0f64..10.0, p in 2u32..300,
        ) {
            let (load, k) = (load(a, b), helping_samplers(load(a, b), p));
            let tick = |k| helping_tick_secs(load, p, Split::Divided(k));
            let best = (1..p).map(tick).fold(f64::INFINITY, f64::min);
            prop_assert!((1..p).contains(&k) && tick(k) <= best * (1.0 + 1e-12), "K = {k}: {} {best}", tick(k));
            // No K is faster than all processes being always busy.
            prop_assert!(tick(k) * f64::from(p) >= (a + b) * (1.0 - 1e-12));
        }

        #[test]
        fn more_views_never_call_for_more_samplers(a in 0.0f64..10.0, b in 0.0f64..10.0, p in 2u32..64) {
            prop_assert!(samplers(load(a, b * 2.0), p) <= samplers(load(a, b), p));
        }
    }

    fn costs() -> Costs {
        Costs { sample_secs: 0.1, direct_secs: 0.08, ray_secs: 1e-6, view_secs: 0.002 }
    }

    #[test]
    fn the_papers_cluster_of_eleven_samples_on_one() {
        // Four samples of 9 ms and 1000 views of 1 ms on 11 GPUs: table 1 has one GPU for sampling.
        let load = load(0.036, 1.0);
        assert_eq!(samplers(load, 11), 1);
        assert!((tick_secs(load, 11, Split::Divided(1)) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn one_idle_sampler_of_eleven_bounds_efficiency_at_ten_elevenths() {
        assert!((efficiency_bound(load(0.0, 1.0), 11) - 10.0 / 11.0).abs() < 1e-12);
        assert_eq!(efficiency_bound(load(1.0, 1.0), 2), 1.0);
        assert_eq!(efficiency_bound(load(0.3, 0.7), 1), 1.0);
        assert_eq!(efficiency_bound(load(0.0, 0.0), 4), 1.0);
        assert_eq!(efficiency_bound(load(1.0, 1.0), 0), 0.0);
    }

    #[test]
    fn without_views_all_processes_but_one_sample() {
        let demand = Demand { samples: 4.0, ..Demand::default() };
        assert_eq!(split(&demand, &costs(), 5), Split::Divided(4));
    }

    #[test]
    fn without_samples_one_process_samples() {
        let demand = Demand { views: 100.0, ..Demand::default() };
        assert_eq!(split(&demand, &costs(), 5), Split::Divided(1));
    }

    #[test]
    fn without_any_work_one_process_samples() {
        assert_eq!(split(&Demand::default(), &costs(), 5), Split::Divided(1));
        assert_eq!(tick_secs(load(0.0, 0.0), 5, Split::Divided(1)), 0.0);
    }

    #[test]
    fn a_single_process_plays_both_roles() {
        let demand = Demand { samples: 4.0, views: 10.0, ..Demand::default() };
        assert_eq!(split(&demand, &costs(), 1), Split::Alone);
        assert_eq!(split(&demand, &costs(), 0), Split::NoWorkers);
        assert!((tick_secs(Load::of(&demand, &costs()), 1, Split::Alone) - 0.42).abs() < 1e-12);
        assert_eq!(tick_secs(load(1.0, 0.0), 0, Split::NoWorkers), f64::INFINITY);
    }

    #[test]
    fn direct_views_alone_turn_every_process_to_rendering() {
        let demand = Demand { direct: 3.0, ..Demand::default() };
        assert_eq!(split(&demand, &costs(), 4), Split::AllDirect);
        let load = Load::of(&demand, &costs());
        assert!((tick_secs(load, 4, Split::AllDirect) - 0.06).abs() < 1e-12);
        let mixed = Demand { views: 1.0, ..demand };
        assert!(matches!(split(&mixed, &costs(), 4), Split::Divided(_)));
        assert_eq!(tick_secs(Load::of(&mixed, &costs()), 4, Split::AllDirect), f64::INFINITY);
    }

    #[test]
    fn costs_that_were_not_measured_count_as_zero() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, -0.0] {
            let demand = Demand { samples: 4.0, views: 100.0, ..Demand::default() };
            let unknown_g = Costs { sample_secs: bad, ..costs() };
            assert_eq!(split(&demand, &unknown_g, 6), Split::Divided(1), "g = {bad}");
            let unknown_c = Costs { view_secs: bad, ..costs() };
            assert_eq!(split(&demand, &unknown_c, 6), Split::Divided(5), "c = {bad}");
            let strange = Demand {
                samples: bad,
                views: bad,
                rays: bad,
                direct: bad,
                direct_anywhere: bad,
                anywhere_secs: bad,
            };
            assert_eq!(Load::of(&strange, &costs()), Load::default(), "demand {bad}");
            assert_eq!(samplers(load(bad, bad), 6), 1);
        }
    }

    #[test]
    fn the_largest_numbers_do_not_overflow() {
        assert_eq!(samplers(load(f64::MAX, f64::MAX), 4), 2);
        assert_eq!(samplers(load(f64::MAX, 1.0), 4), 3);
        assert_eq!(samplers(load(1e-300, 1e-300), 4), 2);
        let demand = Demand { samples: f64::MAX, views: 1.0, ..Demand::default() };
        let costs = Costs { sample_secs: f64::MAX, ..costs() };
        assert!(Load::of(&demand, &costs).sampling_secs.is_finite());
    }
}
