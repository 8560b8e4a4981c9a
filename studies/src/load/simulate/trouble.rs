//! Troubles in clusters of any size: slow processes, lost processes, and demand in waves. Measures what becomes
//! of the views.

use argus_cluster::core::Config;
use rand::seq::index::sample;
use rand::{SeedableRng, rngs::SmallRng};

use super::load::{Clients, somewhere};
use super::world::World;
use super::{Parameters, secs, set_info};

/// The kinds of trouble.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// No trouble: the baseline.
    Nothing,
    /// One process of eight runs at half speed.
    Stragglers,
    /// One process of sixteen is killed, one after another, and does not return.
    Losses,
    /// Demand rises and falls by half of its mean.
    Waves,
}

impl Trouble {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Nothing, Self::Stragglers, Self::Losses, Self::Waves];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nothing => "none",
            Self::Stragglers => "stragglers",
            Self::Losses => "losses",
            Self::Waves => "waves",
        }
    }
}

/// One simulated cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Case {
    /// P, the number of processes.
    pub processes: u32,
    /// Clients that ask in turn.
    pub clients: u64,
    /// The trouble.
    pub trouble: Trouble,
    /// Largest number of views; see [`dearer`].
    pub views: u64,
}

/// The outcome of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// The trouble.
    pub trouble: Trouble,
    /// P, the number of processes at the start.
    pub processes: u32,
    /// Clients that asked in turn.
    pub clients: u64,
    /// K at the end.
    pub samplers: u32,
    /// Views requested.
    pub asked: u64,
    /// Views rejected because of overload.
    pub rejected: u64,
    /// Views that failed or were never answered.
    pub lost: u64,
    /// Views retried on another worker.
    pub retried: u64,
    /// Processes that were killed.
    pub processes_lost: u64,
    /// Median latency in milliseconds.
    pub p50_ms: f64,
    /// 99th percentile of latency in milliseconds.
    pub p99_ms: f64,
    /// Longest latency in milliseconds.
    pub worst_ms: f64,
    /// Real microseconds per view in the core, on this machine.
    pub core_us_per_view: f64,
}

/// Mean load, as a share of what all processes but one can compose.
const LOAD: f64 = 0.6;
/// Amplitude of demand waves as a share of the mean, and number of waves.
const SWELL: f64 = 0.5;
const WAVES: f64 = 4.0;
/// Simulated seconds before the trouble, and during it.
const CALM_SECS: f64 = 2.0;
const TROUBLE_SECS: f64 = 8.0;
/// Longest simulated seconds for open views to be answered at the end.
const END_SECS: f64 = 60.0;

/// The factor on a view's cost that keeps the load with at most [`Case::views`] views. A second of thousands of processes
/// would be millions of views, so a simulated view stands for several.
pub fn dearer(case: &Case, parameters: &Parameters) -> f64 {
    let per_sec = LOAD * 1e3 / parameters.view_ms * f64::from(case.processes - 1);
    (per_sec * (CALM_SECS + TROUBLE_SECS) / case.views as f64).max(1.0)
}

/// The costs with which a case is simulated.
pub fn costs(case: &Case, parameters: &Parameters) -> Parameters {
    let times = dearer(case, parameters);
    let p = parameters;
    Parameters {
        view_ms: p.view_ms * times,
        encode_ms: p.encode_ms * times,
        relay_ms: p.relay_ms * times,
        client_ms: p.client_ms * times,
        frame_bytes: (p.frame_bytes as f64 * times) as u64,
        ..p.clone()
    }
}

/// Simulates one case with at least two processes and the costs of [`costs`]. The scene does not move.
pub fn run(case: &Case, costs: &Parameters) -> Outcome {
    let p = case.processes.max(2) as usize;
    let max_views = 256 * p.max(8);
    // A few clients may request up to the limit of all.
    let config =
        Config { max_views, max_views_per_client: max_views, samplers_composite: true, ..Config::default() };
    let mut world = World::new(config, set_info(false, None), costs.clone(), p);
    (0..p).for_each(|slot| world.start(slot));
    world.run_for(secs(1.0));
    if case.trouble == Trouble::Stragglers {
        (0..p).rev().step_by(8).for_each(|slot| world.workers[slot].slowness = 2.0);
    }
    let speed = world.workers[1..].iter().map(|worker| 1.0 / worker.slowness).sum::<f64>();
    let mean = LOAD * 1e3 / costs.view_ms * speed;
    let swell = if case.trouble == Trouble::Waves { SWELL } else { 0.0 };
    let began = world.now as f64 * 1e-9 + CALM_SECS;
    let turns = WAVES * std::f64::consts::TAU / TROUBLE_SECS;
    let rate = move |now: f64| mean * (1.0 + swell * (turns * (now - began).max(0.0)).sin());
    let (load, stats) = Clients::new(case.clients.max(1), false, rate, |client, _| somewhere(client));
    world.with_load(Box::new(load));
    world.run_for(secs(CALM_SECS));
    let (before, calm) = (world.tally, stats.borrow().latencies_ms.len());

    let killed = match case.trouble {
        Trouble::Losses => sample(&mut SmallRng::seed_from_u64(11), p, (p / 16).max(1)).into_vec(),
        _ => Vec::new(),
    };
    let pause = TROUBLE_SECS / (killed.len() + 1) as f64;
    for slot in &killed {
        world.run_for(secs(pause));
        world.kill(*slot);
    }
    world.run_for(secs(pause));
    world.stop_load();
    world.run_until(secs(END_SECS), |world| world.open_views() == 0);

    let (tally, status) = (world.tally, world.core.status());
    let mut latencies = stats.borrow_mut().latencies_ms.split_off(calm);
    latencies.sort_by(f64::total_cmp);
    let at = |share: f64| latencies.get((latencies.len() as f64 * share) as usize).copied().unwrap_or(0.0);
    let asked = tally.asked - before.asked;
    Outcome {
        trouble: case.trouble,
        processes: p as u32,
        clients: case.clients,
        samplers: status.samplers,
        asked,
        rejected: tally.overloaded,
        lost: tally.failed + world.open_views() as u64,
        retried: status.counts().views_retried,
        processes_lost: killed.len() as u64,
        p50_ms: at(0.5),
        p99_ms: at(0.99),
        worst_ms: latencies.last().copied().unwrap_or(0.0),
        core_us_per_view: (tally.core_secs - before.core_secs) * 1e6 / asked.max(1) as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(processes: u32, trouble: Trouble) -> Outcome {
        let case = Case { processes, clients: 10_000, trouble, views: 5000 };
        let parameters = Parameters { relayed: false, ..Parameters::default() };
        run(&case, &costs(&case, &parameters))
    }

    #[test]
    fn no_trouble_loses_a_view_and_each_has_its_own_effect() {
        for processes in [2, 24] {
            let calm = outcome(processes, Trouble::Nothing);
            for trouble in Trouble::ALL {
                let outcome = outcome(processes, trouble);
                assert_eq!((outcome.lost, outcome.rejected), (0, 0), "{outcome:?}");
                assert!(outcome.asked > 500 && outcome.p99_ms >= outcome.p50_ms, "{outcome:?}");
                let kills = trouble == Trouble::Losses;
                assert_eq!(outcome.processes_lost > 0, kills, "{outcome:?}");
                // A worker that is killed has views in work.
                assert!(kills || outcome.retried == 0, "{outcome:?}");
                if trouble == Trouble::Waves {
                    assert!(outcome.p99_ms > calm.p99_ms, "crests queue: {outcome:?} {calm:?}");
                }
            }
        }
    }

    #[test]
    fn larger_clusters_have_dearer_views_rather_than_more_of_them() {
        let parameters = Parameters::default();
        let case = |processes| Case { processes, clients: 10, trouble: Trouble::Nothing, views: 100_000 };
        assert_eq!(dearer(&case(11), &parameters), 1.0);
        let times = dearer(&case(4096), &parameters);
        let dear = costs(&case(4096), &parameters);
        assert!(times > 100.0 && dear.view_ms == parameters.view_ms * times, "{dear:?}");
        assert_eq!((dear.sample_ms, dear.pack_ms), (parameters.sample_ms, parameters.pack_ms));
    }
}
