//! Dispatch of waiting views to workers with room.
//!
//! Worker selection is in `choose`. For views that leave the way open it is [`decide`], with what `open` collects.

use argus_scene::{Detail, FaceMask, FaceMasks, Plan, Prediction, SampleId};

use super::open::reported;
use super::pending::{BLOCKING_QUEUES, Pending};
use super::target_search::TargetSearch;
use super::{Cluster, Views};
use crate::core::event::{Order, Source, ViewId, WorkerId};
use crate::core::market::{Asked, OfferKind, decide};
use crate::core::samples::Access;
use crate::core::time::Uptime;
use crate::core::workers::{QueuedView, WorkKind};

/// Most views bound to certain workers that are examined in one round.
const MOST_BOUND: usize = 64;

/// Attempts that may fail since a refinement was lost. The next attempt renders it for the view.
const MOST_WITHOUT: u32 = 3;

/// Workers from which a source may be fetched.
const MOST_HOLDERS: usize = 3;

/// A view that was given to a worker.
#[derive(Debug, Clone)]
pub(in crate::core) struct Dispatch {
    /// The view.
    pub(in crate::core) view_id: ViewId,
    /// The worker.
    pub(in crate::core) worker: WorkerId,
    /// The samples of its plan, and how much the view depends on each.
    pub(in crate::core) samples: Vec<(SampleId, Access)>,
    /// The demand to count, if the way was open until now.
    pub(in crate::core) decided: Vec<(WorkKind, u64)>,
}

/// The result of trying to dispatch a view.
#[derive(Debug)]
enum Attempt {
    Dispatch(Dispatch),
    /// No worker has room.
    Full,
    /// The view has ended.
    Over,
}

/// One pass over the waiting views.
#[derive(Debug)]
pub(in crate::core) struct Round {
    /// Views that only certain workers can answer, oldest first.
    bound: std::vec::IntoIter<ViewId>,
    /// The queues whose first view found no room.
    full: [bool; BLOCKING_QUEUES],
}

impl Views {
    /// Queues a view, in the order of its age.
    pub(super) fn wait(&mut self, view_id: ViewId) {
        let Some(view) = self.views.get_mut(&view_id) else { return };
        self.waiting.insert(view_id, view);
        self.due.remove(&(view.due, view_id));
        let patient = view.requested.after(self.config.patience);
        view.due = view.deadline.0.min(patient);
        self.due.insert((view.due, view_id));
    }

    /// Queues a view again, with another plan.
    pub(super) fn begin_again(
        &mut self,
        view_id: ViewId,
        plan: Plan,
        expected: Prediction,
        target_search: Box<TargetSearch>,
    ) {
        let Some(view) = self.views.get_mut(&view_id) else { return };
        self.in_flight.subtract(view);
        view.begin_again(plan, expected, target_search);
        self.in_flight.add(view);
        self.wait(view_id);
    }

    /// Begins a pass over the waiting views.
    pub(in crate::core) fn begin_round(&self) -> Round {
        let bound: Vec<ViewId> = self.waiting.bound.iter().copied().take(MOST_BOUND).collect();
        Round { bound: bound.into_iter(), full: [false; BLOCKING_QUEUES] }
    }

    /// Dispatches the next view: the oldest first in each queue, until its first view finds no room. A view that is
    /// bound to certain workers blocks no other. `None`: all remaining views must wait.
    pub(in crate::core) fn next(
        &mut self,
        round: &mut Round,
        cluster: Cluster<'_>,
        now: Uptime,
    ) -> Option<Dispatch> {
        loop {
            let (view_id, queue) = match round.bound.next() {
                Some(view_id) => (view_id, None),
                None => self.waiting.first(&round.full).map(|(view_id, queue)| (view_id, Some(queue)))?,
            };
            match self.place(view_id, cluster, now) {
                Attempt::Dispatch(given) => {
                    self.waiting.remove(view_id);
                    return Some(given);
                }
                Attempt::Over => self.waiting.remove(view_id),
                Attempt::Full => queue.into_iter().for_each(|queue| round.full[queue] = true),
            }
        }
    }

    /// Finds a worker for a view: by [`Self::place_open`] if it leaves the way open, else for the plan that it names.
    fn place(&mut self, view_id: ViewId, cluster: Cluster<'_>, now: Uptime) -> Attempt {
        let Some(view) = self.views.get(&view_id) else { return Attempt::Over };
        if view.open.is_some() {
            return self.place_open(view_id, cluster, now);
        }
        if view.needs_samples() && cluster.workers.set_is_on_its_way() {
            return Attempt::Full;
        }
        self.leave_out_lost(view_id, cluster);
        let Some(view) = self.views.get(&view_id) else { return Attempt::Over };
        let Some(worker) = cluster.choose(view) else { return Attempt::Full };
        // A sample that was lost unnoticed must not send a view back and forth.
        let may_come_back = view.attempts() < MOST_WITHOUT;
        let lacks = |sample: SampleId| !cluster.samples.locations().has(sample, worker);
        let access = |&sample: &SampleId| {
            let dispensable = may_come_back && lacks(sample) && is_dispensable(view, sample, cluster);
            (sample, if dispensable { Access::Dispensable } else { Access::Needed })
        };
        let samples = view.samples().iter().map(access).collect();
        if view.attempt == 0 {
            let queued = QueuedView { predicted_ms: 0.0, direct: view.is_direct(), work: view.work() };
            self.market.time.ask(cluster.workers.costs().expected_secs(&queued), now);
        }
        Attempt::Dispatch(Dispatch { view_id, worker, samples, decided: Vec::new() })
    }

    /// Chooses plan and worker of a view that leaves the way open.
    fn place_open(&mut self, view_id: ViewId, cluster: Cluster<'_>, now: Uptime) -> Attempt {
        let Some(view) = self.views.get(&view_id) else { return Attempt::Over };
        let Some(open) = &view.open else { return Attempt::Over };
        let hands = cluster.hands(view, &self.market, now);
        let pixels = view.pixels.saturating_mul(open.direct.samples_per_pixel.into());
        let (full_secs, workers) = (self.market.full_secs(pixels), cluster.answering());
        let price = self.market.time.of_view(open.preset, full_secs, workers, now);
        let (pool, state) = (cluster.samples.pool(), cluster.samples.set().version.state);
        let allowed = cluster.allowed(view, open, &self.market, now);
        let near = match allowed.warped {
            true => pool.near(&open.grid, open.direct.samples_per_pixel, state),
            false => Vec::new(),
        };
        let asked = Asked { pixels, allowed, price, near: &near };
        let Some(decision) = decide(&asked, &hands, &self.market.errors) else { return Attempt::Full };
        if view.attempt == 0 {
            self.market.count(open, &decision, &near, (price, cluster), now);
        }
        let plan = cluster.plan_of(&decision.chosen, &open.direct);
        let fallback = cluster.fallback(&decision, &open.direct, (&self.market, price));
        let worker = decision.chosen.worker;
        let Some(view) = self.views.get_mut(&view_id) else { return Attempt::Over };
        self.in_flight.subtract(view);
        view.plan = plan;
        view.version = cluster.samples.set().version;
        if let Some(open) = &mut view.open {
            open.decision = Some(reported(&decision, open, !near.is_empty()));
            (open.fallback, open.chosen, open.warped) = (fallback, Some(decision.chosen), decision.warped);
        }
        self.in_flight.add(view);
        let decided = match view.is_direct() {
            _ if view.attempt > 0 => Vec::new(),
            true => vec![(WorkKind::DirectAnywhere, 1), (WorkKind::MicrosAnywhere, (full_secs * 1e6) as u64)],
            false => vec![(WorkKind::Views, 1)],
        };
        Attempt::Dispatch(Dispatch { view_id, worker, samples: Vec::new(), decided })
    }

    /// Where a worker gets the sources of a view that it lacks.
    fn missing_sources(&self, view_id: ViewId, worker: WorkerId, cluster: Cluster<'_>) -> Vec<Source> {
        let chosen = self.views.get(&view_id).and_then(|view| view.open.as_ref()?.chosen.as_ref());
        let sources = chosen.map_or(&[][..], |chosen| &chosen.sources);
        let held = sources.iter().filter_map(|id| cluster.samples.pool().get(*id));
        let missing = held.filter(|held| !held.holders.contains(&worker));
        let address = |id: &WorkerId| Some(cluster.workers.get(*id)?.hello().address.clone());
        missing
            .map(|held| Source {
                id: held.id,
                faces: FaceMask::ALL,
                addresses: held.holders.iter().filter_map(address).take(MOST_HOLDERS).collect(),
                dispensable: true,
            })
            .collect()
    }

    /// Replaces refinements in a plan that no worker holds any more.
    fn leave_out_lost(&mut self, view_id: ViewId, cluster: Cluster<'_>) {
        let Some(view) = self.views.get_mut(&view_id) else { return };
        let Cluster { workers, samples, .. } = cluster;
        let answers = |worker: WorkerId| workers.get(worker).is_some_and(|w| !w.is_suspected());
        let is_lost = |id: SampleId| !samples.locations().holders(id).any(answers);
        let lost = |id: &&SampleId| is_dispensable(view, **id, cluster) && is_lost(**id);
        let Some(&SampleId { version, .. }) = view.samples().iter().find(lost) else { return };
        let there = |camera: &u64| !is_lost(SampleId { version, camera: *camera });
        let usable: Vec<u64> = samples.placement().usable().iter().copied().filter(there).collect();
        let count = view.samples().iter().filter(|id| !id.is_reflection_probe()).count();
        let ids = samples.sample_ids_among(&view.camera, count, version, &usable);
        if let Plan::Warp(warp) = &mut view.plan {
            (warp.samples, warp.faces) = (ids, FaceMasks::default());
        }
    }

    /// Makes the order for a dispatched view, and its entry in the worker's queue.
    pub(in crate::core) fn give(
        &mut self,
        given: &Dispatch,
        sources: Vec<Source>,
        cluster: Cluster<'_>,
    ) -> Option<(Box<Order>, QueuedView)> {
        let worker = cluster.workers.get(given.worker)?;
        let mut sources = sources;
        sources.extend(self.missing_sources(given.view_id, given.worker, cluster));
        let view = self.views.get_mut(&given.view_id)?;
        // A worker that warps frames of its own holds the triangles.
        let tracers = if view.traces_holes() && view.needs_samples() {
            cluster.tracers(worker.id())
        } else {
            Vec::new()
        };
        let costs = cluster.workers.costs();
        let usual = if view.is_direct() { costs.direct_secs() } else { costs.view_secs() };
        let decision = view.open.as_ref().and_then(|open| open.decision);
        let predicted_ms = decision.map_or(usual.unwrap_or(0.0) * 1e3, |decision| decision.render_ms);
        let queued = QueuedView { predicted_ms, direct: view.is_direct(), work: view.work() };
        if let Plan::Warp(warp) = &view.plan {
            sources.iter_mut().for_each(|source| source.faces = warp.faces.of(source.id.camera));
        }
        let warps = worker.report().frame_cost.is_some();
        let keeps_frame =
            warps && view.open.as_ref().is_some_and(|open| open.may_warp) && is_full(&view.plan);
        view.attempt += 1;
        let probe = match (&view.open, view.open.as_ref().and_then(|open| open.chosen.as_ref())) {
            (Some(open), Some(chosen)) => {
                let plan_of = |chosen: &_| cluster.plan_of(chosen, &open.direct);
                self.market.probe((given.view_id, view.attempt), (open, chosen), plan_of)
            }
            _ => None,
        };
        view.worker = Some(worker.id());
        view.tried.insert(worker.id());
        let order = Order {
            view_id: given.view_id,
            attempt: view.attempt,
            worker: worker.id(),
            address: worker.hello().address.clone(),
            state: view.version.state,
            plan: view.plan.clone(),
            sources,
            tracers,
            expected: view.expected,
            judged: view.target_search.as_ref().is_some_and(|target_search| target_search.judged),
            decision,
            fallback: view.open.as_ref().filter(|_| !view.is_direct()).and_then(|open| open.fallback.clone()),
            keeps_frame,
            probe,
        };
        Some((Box::new(order), queued))
    }
}

/// Whether a plan renders all of a view from triangles.
fn is_full(plan: &Plan) -> bool {
    OfferKind::Direct(Detail::Full)
        == match plan {
            Plan::Direct { detail, .. } => OfferKind::Direct(*detail),
            Plan::Warp(_) => OfferKind::Guessed,
        }
}

/// Whether a view can be planned without a sample.
fn is_dispensable(view: &Pending, id: SampleId, cluster: Cluster<'_>) -> bool {
    !view.pinned && cluster.samples.is_dispensable(id, view.own_level)
}
