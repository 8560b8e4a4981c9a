//! Efficiency: the time of a tick and the load of the processes, measured as in the cluster paper with P processes, V
//! views and S new samples per tick.

use argus_cluster::core::Config;
use argus_cluster::core::balance::{self, Costs, Demand, Load};
use serde::Serialize;
use std::time::Duration;

use super::load::Ticks;
use super::world::World;
use super::{Parameters, secs, set_info};

/// Samples of a tile, which every tick renders anew.
const SAMPLES: f64 = 4.0;

/// One simulated cluster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// P, the number of processes.
    pub processes: u32,
    /// V, views per tick.
    pub views: u64,
    /// Whether samples are rendered anew each tick; otherwise the scene does not move.
    pub refreshed: bool,
    /// Whether all views are rendered from triangles.
    pub direct: bool,
    /// Whether samplers also compose in their spare time.
    pub helping: bool,
    /// Measured ticks.
    pub ticks: usize,
    /// Simulated seconds without role changes before measuring; [`SETTLED_SECS`] for an outcome that does not depend on it.
    pub settled_secs: f64,
}

/// The outcome of a case.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Outcome {
    /// K, the number of samplers while measuring.
    pub samplers: u32,
    /// K_fd for the given costs.
    pub samplers_wanted: u32,
    /// max(a/K, b/(P − K)) for the measured K.
    pub predicted_secs: f64,
    /// Seconds from one tick's last frame to the next one's.
    pub tick_secs: f64,
    /// Efficiency (a + b) / (P·T).
    pub efficiency: f64,
    /// The efficiency bound for whole K.
    pub bound: f64,
    /// Real microseconds per view in the core, on this machine.
    pub core_us_per_view: f64,
    /// Views rejected because no worker could take them in time.
    pub rejected: u64,
    /// Role changes while measuring.
    pub roles_changed: u64,
}

/// Longest simulated time to settle, in seconds.
const SETTLING_SECS: f64 = 240.0;
/// Seconds without role changes after which the split has settled. The core remembers a change for less time than
/// this, and until then it waits before small gains.
pub(crate) const SETTLED_SECS: f64 = 85.0;
/// From this many processes on, the split first settles under a part of the load: the stages' ratio is the same with
/// fewer events. Workers with little to do keep their role, so it then settles again under the full load.
const MANY: u32 = 48;
/// From this many processes on it does not settle again: a dozen samplers too many are not worth a change.
const TOO_MANY: u32 = 200;

/// The load of one tick, in seconds of work.
pub fn load_of(case: &Case, parameters: &Parameters) -> Load {
    let views = case.views as f64;
    let demand = match case.direct {
        true => Demand { direct: views, ..Demand::default() },
        false => {
            let samples = if case.refreshed { SAMPLES } else { 0.0 };
            Demand { samples, views, ..Demand::default() }
        }
    };
    let [sample_secs, direct_secs, view_secs] = parameters.wall_ms(case.processes).map(|ms| ms * 1e-3);
    let costs = Costs { sample_secs, direct_secs, view_secs, ..Costs::default() };
    Load::of(&demand, &costs)
}

/// Simulates one case.
pub fn run(case: &Case, parameters: &Parameters) -> Outcome {
    let p = case.processes as usize;
    let config = Config {
        max_views: 256 * p.max(8),
        max_wait: Duration::from_secs(86_400),
        patience: Duration::from_secs(86_400),
        samplers_composite: case.helping,
        // A third of the default, so that the split settles in a third of the time.
        dwell: Duration::from_secs(1),
        refining_share: 0.0,
        refresh_views: if case.refreshed { case.views } else { 0 },
        epoch: Duration::from_millis(25),
        ..Config::default()
    };
    let in_flight = (config.max_views_per_worker * p).min(2 * case.views as usize).max(1);
    let mut world = World::new(config, set_info(case.refreshed, None), parameters.clone(), p);
    (0..p).for_each(|slot| world.start(slot));
    world.run_for(secs(1.0));
    let few = if case.processes >= MANY { (p / 8).min(in_flight) } else { in_flight };
    let (ticks, progress) = Ticks::new(case.views, few, case.direct, case.refreshed);
    let wanted = ticks.in_flight();
    world.with_load(Box::new(ticks));
    settle(&mut world, case.settled_secs);
    wanted.set(in_flight);
    if (MANY..TOO_MANY).contains(&case.processes) {
        settle(&mut world, case.settled_secs);
    }
    // Two ticks until the pipeline is full.
    let from = progress.borrow().ticks.len() + 2;
    let changed = |world: &World| world.core.status().counts().roles_changed;
    let before = (changed(&world), world.tally);
    let ended = |_: &World| progress.borrow().ticks.len() > from + case.ticks;
    world.run_until(secs(3600.0), ended);
    let progress = progress.borrow();
    let last = progress.ticks.len() - 1;
    let tick_secs = (progress.ticks[last] - progress.ticks[from]) as f64 * 1e-9 / (last - from).max(1) as f64;
    let load = load_of(case, parameters);
    let (a, b) = (load.sampling_secs, load.compositing_secs);
    let status = world.core.status();
    let split = match case.direct {
        true => {
            balance::split(&Demand { direct: 1.0, ..Demand::default() }, &Costs::default(), case.processes)
        }
        false if case.processes < 2 => balance::Split::Alone,
        false => balance::Split::Divided(status.samplers),
    };
    let predicted_secs = match case.helping {
        true => balance::helping_tick_secs(load, case.processes, split),
        false => balance::tick_secs(load, case.processes, split),
    };
    let views = world.tally.answered - before.1.answered;
    // The baseline's efficiency counts the same work: the cost of its views from samples.
    let serial = load_of(&Case { direct: false, ..*case }, parameters);
    let work = if case.direct { serial.sampling_secs + serial.compositing_secs } else { a + b };
    Outcome {
        samplers: status.samplers,
        samplers_wanted: match case.helping {
            true => balance::helping_samplers(load, case.processes),
            false => balance::samplers(load, case.processes),
        },
        predicted_secs,
        tick_secs,
        efficiency: work / (f64::from(case.processes) * tick_secs),
        bound: if case.helping { 1.0 } else { balance::efficiency_bound(load, case.processes) },
        core_us_per_view: (world.tally.core_secs - before.1.core_secs) * 1e6 / views.max(1) as f64,
        rejected: world.tally.overloaded + world.tally.failed,
        roles_changed: changed(&world) - before.0,
    }
}

/// Runs until roles have not changed for some seconds.
fn settle(world: &mut World, settled_secs: f64) {
    let mut changed = world.core.status().counts().roles_changed;
    let mut quiet = 0.0;
    let mut passed = 0.0;
    while quiet < settled_secs && passed < SETTLING_SECS {
        world.run_for(secs(0.5));
        passed += 0.5;
        quiet += 0.5;
        let now = world.core.status().counts().roles_changed;
        if now != changed {
            (changed, quiet) = (now, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::simulate::Machines;

    fn case(processes: u32, views: u64) -> Case {
        Case {
            processes,
            views,
            refreshed: true,
            direct: false,
            helping: false,
            ticks: 40,
            settled_secs: SETTLED_SECS,
        }
    }

    /// Communication costs far below the paper's g and c, so that the core's decisions show.
    fn ideal() -> Parameters {
        Parameters {
            hold_ms: 0.0,
            encode_ms: 0.1,
            pack_ms: 1.0,
            unpack_ms: 1.0,
            relayed: false,
            ..Parameters::default()
        }
    }

    #[test]
    fn eleven_processes_come_close_to_the_bound_of_whole_k() {
        let outcome = run(&case(11, 1000), &ideal());
        assert_eq!(outcome.samplers, outcome.samplers_wanted, "{outcome:?}");
        assert!(outcome.efficiency >= 0.95 * outcome.bound, "{outcome:?}");
        assert!(
            outcome.efficiency <= outcome.bound * 1.03,
            "nothing is faster than the formula: {outcome:?}"
        );
        assert_eq!((outcome.rejected, outcome.roles_changed), (0, 0), "{outcome:?}");
        assert!((outcome.tick_secs / outcome.predicted_secs - 1.0).abs() < 0.1, "{outcome:?}");
    }

    #[test]
    fn samplers_that_compose_leave_no_process_idle() {
        let outcome = run(&Case { helping: true, ..case(11, 1000) }, &ideal());
        assert!(outcome.efficiency >= 0.93, "{outcome:?}");
    }

    #[test]
    fn direct_views_take_the_time_of_triangles_and_reused_samples_take_less() {
        let naive = run(&Case { direct: true, ..case(4, 100) }, &ideal());
        let expected = 100.0 * ideal().direct_ms * 1e-3 / 4.0;
        assert!((naive.tick_secs / expected - 1.0).abs() < 0.05, "{naive:?}");
        let still = run(&Case { refreshed: false, ..case(4, 400) }, &ideal());
        assert!((still.tick_secs / (400.0 * ideal().view_ms * 1e-3 / 3.0) - 1.0).abs() < 0.05, "{still:?}");
    }

    #[test]
    fn a_lone_process_uses_all_cores_for_its_rays() {
        let pooled = Parameters { direct_pooled: 0.5, machines: Machines::Shared { cores: 4 }, ..ideal() };
        let naive = |processes| run(&Case { direct: true, ..case(processes, 100) }, &pooled);
        let work = 100.0 * pooled.direct_ms * 1e-3;
        for (processes, expected) in [(1, work * (0.5 + 0.5 / 4.0)), (4, work / 4.0)] {
            let outcome = naive(processes);
            assert!((outcome.tick_secs / expected - 1.0).abs() < 0.05, "{processes}: {outcome:?}");
            let predicted = outcome.predicted_secs / expected;
            assert!((predicted - 1.0).abs() < 0.05, "{processes}: {outcome:?}");
        }
    }
}
