//! The balance under change, with the real core: demand rises and falls; workers differ, join, leave, hang and restart.

use std::cell::RefCell;
use std::rc::Rc;

use argus_cluster::core::Config;
use argus_scene::Camera;
use glam::DVec3;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::load::{ClientStats, Clients, somewhere};
use super::world::World;
use super::{Parameters, secs, set_info};

/// The outcome of a scenario.
#[derive(Debug)]
struct Outcome {
    asked: u64,
    rejected: u64,
    /// Views that failed or were never answered.
    lost: u64,
    retried: u64,
    p50_ms: f64,
    p99_ms: f64,
    worst_ms: f64,
    roles_changed: u64,
    /// Role changes per minute while load and workers were steady; `None` if they never are.
    steady_changes_per_min: Option<f64>,
    /// Seconds until the split was right after the load changed; `None` if the load does not change.
    settled_secs: Option<f64>,
    /// Share of views whose worker waited for a sample.
    waited_for_samples: f64,
    /// Views of the busiest compositor over the compositors' mean.
    spread: f64,
}

/// Viewers walk all over a scene of many cells: whether views stay near their samples.
fn placement(parameters: &Parameters) -> Outcome {
    let walk = |client: u64, secs: f64| {
        let mut rng = SmallRng::seed_from_u64(client);
        let start = DVec3::new(rng.random_range(-80.0..80.0), 2.0, rng.random_range(-80.0..80.0));
        // A metre a second, in a circle around the start.
        let turn = secs / 6.0 + client as f64;
        let eye = start + DVec3::new(6.0 * turn.cos(), 0.0, 6.0 * turn.sin());
        Camera::look_at(eye, eye + DVec3::new(-turn.sin(), 0.0, turn.cos()))
    };
    let mut stage = Stage::with(parameters, 32, Some(20.0), Config { refining_share: 0.0, ..config() });
    let stats = stage.load(400, false, |_| 2000.0, walk);
    stage.world.run_for(secs(60.0));
    let before = stage.world.tally;
    stage.world.run_for(secs(40.0));
    let now = stage.world.tally;
    let mut outcome = stage.end(&stats);
    outcome.waited_for_samples = (now.waited_for_samples - before.waited_for_samples) as f64
        / (now.answered - before.answered).max(1) as f64;
    outcome
}

/// The cluster paper's configuration: roles are exclusive, and only the rig places samples.
fn config() -> Config {
    Config { refining_share: 0.0, samplers_composite: false, ..Config::default() }
}

/// The program's default configuration.
fn by_default() -> Config {
    Config { refining_share: 0.5, samplers_composite: true, ..Config::default() }
}

/// A simulated cluster and its clients.
struct Stage {
    world: World,
    rng: SmallRng,
}

impl Stage {
    fn new(parameters: &Parameters, processes: usize) -> Self {
        Self::with(parameters, processes, None, config())
    }

    fn with(parameters: &Parameters, processes: usize, cell: Option<f64>, config: Config) -> Self {
        let mut world = World::new(config, set_info(false, cell), parameters.clone(), processes);
        (0..processes).for_each(|slot| world.start(slot));
        world.run_for(secs(1.0));
        Self { world, rng: SmallRng::seed_from_u64(7) }
    }

    fn load(
        &mut self,
        clients: u64,
        direct: bool,
        rate: impl Fn(f64) -> f64 + 'static,
        camera: impl Fn(u64, f64) -> Camera + 'static,
    ) -> Rc<RefCell<ClientStats>> {
        let (load, stats) = Clients::new(clients, direct, rate, camera);
        self.world.with_load(Box::new(load));
        stats
    }

    fn roles_changed(&self) -> u64 {
        self.world.core.status().counts().roles_changed
    }

    /// A random worker that is alive and not paused.
    fn random_worker(&mut self) -> usize {
        loop {
            let slot = self.rng.random_range(0..self.world.workers.len());
            let worker = &self.world.workers[slot];
            if worker.alive && !worker.paused {
                return slot;
            }
        }
    }

    /// Seconds until a split is reached; `None` if that takes more than a minute.
    fn until_samplers(&mut self, is_wanted: impl Fn(u32) -> bool) -> Option<f64> {
        let from = self.world.now;
        let reached = self.world.run_until(secs(60.0), |world| is_wanted(world.core.status().samplers));
        reached.then(|| (self.world.now - from) as f64 * 1e-9)
    }

    /// Ends the load, waits for open views, and returns the outcome.
    fn end(mut self, stats: &Rc<RefCell<ClientStats>>) -> Outcome {
        self.world.stop_load();
        self.world.run_until(secs(40.0), |world| world.open_views() == 0);
        let (tally, status) = (self.world.tally, self.world.core.status());
        let mut latencies = std::mem::take(&mut stats.borrow_mut().latencies_ms);
        latencies.sort_by(f64::total_cmp);
        let at =
            |share: f64| latencies.get((latencies.len() as f64 * share) as usize).copied().unwrap_or(0.0);
        let views: Vec<u64> =
            status.workers.iter().map(|w| w.views_composed).filter(|count| *count > 0).collect();
        let mean = views.iter().sum::<u64>() as f64 / views.len().max(1) as f64;
        Outcome {
            asked: tally.asked,
            rejected: tally.overloaded,
            lost: tally.failed + self.world.open_views() as u64,
            retried: status.counts().views_retried,
            p50_ms: at(0.5),
            p99_ms: at(0.99),
            worst_ms: tally.slowest as f64 * 1e-6,
            roles_changed: status.counts().roles_changed,
            steady_changes_per_min: None,
            settled_secs: None,
            waited_for_samples: tally.waited_for_samples as f64 / tally.asked.max(1) as f64,
            spread: views.iter().max().copied().unwrap_or(0) as f64 / mean.max(1e-9),
        }
    }
}

/// Views per second that this many workers can compose.
fn capacity(parameters: &Parameters, workers: f64) -> f64 {
    workers * 1e3 / parameters.view_ms
}

/// Every cost varies by a third, and views come at random.
fn noisy(direct_load: f64, config: &Config, seed: u64, parameters: &Parameters) -> Outcome {
    let mut stage = Stage::with(parameters, 3, None, config.clone());
    stage.world.rng = SmallRng::seed_from_u64(seed);
    stage.world.noise = 0.33;
    // a·(P − K) = b·(K − 1) at K = 2 of 3: direct work and composing each take 60% of a worker.
    let (direct, views) = (direct_load * 1e3 / parameters.direct_ms, 0.6e3 / parameters.view_ms);
    let share = direct / (direct + views);
    let (load, stats) = Clients::new(100_000, false, move |_| direct + views, |client, _| somewhere(client));
    stage.world.with_load(Box::new(load.some_direct(share)));
    stage.world.run_for(secs(120.0));
    let before = stage.roles_changed();
    stage.world.run_for(secs(600.0));
    let changes = (stage.roles_changed() - before) as f64 / 10.0;
    let mut outcome = stage.end(&stats);
    outcome.steady_changes_per_min = Some(changes);
    outcome
}

/// Demand in waves of a minute, from 10% to 90% of capacity.
fn waves(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 12);
    let most = capacity(parameters, 11.0);
    let rate = move |secs: f64| most * (0.5 - 0.4 * (secs * std::f64::consts::TAU / 60.0).cos());
    let stats = stage.load(5000, false, rate, |client, _| somewhere(client));
    stage.world.run_for(secs(180.0));
    stage.end(&stats)
}

/// Half a minute of warped views, one in which half of the work is direct views, then warped views again.
fn direct_views(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 8);
    let views = capacity(parameters, 3.0);
    let direct = 3.0e3 / parameters.direct_ms;
    let between = |secs: f64| (30.0..60.0).contains(&secs);
    let rate = move |secs| if between(secs) { views + direct } else { views };
    let (load, stats) = Clients::new(5000, false, rate, |client, _| somewhere(client));
    let share = move |secs| if between(secs) { direct / (views + direct) } else { 0.0 };
    stage.world.with_load(Box::new(load.some_direct_at(share)));
    stage.world.run_for(secs(29.0));
    let up = stage.until_samplers(|samplers| samplers >= 3);
    stage.world.run_for(secs(60.0 - stage.world.now as f64 * 1e-9));
    let down = stage.until_samplers(|samplers| samplers <= 1);
    stage.world.run_for(secs(20.0));
    let mut outcome = stage.end(&stats);
    outcome.settled_secs = up.zip(down).map(|(up, down)| up.max(down));
    outcome
}

/// Half a minute of warped views, then as much work again in direct views: the roles of half of all workers have to change. It has
/// settled when the number of samplers is and stays within one of its last value, or within a twentieth of the workers.
fn step(processes: usize, parameters: &Parameters) -> Outcome {
    let mut stage = Stage::with(parameters, processes, None, by_default());
    let load = 0.35 * processes as f64;
    let (views, direct) = (capacity(parameters, load), load * 1e3 / parameters.direct_ms);
    let is_up = |secs: f64| secs >= 30.0;
    let rate = move |secs| if is_up(secs) { views + direct } else { views };
    let share = move |secs| if is_up(secs) { direct / (views + direct) } else { 0.0 };
    let (clients, stats) = Clients::new(5000, false, rate, |client, _| somewhere(client));
    stage.world.with_load(Box::new(clients.some_direct_at(share)));
    stage.world.run_for(secs(30.0 - stage.world.now as f64 * 1e-9));
    let before = stage.roles_changed();
    let samplers: Vec<u32> = (0..60)
        .map(|_| {
            stage.world.run_for(secs(1.0));
            stage.world.core.status().samplers
        })
        .collect();
    let changed = stage.roles_changed() - before;
    let last = samplers.last().copied().unwrap_or(0);
    // A small gain is taken after many ticks, by a single worker or a few of a hundred.
    let is_far = |samplers: &u32| samplers.abs_diff(last) > (processes as u32 / 20).max(1);
    let mut outcome = stage.end(&stats);
    outcome.roles_changed = changed;
    outcome.settled_secs = Some(samplers.iter().rposition(is_far).map_or(0.0, |tick| tick as f64 + 2.0));
    outcome
}

fn straggler(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 8);
    stage.world.workers[5].slowness = 4.0;
    let rate = 0.8 * capacity(parameters, 6.25);
    let stats = stage.load(5000, false, move |_| rate, |client, _| somewhere(client));
    stage.world.run_for(secs(60.0));
    let before = stage.roles_changed();
    stage.world.run_for(secs(60.0));
    let steady = stage.roles_changed() - before;
    let mut outcome = stage.end(&stats);
    outcome.steady_changes_per_min = Some(steady as f64);
    outcome
}

fn join_and_leave(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 12);
    (8..12).for_each(|slot| stage.world.kill(slot));
    let rate = 0.7 * capacity(parameters, 5.0);
    let stats = stage.load(5000, false, move |_| rate, |client, _| somewhere(client));
    stage.world.run_for(secs(20.0));
    (8..12).for_each(|slot| stage.world.start(slot));
    stage.world.run_for(secs(20.0));
    (0..6).for_each(|slot| stage.world.leave(slot));
    stage.world.run_for(secs(20.0));
    let before = stage.roles_changed();
    stage.world.run_for(secs(60.0));
    let steady = stage.roles_changed() - before;
    let mut outcome = stage.end(&stats);
    outcome.steady_changes_per_min = Some(steady as f64);
    outcome
}

/// Each worker returns a second later.
fn kills(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 8);
    let rate = 0.6 * capacity(parameters, 6.0);
    let stats = stage.load(5000, false, move |_| rate, |client, _| somewhere(client));
    for _ in 0..40 {
        stage.world.run_for(secs(2.0));
        let slot = stage.random_worker();
        stage.world.kill(slot);
        stage.world.run_for(secs(1.0));
        stage.world.start(slot);
    }
    stage.end(&stats)
}

fn hangs(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 8);
    let rate = 0.6 * capacity(parameters, 6.0);
    let stats = stage.load(5000, false, move |_| rate, |client, _| somewhere(client));
    for _ in 0..20 {
        stage.world.run_for(secs(3.0));
        let slot = stage.random_worker();
        stage.world.pause(slot);
        stage.world.run_for(secs(2.0));
        stage.world.resume(slot);
    }
    stage.end(&stats)
}

/// Each worker announces that it leaves, finishes its work, ends, and joins again a second later.
fn rolling_restart(parameters: &Parameters) -> Outcome {
    let mut stage = Stage::new(parameters, 8);
    let rate = 0.7 * capacity(parameters, 6.0);
    let stats = stage.load(5000, false, move |_| rate, |client, _| somewhere(client));
    stage.world.run_for(secs(10.0));
    for slot in 0..8 {
        stage.world.leave(slot);
        let ended = stage.world.run_until(secs(30.0), |world| !world.workers[slot].alive);
        assert!(ended, "worker {slot} does not end");
        stage.world.run_for(secs(1.0));
        stage.world.start(slot);
        stage.world.run_until(secs(10.0), |world| world.core.status().processes == 8);
    }
    stage.end(&stats)
}

fn parameters() -> Parameters {
    Parameters { view_ms: 8.0, ..Parameters::default() }
}

/// Twelve runs of ten minutes each had no change either.
#[test]
fn steady_noisy_load_changes_no_role_not_even_at_a_boundary() {
    for (config, direct_load) in
        [(by_default(), 0.45), (by_default(), 0.6), (config(), 0.45), (config(), 0.6)]
    {
        for seed in [1, 2] {
            let outcome = noisy(direct_load, &config, seed, &parameters());
            assert_eq!(outcome.steady_changes_per_min, Some(0.0), "{direct_load}: {outcome:?}");
            assert_eq!((outcome.lost, outcome.rejected), (0, 0), "{outcome:?}");
        }
    }
}

#[test]
fn the_split_follows_demand_within_seconds_and_every_view_is_answered() {
    let outcome = direct_views(&parameters());
    assert!(outcome.settled_secs.is_some_and(|secs| secs < 15.0), "{outcome:?}");
    assert_eq!((outcome.lost, outcome.rejected), (0, 0), "{outcome:?}");
}

#[test]
fn a_step_in_demand_settles_within_ten_ticks_with_at_most_two_role_changes_per_worker() {
    for processes in [2, 11, 100] {
        let outcome = step(processes, &parameters());
        assert!(outcome.settled_secs.is_some_and(|secs| secs <= 10.0), "{outcome:?}");
        assert!(outcome.roles_changed <= 2 * processes as u64, "{outcome:?}");
        assert!(processes < 11 || outcome.roles_changed > 0, "a step that asks for nothing: {outcome:?}");
        // A hundred workers turn a few views in a thousand away while their roles change.
        assert_eq!(outcome.lost, 0, "{outcome:?}");
        assert!(outcome.rejected < outcome.asked / 100, "{outcome:?}");
    }
}

#[test]
fn waves_of_demand_change_no_roles_and_lose_nothing() {
    let outcome = waves(&parameters());
    assert_eq!((outcome.lost, outcome.rejected), (0, 0), "{outcome:?}");
    assert!(outcome.roles_changed <= 1, "the first one was alone: {outcome:?}");
}

#[test]
fn a_slow_worker_gets_fewer_views_and_delays_no_other() {
    let outcome = straggler(&parameters());
    assert_eq!((outcome.lost, outcome.steady_changes_per_min), (0, Some(0.0)), "{outcome:?}");
    assert!(outcome.p99_ms < 20.0 * outcome.p50_ms, "{outcome:?}");
}

#[test]
fn workers_that_join_and_leave_lose_no_view_and_roles_settle() {
    let outcome = join_and_leave(&parameters());
    assert_eq!((outcome.lost, outcome.steady_changes_per_min), (0, Some(0.0)), "{outcome:?}");
}

#[test]
fn killed_and_hanging_workers_cost_latency_but_no_view() {
    let outcome = kills(&parameters());
    assert!(outcome.lost == 0 && outcome.retried > 0, "{outcome:?}");
    assert!(outcome.worst_ms < 3000.0, "{outcome:?}");
    let outcome = hangs(&parameters());
    assert!(outcome.lost == 0 && outcome.worst_ms < 3000.0, "{outcome:?}");
}

#[test]
fn a_rolling_restart_of_all_workers_loses_no_view_and_retries_none() {
    let outcome = rolling_restart(&parameters());
    assert_eq!((outcome.lost, outcome.rejected, outcome.retried), (0, 0, 0), "{outcome:?}");
}

#[test]
fn views_stay_near_their_samples_and_the_load_is_even() {
    let outcome = placement(&parameters());
    assert_eq!(outcome.lost, 0, "{outcome:?}");
    assert!(outcome.waited_for_samples < 0.2, "{outcome:?}");
    assert!(outcome.spread < 1.5, "{outcome:?}");
}
