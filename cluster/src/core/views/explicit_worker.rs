//! Worker selection for explicit views: the worker that will probably answer first.
//!
//! The cost of a worker is its queue length, plus [`crate::core::Config::missing_sample_views`] for each sample that
//! it lacks. Ties go to the worker that had the fewest views so far. So views go to workers that hold their samples,
//! unless these are much busier than others, and load spreads.
//!
//! In a large cluster only some workers are examined: those with the shortest queues, and those that hold the rarest
//! of the view's samples. The best of them is the best of all, or nearly as good.

use super::cluster::Cluster;
use super::pending::Pending;
use crate::core::event::WorkerId;
use crate::core::workers::{QueueEntry, Worker};

/// Tracers in an order: a first choice and two fallbacks.
const MOST_TRACERS: usize = 3;

/// Most views in flight at a sampler that composes in spare time: half a batch, of which half are rendered while the
/// others are packed and sent.
const MOST_SPARE_VIEWS: usize = 32;

/// Up to this many workers all are examined; in larger clusters, this many of each kind.
const MOST_EXAMINED: usize = 64;

impl Cluster<'_> {
    /// The best worker with room for a view, if any has room.
    ///
    /// Roles decide which workers are considered. If no worker has the role, or all of them failed at this view, any
    /// worker is considered: each can do both, it only starts slower.
    pub(super) fn choose(&self, view: &Pending) -> Option<WorkerId> {
        let queue = if view.needs_samples() {
            self.workers.queues().compositors()
        } else {
            self.workers.queues().samplers()
        };
        let few = self.workers.queues().ready() <= MOST_EXAMINED || queue.len() <= view.tried.len();
        if few || !view.device.is_empty() {
            return self.choose_among_all(view);
        }
        let mut best: Option<(f64, QueueEntry)> = None;
        // A worker's cost is at least the length of its queue.
        let beaten = |best: &Option<(f64, QueueEntry)>, entry: &QueueEntry| {
            entry.queued >= self.config.max_views_per_worker
                || best.is_some_and(|(cost, _)| cost <= entry.queued as f64)
        };
        let consider = |best: &mut Option<(f64, QueueEntry)>, entry: QueueEntry| {
            let untried = self.workers.get(entry.worker).filter(|w| !view.tried.contains(&w.id()));
            let Some(worker) = untried else { return };
            let offer = (self.cost(worker, view), entry);
            if best.is_none_or(|best| offer.0.total_cmp(&best.0).then(offer.1.cmp(&best.1)).is_lt()) {
                *best = Some(offer);
            }
        };
        for entry in queue.iter().take(MOST_EXAMINED) {
            if beaten(&best, entry) {
                break;
            }
            consider(&mut best, *entry);
        }
        if !view.needs_samples() {
            return best.map(|(_, entry)| entry.worker);
        }
        for entry in self.workers.queues().samplers().iter().take(MOST_EXAMINED) {
            if entry.queued >= MOST_SPARE_VIEWS || beaten(&best, entry) {
                break;
            }
            if self.workers.get(entry.worker).is_some_and(|w| self.may_help_out(w, view)) {
                consider(&mut best, *entry);
            }
        }
        let lacks = |entry: QueueEntry| {
            self.workers
                .get(entry.worker)
                .is_none_or(|w| self.samples.locations().missing(view.samples(), w.id()) > 0)
        };
        if best.is_none_or(|(_, entry)| lacks(entry)) {
            let counted = view.samples().iter().map(|&id| (self.samples.locations().count_near(id), id));
            let rarest = counted.filter(|(count, _)| *count > 0).min();
            // The first worker to examine differs between views.
            let from = best.map_or(WorkerId(0), |(_, entry)| entry.worker);
            let near = rarest.into_iter().flat_map(|(_, id)| self.samples.locations().near(id, from));
            for worker in near.take(MOST_EXAMINED).filter_map(|id| self.workers.get(id)) {
                if worker.takes_views() && worker.queued() < self.config.max_views_per_worker {
                    consider(&mut best, worker.queue_entry());
                }
            }
        }
        best.map(|(_, entry)| entry.worker)
    }

    fn cost(&self, worker: &Worker, view: &Pending) -> f64 {
        let queued = worker.queued() as f64;
        let fetched = self.samples.locations().missing(view.samples(), worker.id()) as f64
            * self.config.missing_sample_views;
        queued + fetched + self.refining_views(worker)
    }

    /// The number of views that could be composed while a sampler renders one slice of a refinement. Views go before
    /// refinements, and between their slices.
    fn refining_views(&self, worker: &Worker) -> f64 {
        let placement = self.samples.placement();
        if !(worker.takes_samples()
            && self.samples.has_to_render(worker.id(), |index| placement.is_placed(index)))
        {
            return 0.0;
        }
        let costs = self.workers.believed_costs();
        let part_secs = worker.report().part_ms.map_or(costs.sample_secs, |ms| ms * 1e-3);
        let views = part_secs / costs.view_secs;
        if views >= 0.0 && views.is_finite() { views } else { MOST_SPARE_VIEWS as f64 }
    }

    fn choose_among_all(&self, view: &Pending) -> Option<WorkerId> {
        let takes = |w: &&Worker| match view.needs_samples() {
            true => w.takes_views() || self.may_help_out(w, view),
            false => w.takes_samples(),
        };
        let able: Vec<&Worker> = self
            .workers
            .iter()
            .filter(|w| w.is_ready() && (!view.needs_samples() || w.knows_set()))
            .filter(|w| view.device.is_empty() || w.hello().device == view.device)
            .collect();
        // Suspected and failing workers are the last resort.
        let awake: Vec<&Worker> = able.iter().filter(|w| w.answers()).copied().collect();
        let able = if awake.is_empty() { able } else { awake };
        let untried: Vec<&Worker> = able.iter().filter(|w| !view.tried.contains(&w.id())).copied().collect();
        let open = if untried.is_empty() { able } else { untried };
        let suited: Vec<&Worker> = open.iter().filter(|w| takes(w)).copied().collect();
        let asked = if suited.is_empty() { open } else { suited };
        asked
            .into_iter()
            .filter(|w| w.queued() < self.config.max_views_per_worker)
            .map(|w| (self.cost(w, view), w))
            .min_by(|(a_cost, a), (b_cost, b)| {
                let entry = |w: &Worker| (w.queue_entry().dispatched, w.id());
                a_cost.total_cmp(b_cost).then(entry(a).cmp(&entry(b)))
            })
            .map(|(_, w)| w.id())
    }

    /// Whether a sampler can compose a view in spare time: it holds the view's samples, has few views, and has
    /// nothing to render but refinements, which can wait.
    fn may_help_out(&self, sampler: &Worker, view: &Pending) -> bool {
        self.config.samplers_composite
            && sampler.takes_samples()
            && sampler.queued() < MOST_SPARE_VIEWS
            && view.samples().iter().all(|id| self.samples.locations().has(*id, sampler.id()))
            && !self.samples.has_to_render(sampler.id(), |index| !self.samples.placement().is_placed(index))
    }

    /// Addresses of the workers that trace pixels for a view that `reader` composes, best first. First comes `reader`
    /// itself if it samples, which needs no transfer. Samplers of the same kind of device follow, whose bytes are the
    /// same, then other samplers; each group by queue length. Empty without samplers.
    pub(super) fn tracers(&self, reader: WorkerId) -> Vec<String> {
        let itself = self.workers.get(reader);
        let device = itself.map(|w| &w.hello().device);
        let rank = |w: &&Worker| (w.id() != reader, Some(&w.hello().device) != device, w.queued(), w.id());
        let mut samplers: Vec<&Worker> = match self.workers.queues().ready() <= MOST_EXAMINED {
            true => self.workers.iter().filter(|w| w.answers() && w.assigned().role.samples()).collect(),
            false => {
                let front = self.workers.queues().samplers().iter().take(MOST_EXAMINED);
                let others = front.filter(|entry| entry.worker != reader);
                let others = others.filter_map(|entry| self.workers.get(entry.worker));
                itself.filter(|w| w.takes_samples()).into_iter().chain(others).collect()
            }
        };
        samplers.sort_by_key(rank);
        samplers.into_iter().take(MOST_TRACERS).map(|w| w.hello().address.clone()).collect()
    }
}
