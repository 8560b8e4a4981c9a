//! Which workers there are, what each can be given, and which role it plays.
//!
//! This part reads neither of the others. What it has to know of them is handed in: how many samples each worker would
//! take along ([`Stake`]), how large the largest view is, whether samples are wanted. What changes here and matters to
//! the others is returned, or told by [`Workers::has_changed`].
//!
//! [`balance`] says how many workers render samples, [`hysteresis`] when a better split is worth a change, `roles` which
//! workers change. `queues` keeps those with room in order. `silence` and `suspicion` find workers that stopped getting
//! on, `visibility` settles how triangles are seen. `costs` and `demand` hold what the formula goes by.

pub mod balance;
mod costs;
mod demand;
pub mod hysteresis;
mod join;
mod queues;
mod record;
mod roles;
mod silence;
mod suspicion;
mod visibility;
mod worker;

use std::collections::BTreeMap;
use std::sync::Arc;

pub(super) use costs::MeasuredCosts;
pub(super) use demand::WorkKind;
pub(super) use queues::{QueueEntry, WorkerQueues};
pub(super) use roles::Stake;
pub(super) use worker::{PrefetchLists, QueuedView, Worker};

use super::config::Config;
use super::event::{Action, ViewId, WorkerId};
use balance::{Costs, Demand, Split};
use demand::Rates;
use hysteresis::Hysteresis;
use silence::Awake;

/// What happened to workers since the coordinator started.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WorkerCounts {
    /// Those that joined.
    pub(super) joined: u64,
    /// Those that fell silent or whose stream ended unannounced.
    pub(super) lost: u64,
    /// Roles that a worker was told in place of another.
    pub(super) roles_changed: u64,
}

/// All workers that joined and were not lost.
#[derive(Debug)]
pub(super) struct Workers {
    config: Arc<Config>,
    workers: BTreeMap<WorkerId, Worker>,
    queues: WorkerQueues,
    rates: Rates,
    costs: MeasuredCosts,
    split: Split,
    hysteresis: Hysteresis,
    awake: Awake,
    /// Workers that will probably join.
    expected: usize,
    /// Whether it is known how triangles are seen.
    visibility_is_settled: bool,
    /// Samples that a worker renders in one piece of work, at most.
    samples_per_batch: u64,
    /// Ticks for which views from triangles have taken so much time that samples may be worth measuring.
    steady_ticks: f64,
    /// Whether what workers shall have at hand may be another than they were told.
    changed: bool,
    counts: WorkerCounts,
}

impl Workers {
    /// No workers yet.
    pub(super) fn new(config: &Arc<Config>, samples_per_batch: u64) -> Self {
        let idle_secs = config.tick.as_secs_f64() * config.idle_fraction;
        Self {
            workers: BTreeMap::new(),
            queues: WorkerQueues::default(),
            rates: Rates::new(config.smoothing),
            costs: MeasuredCosts::new(config.smoothing),
            split: Split::Nobody,
            hysteresis: Hysteresis::new(config.margin, config.dwell, idle_secs),
            awake: Awake::default(),
            expected: 0,
            visibility_is_settled: config.visibility.is_some(),
            samples_per_batch,
            steady_ticks: 0.0,
            changed: false,
            counts: WorkerCounts::default(),
            config: config.clone(),
        }
    }

    /// So many workers will join: the first ones take the roles that they will have among all.
    pub(super) fn expect(&mut self, workers: usize) {
        self.expected = workers;
    }

    /// The worker of that id, unless it is lost.
    pub(super) fn get(&self, id: WorkerId) -> Option<&Worker> {
        self.workers.get(&id)
    }

    /// All workers, those that joined first at the front.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Worker> {
        self.workers.values()
    }

    /// Workers that are ready and stay.
    pub(super) fn members(&self) -> impl Iterator<Item = &Worker> {
        self.workers.values().filter(|w| w.is_ready())
    }

    /// Workers of each role, those with the shortest queue first.
    pub(super) fn queues(&self) -> &WorkerQueues {
        &self.queues
    }

    /// How the ready workers are divided between the roles.
    pub(super) fn split(&self) -> Split {
        self.split
    }

    /// What things cost, as workers measured it.
    pub(super) fn costs(&self) -> &MeasuredCosts {
        &self.costs
    }

    /// What is asked for per tick.
    pub(super) fn demand(&self) -> Demand {
        self.rates.demand()
    }

    /// What is believed of costs by the formula.
    pub(super) fn believed_costs(&self) -> Costs {
        self.costs.believed()
    }

    /// What happened to workers so far.
    pub(super) fn counts(&self) -> WorkerCounts {
        self.counts
    }

    /// Counts what is asked for, in the tick that runs.
    pub(super) fn count(&mut self, kind: WorkKind, n: u64) {
        self.rates.count(kind, n);
    }

    /// Whether what workers shall have at hand may be another than they were told.
    pub(super) fn has_changed(&self) -> bool {
        self.changed
    }

    /// Ticks have passed. The busiest worker's time in them is what the formula's tick predicts.
    pub(super) fn tick(&mut self, ticks: f64) {
        self.count_steady_ticks(ticks);
        self.rates.roll();
        let mut busiest = 0.0_f64;
        for worker in self.workers.values_mut() {
            busiest = busiest.max(worker.busy_since_tick_ms());
            worker.begin_tick();
        }
        self.costs.learn_tick(busiest * 1e-3 / ticks, self.config.smoothing);
    }

    /// A view was sent to a worker.
    pub(super) fn begin(&mut self, id: WorkerId, view_id: ViewId, view: QueuedView) {
        self.change(id, |worker| worker.begin(view_id, view));
    }

    /// A worker no longer has a view: it answered, failed, or the view was taken back. Whether it had it.
    pub(super) fn end(&mut self, id: WorkerId, view_id: ViewId) -> bool {
        self.change(id, |worker| worker.end(view_id)).unwrap_or(false)
    }

    /// A worker answered a view, for which so many pixels were rendered, sub-pixels counted.
    pub(super) fn answered(&mut self, id: WorkerId, direct: bool, work: u64) {
        self.costs.learn_pixels(direct, work);
        self.change(id, Worker::answered);
    }

    /// Tells workers what to have at hand, of which versions, and which workers not to wait for, where that is news.
    pub(super) fn assign_prefetch(&mut self, prefetch: PrefetchLists, actions: &mut Vec<Action>) {
        self.changed = false;
        for (id, list) in prefetch.lists {
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            if let Some(assignment) = worker.assign_prefetch(list, prefetch.kept_from, &prefetch.suspected) {
                actions.push(Action::Assign { worker: id, assignment });
            }
        }
    }

    /// Changes a worker, and its place in the queues with it.
    fn change<T>(&mut self, id: WorkerId, change: impl FnOnce(&mut Worker) -> T) -> Option<T> {
        let worker = self.workers.get_mut(&id)?;
        let result = change(worker);
        self.queues.update(worker.queue_membership());
        Some(result)
    }
}
