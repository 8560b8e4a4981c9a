//! Offers of workers for views that leave the way open. The planner chooses among them.

use std::collections::HashMap;

use argus_scene::rig::{CandidateCameras, CoverageEstimate};
use argus_scene::{Camera, Detail, FaceMask, Holes, Plan, SampleId, Search, View, Warp};

use super::cluster::Cluster;
use super::estimate_request::EstimateRequest;
use super::load::{Load, Work};
use super::open_view::OpenView;
use super::output::Output;
use super::pending::Pending;
use super::planner::{MOST_SAMPLES, Offer, excess_of, predicted_excess};
use super::session_memory::Memory;
use crate::core::event::{LastView, Report, Role, WorkerId};
use crate::core::quality::Cost;
use crate::core::time::Uptime;
use crate::core::workers::Worker;

/// Most workers that are asked for offers: of those with the shortest queues, and of those that hold the best sample.
const MOST_ASKED: usize = 64;

/// Cameras around a viewer that are checked for held samples, nearest first.
const AROUND: usize = 24;

/// Most cameras of held samples in an estimate.
const MOST_HELD: usize = 8;

/// The finest level of refinement that a camera set may have: finer cameras serve too few viewers.
const FINEST_LEVEL: u32 = 2;

/// Views of a worker whose price is not known.
const MOST_UNPRICED: usize = 4;

/// Mean time that a view waits for a slice of background work, milliseconds: half of a slice.
const HALF_SLICE_MS: f64 = 10.0;

/// Time that a view waits for a worker that measures, milliseconds. Most measurements run in slices, but drivers
/// compile a program in one piece.
const MEASURING_MS: f64 = 200.0;

/// A view from samples.
#[derive(Debug, Clone)]
struct FromSamples {
    plan: Plan,
    /// Share of the view that the samples miss, whose pixels are traced.
    uncovered: f64,
    /// Predicted mean FLIP above that of a direct view.
    excess: f64,
    /// Whether the samples see enough of the view, with fine texels.
    meets_coverage: bool,
}

/// Cameras with faces of theirs.
type Faces = Vec<(u64, FaceMask)>;

/// Cached results for one view, by cameras and faces: most workers hold the same samples.
type CachedPlans = HashMap<Faces, Option<FromSamples>>;

impl Cluster<'_> {
    /// The estimate that the planner wants of a view before it is submitted. `None` if it would change nothing: the way
    /// is not open, or no worker holds a sample nearby.
    pub(in crate::core) fn estimate_wanted(
        &self,
        view: &View,
        last: Option<&LastView>,
    ) -> Option<EstimateRequest> {
        let open = view.leaves_way_open();
        let candidates = if open { self.held_around(&view.camera) } else { Vec::new() };
        // The last frame's samples may no longer be the nearest ones.
        let memory = last.filter(|_| open).and_then(|last| Memory::of(view, last.clone()));
        let repeated = memory.iter().flat_map(Memory::samples).map(|id| id.camera).collect();
        let frames = if open { self.frames_around(view) } else { Vec::new() };
        EstimateRequest::of(self.samples.set(), repeated, candidates, frames)
    }

    /// The estimate that tells which camera set would have served a view; `None` if no camera set can pay.
    pub(in crate::core) fn camera_set_estimate_wanted(&self, view: &View) -> Option<EstimateRequest> {
        let open = view.leaves_way_open();
        let may_pay = self.workers.iter().any(|worker| worker.report().warp_cost.is_some());
        let candidates = if open && may_pay { self.cameras_around(&view.camera) } else { Vec::new() };
        EstimateRequest::of(self.samples.set(), candidates, Vec::new(), Vec::new())
    }

    /// Cameras near a viewer whose samples are held by a worker, nearest first.
    fn held_around(&self, camera: &Camera) -> Vec<u64> {
        let placed: Vec<u64> = self.samples.placement().placed().collect();
        let around = self.samples.set().rig.nearest_among(
            camera,
            AROUND,
            CandidateCameras { refined: &placed, sight: None },
        );
        let faces = |index: &u64| self.samples.locations().faces_held(self.samples.served(*index));
        let held = around.into_iter().filter(|index| !faces(index).is_empty());
        held.take(MOST_HELD).collect()
    }

    /// Cameras near a viewer for a camera set, held or not: the corners of the viewer's cell, then refinements.
    fn cameras_around(&self, camera: &Camera) -> Vec<u64> {
        let rig = &self.samples.set().rig;
        let own = rig.nearest_among(camera, MOST_HELD, CandidateCameras::default());
        let nearer = (1..=FINEST_LEVEL).filter_map(|level| rig.refinement(camera, level, None));
        let mut around: Vec<u64> = own.into_iter().chain(nearer).collect();
        around.dedup();
        around
    }

    /// The time that a view saved by its samples. Rendering it took `ms`.
    pub(super) fn savings(&self, view: &Pending, open: &OpenView, ms: f64) -> Option<Output> {
        let worker = view.worker.and_then(|id| self.workers.get(id))?;
        let work = view.pixels.saturating_mul(u64::from(open.direct.samples_per_pixel));
        let direct = self.direct_cost(worker, Detail::Full)?;
        Some(Output::Saved { cameras: view.cameras(), secs: (direct.ms(work) - ms) * 1e-3 })
    }

    /// Seconds that a view from samples is cheaper than one from triangles. `pixels` counts sub-pixels. `None` until
    /// a worker measured both.
    pub(super) fn saved_secs(&self, pixels: u64) -> Option<f64> {
        let ms = |w: &Worker| Some(w.report().direct_cost?.ms(pixels) - w.report().warp_cost?.ms(pixels));
        self.workers.iter().find_map(ms).map(|ms| ms * 1e-3)
    }

    /// The cameras whose samples would have kept the view's bound, each with the faces in which it shows the view: only the
    /// rig's own if these are enough. `None` if no cameras would.
    pub(super) fn camera_set(&self, estimate: &CoverageEstimate) -> Option<Faces> {
        let own = estimate.choose(|index| self.samples.set().rig.level(index) == Some(0), MOST_SAMPLES);
        let meets_coverage =
            |camera_set: &Vec<u64>| predicted_excess(Some(estimate.coverage(camera_set)), 1.0).1;
        let any = || Some(estimate.choose(|_| true, MOST_SAMPLES)).filter(meets_coverage);
        let cameras = Some(own).filter(meets_coverage).or_else(any)?;
        let with_faces = cameras.into_iter().map(|index| (index, estimate.faces(index)));
        // One that shows nothing of the view is no part of it.
        Some(with_faces.filter(|(_, faces)| !faces.is_empty()).collect())
    }

    /// The offers of workers with room for a view.
    pub(super) fn offers(&self, view: &Pending, open: &OpenView, now: Uptime) -> Vec<Offer> {
        let asked = self.asked(view, open);
        let mut cached = CachedPlans::new();
        let mut offers = Vec::new();
        for worker in asked {
            let entry = worker.queue_entry();
            let tie_break = (entry.queued, entry.dispatched);
            let wait_ms = self.wait_before(worker, now);
            let work = view.pixels.saturating_mul(u64::from(open.direct.samples_per_pixel));
            let id = worker.id();
            let in_detail = |detail: Detail| {
                let plan =
                    Plan::Direct { samples_per_pixel: open.direct.samples_per_pixel, detail, light: None };
                let cost = self.direct_cost(worker, detail);
                let render_ms = cost.map(|cost| cost.ms(plan.sub_pixels(view.pixels)));
                let (excess, meets_coverage) = (excess_of(detail), true);
                let repeats = self.repeats(worker, open, &plan);
                Offer { worker: id, tie_break, plan, wait_ms, render_ms, excess, meets_coverage, repeats }
            };
            let base = in_detail(Detail::Full);
            let warp_ms = self.warp_cost(worker).map(|cost| cost.ms(work));
            for from_samples in self.plans_from_samples(worker, view, open, &mut cached) {
                let FromSamples { plan, uncovered, excess, meets_coverage } = from_samples;
                let rays_ms = worker.report().ray_ms.unwrap_or(0.0) * uncovered * view.pixels as f64;
                let render_ms = warp_ms.map(|ms| ms + rays_ms);
                let repeats = self.repeats(worker, open, &plan);
                offers.push(Offer { plan, render_ms, excess, meets_coverage, repeats, ..base.clone() });
            }
            offers.extend(self.offer_from_frames(worker, view, open, &base));
            offers.push(base);
            // Less detail is worth nothing until its cost is known.
            let reduced = Detail::ALL.into_iter().skip(1).map(in_detail);
            offers.extend(reduced.filter(|offer| offer.render_ms.is_some()));
        }
        offers
    }

    /// Workers that are asked for offers: healthy, with room, and without a failure at this view.
    fn asked(&self, view: &Pending, open: &OpenView) -> Vec<&Worker> {
        let has_room = |worker: &&Worker| worker.queued() < self.room_of(worker);
        let untried = |worker: &&Worker| !view.tried.contains(&worker.id());
        let front = self.workers.queues().anyone().iter().take(MOST_ASKED + view.tried.len());
        let mut ids: Vec<WorkerId> = front.map(|entry| entry.worker).collect();
        if self.workers.queues().anyone().len() > ids.len() {
            let is_of_rig = |index: u64| self.samples.set().rig.level(index).is_some();
            let best =
                open.estimate.as_ref().and_then(|estimate| estimate.choose(is_of_rig, 1).first().copied());
            let from = ids.first().copied().unwrap_or(WorkerId(0));
            let holders = best
                .into_iter()
                .flat_map(|index| self.samples.locations().any_near(self.samples.served(index), from));
            ids.extend(holders.take(MOST_ASKED));
        }
        let able = |ids: &[WorkerId]| -> Vec<&Worker> {
            ids.iter()
                .filter_map(|id| self.workers.get(*id))
                .filter(|w| w.answers())
                .filter(has_room)
                .collect()
        };
        let asked = able(&ids);
        let fresh: Vec<&Worker> = asked.iter().copied().filter(untried).collect();
        let free = fresh.iter().copied().filter(|worker| !self.leaves_views(worker));
        let free: Vec<&Worker> = free.collect();
        if !free.is_empty() {
            return free;
        }
        if !fresh.is_empty() {
            return fresh;
        }
        if !asked.is_empty() || !self.workers.queues().anyone().is_empty() {
            return asked;
        }
        // Suspected and failing workers are the last resort.
        self.workers.iter().filter(|w| w.is_ready()).filter(has_room).collect()
    }

    /// Number of views that a worker may have. Until its price is known, all but a few wait here: then there is time for each, or
    /// less detail.
    fn room_of(&self, worker: &Worker) -> usize {
        match worker.report().direct_cost {
            Some(_) => self.config.max_views_per_worker,
            None => MOST_UNPRICED.min(self.config.max_views_per_worker),
        }
    }

    /// Milliseconds that a view may take whose cheapest way within its bound takes `ms`.
    pub(super) fn most_ms(&self, load: &Load, ms: f64, now: Uptime) -> f64 {
        load.most_ms(ms, self.work(now), now)
    }

    /// What there is to do, and the workers that do it.
    pub(super) fn work(&self, now: Uptime) -> Work {
        Work { queued_ms: self.workers.iter().map(|w| w.queued_ms(now)).sum(), processes: self.free() }
    }

    /// Whether a worker leaves views to the others, if there are others: it renders samples at once, or it measures a price that a
    /// decision lacks.
    fn leaves_views(&self, worker: &Worker) -> bool {
        self.samples.renders_at_once(worker.id()) || (self.others_carry && worker.is_measuring())
    }

    /// All workers that answer views, counted as in [`Work::processes`].
    pub(super) fn answering(&self) -> f64 {
        self.count(|_| true)
    }

    /// The workers that answer views and do not sample, counted alike.
    pub(super) fn without_samplers(&self) -> f64 {
        self.count(|worker| !worker.role().is_some_and(Role::samples))
    }

    /// The workers that answer views and leave none to others, counted alike; all that answer, if each leaves views.
    fn free(&self) -> f64 {
        match self.count(|worker| !self.leaves_views(worker)) {
            0.0 => self.answering(),
            free => free,
        }
    }

    /// Counts such workers that answer views, each by its speed over the predicted one.
    fn count(&self, such: impl Fn(&Worker) -> bool) -> f64 {
        let counted = self.workers.iter().filter(|worker| worker.answers() && such(worker));
        counted.map(|worker| 1.0 / worker.slowdown()).sum()
    }

    /// Cost of a view from triangles at a worker, by the pixels that are rendered: as measured by it or by a worker with the same
    /// device.
    fn direct_cost(&self, worker: &Worker, detail: Detail) -> Option<Cost> {
        self.cost_at(worker, |report| match detail.ray_divisor() {
            1 => report.direct_cost,
            _ => report.few_rays_cost,
        })
    }

    /// Cost of a view from samples at a worker, alike.
    fn warp_cost(&self, worker: &Worker) -> Option<Cost> {
        self.cost_at(worker, |report| report.warp_cost)
    }

    /// A cost as measured by a worker, or else by one with the same device.
    fn cost_at(&self, worker: &Worker, of: impl Fn(&Report) -> Option<Cost>) -> Option<Cost> {
        let alike = || {
            let same = self.workers.iter().filter(|other| other.hello().device == worker.hello().device);
            same.take(MOST_ASKED).find_map(|other| of(other.report()))
        };
        of(worker.report()).or_else(alike)
    }

    /// Milliseconds until a worker can begin another view.
    fn wait_before(&self, worker: &Worker, now: Uptime) -> f64 {
        let samples = f64::from(worker.report().queued_samples) * worker.report().sample_ms.unwrap_or(0.0);
        let slices = if self.samples.is_refining(worker) { HALF_SLICE_MS } else { 0.0 };
        let measuring = if worker.is_measuring() { MEASURING_MS } else { 0.0 };
        worker.queued_ms(now) + samples + slices + measuring
    }

    /// The judged cameras whose samples a worker holds, with the faces that it holds. Without an estimate: the nearest
    /// cameras, if the worker holds all of them.
    fn held_for(&self, worker: &Worker, view: &Pending, open: &OpenView) -> Faces {
        let faces = |index: u64| self.samples.locations().faces(self.samples.served(index), worker.id());
        match &open.estimate {
            Some(estimate) => {
                let held = estimate.cameras().map(|index| (index, faces(index)));
                held.filter(|(_, faces)| !faces.is_empty()).collect()
            }
            None => {
                let near = CandidateCameras { refined: self.samples.placement().usable(), sight: None };
                let nearest = self.samples.set().rig.nearest_among(&view.camera, MOST_SAMPLES, near);
                let whole = nearest.into_iter().map(|index| (index, FaceMask::ALL));
                let has = |&(index, whole): &(u64, FaceMask)| faces(index) == whole;
                if whole.clone().all(|camera| has(&camera)) { whole.collect() } else { Vec::new() }
            }
        }
    }

    /// Plans of a view from samples that a worker holds: from the best ones, and from those of the frame to be
    /// repeated. Empty if the worker did not measure the cost of views from samples, or lacks the set's reflection probes.
    fn plans_from_samples(
        &self,
        worker: &Worker,
        view: &Pending,
        open: &OpenView,
        cached: &mut CachedPlans,
    ) -> Vec<FromSamples> {
        if self.warp_cost(worker).is_none() || !self.holds_probes(worker) {
            return Vec::new();
        }
        let best_of = |held: &Faces| match &open.estimate {
            Some(estimate) => {
                let held_of = |index| held.iter().find(|(held, _)| *held == index);
                let faces = |index| held_of(index).map_or(FaceMask::NONE, |(_, faces)| *faces);
                self.warp_from(&estimate.choose_by_faces(faces, MOST_SAMPLES), open)
            }
            None => self.warp_from(held, open),
        };
        let best = cached.entry(self.held_for(worker, view, open)).or_insert_with_key(best_of).clone();
        let again = self.held_again(worker, open).and_then(|cameras| self.warp_from(&cameras, open));
        let is_other = |again: &FromSamples| best.as_ref().is_none_or(|best| best.plan != again.plan);
        let again = again.filter(is_other);
        best.into_iter().chain(again).collect()
    }

    /// Whether a worker holds the set's reflection probes, if there are any.
    fn holds_probes(&self, worker: &Worker) -> bool {
        let probes = self.samples.served(SampleId::REFLECTION_PROBES);
        self.samples.set().reflections.is_none() || self.samples.locations().has(probes, worker.id())
    }

    /// The cameras of the frame to be repeated and the faces that it uses, if a worker holds all of them.
    fn held_again(&self, worker: &Worker, open: &OpenView) -> Option<Faces> {
        let memory = open.memory.as_ref()?;
        let again: Vec<SampleId> = memory.samples().collect();
        let has = |id: &SampleId| {
            self.samples.locations().faces(*id, worker.id()).contains(memory.faces(id.camera))
        };
        let has_all = again.iter().all(|id| has(id) && *id == self.samples.served(id.camera));
        has_all.then(|| again.iter().map(|id| (id.camera, memory.faces(id.camera))).collect())
    }

    /// Whether a plan at a worker repeats the session's last frame.
    pub(super) fn repeats(&self, worker: &Worker, open: &OpenView, plan: &Plan) -> bool {
        let (device, state) = (&worker.hello().device, self.samples.set().version.state);
        open.memory.as_ref().is_some_and(|memory| memory.is_repeated_by(plan, state, device))
    }

    /// The plan of a view from these faces of cameras' samples; `None` without cameras.
    fn warp_from(&self, cameras: &[(u64, FaceMask)], open: &OpenView) -> Option<FromSamples> {
        if cameras.is_empty() {
            return None;
        }
        let ids = cameras.iter().map(|(index, _)| self.samples.served(*index)).collect();
        let samples = self.samples.set().with_reflection_probes(ids);
        let coverage = open.estimate.as_ref().map(|estimate| estimate.coverage_by_faces(cameras));
        let (excess, meets_coverage) = predicted_excess(coverage, self.samples.error_factor());
        let search = Search::default();
        let supersampling = open.direct.samples_per_pixel.isqrt();
        let steps = self.config.steps_of(search);
        let faces = cameras.iter().copied().collect();
        let plan = Plan::Warp(Warp {
            search,
            steps,
            supersampling,
            samples,
            faces,
            holes: Holes::Trace,
            ..Warp::default()
        });
        let uncovered = coverage.map_or(0.0, |coverage| 1.0 - coverage.covered);
        Some(FromSamples { plan, uncovered, excess, meets_coverage })
    }
}
