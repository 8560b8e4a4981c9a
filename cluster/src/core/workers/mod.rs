//! Workers: membership, health, queues and roles.
//!
//! This part reads neither of the other parts. What it must know of them is an argument: how many samples each worker
//! holds ([`SampleCounts`]), the size of the largest view, whether samples are wanted. What matters to the other parts is
//! returned, or shown by [`Workers::has_changed`].
//!
//! [`balance`] computes how many workers render samples, [`hysteresis`] decides when a better split is worth a
//! change, and `roles` chooses the workers that change. `queues` orders workers by their queues. `silence` and
//! `suspicion` find workers that hang, `visibility` chooses the visibility backend. `costs` and `demand` hold the
//! formula's inputs.

pub mod balance;
mod costs;
mod demand;
mod effects;
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

use argus_scene::LightLevel;

pub(super) use costs::MeasuredCosts;
pub(super) use demand::WorkKind;
pub(super) use queues::{QueueEntry, WorkerQueues};
pub(super) use roles::SampleCounts;
pub(super) use worker::{PrefetchLists, QueuedView, Worker};

use super::config::Config;
use super::event::{Action, Purchase, ViewId, WorkerId};
use super::time::Uptime;
use balance::{Costs, Demand, Split};
use demand::Rates;
use hysteresis::Hysteresis;
use silence::Awake;

/// Counts of workers since the coordinator started.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WorkerCounts {
    /// Workers that joined.
    pub(super) joined: u64,
    /// Workers whose lease expired or whose stream ended unannounced.
    pub(super) lost: u64,
    /// Changes of a worker's role.
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
    /// Number of workers that will probably join.
    expected: usize,
    /// Whether the visibility backend of samples is chosen.
    visibility_is_settled: bool,
    /// Most samples in one piece of a worker's work.
    samples_per_batch: u64,
    /// Ticks for which the cost of views from samples was not known of some worker.
    unmeasured_ticks: f64,
    /// Whether prefetch lists may have changed.
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
            split: Split::NoWorkers,
            hysteresis: Hysteresis::new(config.margin, config.dwell, idle_secs),
            awake: Awake::default(),
            expected: 0,
            visibility_is_settled: config.visibility.is_some(),
            samples_per_batch,
            unmeasured_ticks: 0.0,
            changed: false,
            counts: WorkerCounts::default(),
            config: config.clone(),
        }
    }

    /// Sets the expected number of workers, so that the first ones take the roles that they will have among all.
    pub(super) fn expect(&mut self, workers: usize) {
        self.expected = workers;
    }

    /// The worker with this id, unless it is lost.
    pub(super) fn get(&self, id: WorkerId) -> Option<&Worker> {
        self.workers.get(&id)
    }

    /// All workers, in the order in which they joined.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Worker> {
        self.workers.values()
    }

    /// Workers that are ready and not leaving.
    pub(super) fn members(&self) -> impl Iterator<Item = &Worker> {
        self.workers.values().filter(|w| w.is_ready())
    }

    /// The best light that all workers that answer views have ready.
    pub(super) fn light(&self) -> LightLevel {
        let answering = self.workers.values().filter(|worker| worker.answers());
        answering.map(|worker| worker.report().light).min().unwrap_or(LightLevel::Direct)
    }

    /// Workers of each role, by the length of their queues.
    pub(super) fn queues(&self) -> &WorkerQueues {
        &self.queues
    }

    /// The present split of the ready workers between the roles.
    pub(super) fn split(&self) -> Split {
        self.split
    }

    /// Costs measured by workers.
    pub(super) fn costs(&self) -> &MeasuredCosts {
        &self.costs
    }

    /// Demand per tick.
    pub(super) fn demand(&self) -> Demand {
        self.rates.demand()
    }

    /// The formula's costs.
    pub(super) fn believed_costs(&self) -> Costs {
        self.costs.believed()
    }

    /// The counts so far.
    pub(super) fn counts(&self) -> WorkerCounts {
        self.counts
    }

    /// Counts demand in the current tick.
    pub(super) fn count(&mut self, kind: WorkKind, n: u64) {
        self.rates.count(kind, n);
    }

    /// Whether prefetch lists may have changed.
    pub(super) fn has_changed(&self) -> bool {
        self.changed
    }

    /// Closes a tick. The busiest worker's time is compared with the formula's tick.
    pub(super) fn tick(&mut self, ticks: f64) {
        self.count_unmeasured_ticks(ticks);
        self.rates.roll();
        let mut busiest = 0.0_f64;
        for worker in self.workers.values_mut() {
            busiest = busiest.max(worker.busy_since_tick_ms());
            worker.begin_tick();
        }
        self.costs.learn_tick(busiest * 1e-3 / ticks, self.config.smoothing);
    }

    /// Adds a view to a worker's queue.
    pub(super) fn begin(&mut self, id: WorkerId, view_id: ViewId, view: QueuedView, now: Uptime) {
        self.change(id, |worker| worker.begin(view_id, view, now));
    }

    /// Removes a view from a worker's queue. Returns whether it was there.
    pub(super) fn end(&mut self, id: WorkerId, view_id: ViewId, now: Uptime) -> bool {
        self.change(id, |worker| worker.end(view_id, now)).unwrap_or(false)
    }

    /// Records that a worker answered a view of `work` pixels, with sub-pixels.
    pub(super) fn answered(&mut self, id: WorkerId, direct: bool, work: u64) {
        self.costs.learn_pixels(direct, work);
        self.change(id, Worker::answered);
    }

    /// Makes the assignment with the sources that a worker shall render.
    pub(super) fn assign_purchases(
        &mut self,
        id: WorkerId,
        purchases: Vec<Purchase>,
        actions: &mut Vec<Action>,
    ) {
        let Some(worker) = self.workers.get_mut(&id) else { return };
        actions.push(Action::Assign { worker: id, assignment: worker.assign_purchases(purchases) });
    }

    /// Sends changed prefetch lists, the oldest useful version, the suspected workers and the holders of light cells.
    pub(super) fn assign_prefetch(&mut self, prefetch: PrefetchLists, actions: &mut Vec<Action>) {
        /// Most holders of light cells that are named.
        const MOST_HOLDERS: usize = 8;
        self.changed = false;
        let holders = self.workers.values().filter(|worker| worker.holds_cells() && worker.answers());
        let holders: Vec<String> =
            holders.take(MOST_HOLDERS).map(|worker| worker.hello().address.clone()).collect();
        for (id, list) in prefetch.lists {
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            let (kept_from, suspected) = (prefetch.kept_from, &prefetch.suspected);
            if let Some(assignment) = worker.assign_prefetch(list, kept_from, suspected, &holders) {
                actions.push(Action::Assign { worker: id, assignment });
            }
        }
    }

    /// Changes a worker, and updates its place in the queues.
    fn change<T>(&mut self, id: WorkerId, change: impl FnOnce(&mut Worker) -> T) -> Option<T> {
        let worker = self.workers.get_mut(&id)?;
        let result = change(worker);
        self.queues.update(worker.queue_membership());
        Some(result)
    }
}
