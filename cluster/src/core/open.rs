//! Views whose request leaves the way open: what workers could do about them, for the planner to choose from.

use std::collections::HashMap;

use argus_scene::frame::Decision;
use argus_scene::rig::{Among, Sight, Survey};
use argus_scene::{Camera, Holes, Plan, Rig, SampleId, Search, View, Warp};

use super::event::{Action, Source, Ticket, WorkerId};
use super::machine::Core;
use super::pending::Pending;
use super::plan::samples_per_pixel;
use super::planner::{self, Aim, MOST_TEXEL_PIXELS, Offer, predicted_excess};
use super::worker::Worker;

/// Workers with the shortest queues that are asked for an offer, and holders of samples beside them.
const MOST_ASKED: usize = 64;

/// Samples of a plan at most: further ones cost more than they show.
const MOST_SAMPLES: usize = 4;

/// Cameras around a viewer that are looked at for samples that somebody holds, nearest first.
const AROUND: usize = 24;

/// Cameras of held samples that a view is surveyed for, at most.
const MOST_HELD: usize = 8;

/// The finest level of refinement that a bundle may have: finer cameras serve too few viewers.
const FINEST_LEVEL: u32 = 2;

/// Sub-samples of a texel, usually.
const SUB_SAMPLES: u64 = 4;

/// Seconds of a single ray until some were measured.
const USUAL_RAY_SECS: f64 = 2e-6;

/// Longest time that a view waits for work that nobody waits for, milliseconds: half of a slice, on the mean.
const HALF_SLICE_MS: f64 = 10.0;

/// What the planner goes by for one view.
#[derive(Debug, Clone)]
pub(super) struct OpenView {
    /// Of a direct view.
    pub(super) samples_per_pixel: u32,
    pub(super) aim: Aim,
    /// What it will show, where that is known.
    pub(super) survey: Option<Box<Survey>>,
    /// How it was last decided to be answered.
    pub(super) decision: Option<Decision>,
}

impl OpenView {
    /// Of a view that is not pinned and whose request leaves the way open.
    pub(super) fn of(view: &View, survey: Option<Box<Survey>>) -> Option<Box<Self>> {
        let open = view.pin.is_none() && view.plan.leaves_way_open();
        let samples_per_pixel = samples_per_pixel(&view.plan);
        let aim = Aim::of(&view.plan);
        open.then(|| Box::new(Self { samples_per_pixel, aim, survey, decision: None }))
    }
}

/// A view from some samples.
#[derive(Debug, Clone)]
struct FromSamples {
    plan: Plan,
    /// Share of the view that the samples miss, and that is traced.
    uncovered: f64,
    /// Predicted mean FLIP above that of a direct view.
    excess: f64,
    /// Whether the samples see enough of the view, with fine texels.
    is_sound: bool,
}

/// What is to be found out about a view before it is asked for. The rays are sent outside of the core.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyWanted {
    rig: Rig,
    time_secs: f64,
    candidates: Vec<u64>,
    /// Whether all is to be known of each candidate, and not only what it takes to choose some of them.
    whole: bool,
}

impl SurveyWanted {
    /// Sends the rays.
    pub fn take(&self, view: &View, sight: &dyn Sight) -> Survey {
        self.take_after(None, view, sight)
    }

    /// Whether what another survey finds out holds for this one.
    pub fn is_of_same_scene(&self, other: &Self) -> bool {
        self.rig == other.rig && self.time_secs == other.time_secs
    }

    /// Sends the rays whose answers a survey of the same scene does not tell.
    pub fn take_after(&self, before: Option<&Survey>, view: &View, sight: &dyn Sight) -> Survey {
        let (camera, size) = (&view.camera, [view.width, view.height]);
        let mut survey = match before {
            Some(before) => before.renewed(camera, size, sight, self.time_secs),
            None => Survey::new(camera, size, sight, self.time_secs),
        };
        match self.whole {
            true => self.candidates.iter().for_each(|&index| {
                survey.judge(&self.rig, index, sight, self.time_secs, MOST_TEXEL_PIXELS);
            }),
            false => {
                let sight = (sight, self.time_secs);
                survey.judge_few(&self.rig, &self.candidates, MOST_SAMPLES, sight, MOST_TEXEL_PIXELS);
            }
        }
        survey
    }
}

impl Core {
    /// What is to be found out about a view before it is asked for; `None` where that would change nothing: its way is not
    /// open, or nobody holds a sample near it.
    pub fn survey_wanted(&self, view: &View) -> Option<SurveyWanted> {
        let open = view.pin.is_none() && view.plan.leaves_way_open();
        self.survey_of(if open { self.held_around(&view.camera) } else { Vec::new() }, false)
    }

    /// What is to be found out about a view, while nobody waits for it, to see which samples would be worth their price;
    /// [`Event::Surveyed`](super::Event::Surveyed) brings the answer. `None` for most views: a few a second tell enough.
    pub fn thought_wanted(&self, view: &View) -> Option<SurveyWanted> {
        let open = view.pin.is_none() && view.plan.leaves_way_open();
        let may_pay = self.workers.values().any(|worker| worker.report.warp_cost.is_some());
        let left = self.thoughts.get().checked_sub(1).filter(|_| open && may_pay)?;
        self.thoughts.set(left);
        self.survey_of(self.cameras_around(&view.camera), true)
    }

    fn survey_of(&self, candidates: Vec<u64>, whole: bool) -> Option<SurveyWanted> {
        let (rig, time_secs) = (self.set.rig, self.set.time_secs());
        (!candidates.is_empty()).then_some(SurveyWanted { rig, time_secs, candidates, whole })
    }

    /// Cameras near a viewer whose samples somebody holds, nearest first.
    fn held_around(&self, camera: &Camera) -> Vec<u64> {
        let placed: Vec<u64> = self.placement.placed().collect();
        let around = self.set.rig.nearest_among(camera, AROUND, Among { refined: &placed, sight: None });
        let held = around.into_iter().filter(|index| self.whereabouts.is_held(self.served(*index)));
        held.take(MOST_HELD).collect()
    }

    /// Cameras near a viewer that a bundle could take, whether or not somebody holds their samples: the corners of the
    /// viewer's cell, then nearer ones.
    fn cameras_around(&self, camera: &Camera) -> Vec<u64> {
        let rig = &self.set.rig;
        let own = rig.nearest_among(camera, MOST_HELD, Among::default());
        let nearer = (1..=FINEST_LEVEL).filter_map(|level| rig.refinement(camera, level, None));
        let mut around: Vec<u64> = own.into_iter().chain(nearer).collect();
        around.dedup();
        around
    }

    /// A view whose way was open took so many milliseconds of rendering: samples that it used have saved some.
    pub(super) fn learn_savings(&mut self, view: &Pending, open: &OpenView, ms: f64) {
        if view.is_direct() {
            self.unthought += 1;
            return;
        }
        let Some(worker) = view.worker.and_then(|id| self.workers.get(&id)) else { return };
        let work = view.pixels.saturating_mul(u64::from(open.samples_per_pixel));
        let Some(direct) = self.direct_cost(worker) else { return };
        let used: Vec<u64> = view.samples().iter().map(|id| id.index).collect();
        let pixels = self.pixels_for((direct.ms(work) - ms) * 1e-3);
        self.placement.credit(&used, pixels / used.len().max(1) as f64);
    }

    /// What a view of so many pixels, sub-pixels counted, shows is known: its bundle would have saved some time of that
    /// view, and of those like it since the last one that was looked at.
    pub(super) fn learn_thought(&mut self, pixels: u64, survey: &Survey) {
        let measured = |w: &Worker| Some((w.report.direct_cost?.ms(pixels), w.report.warp_cost?.ms(pixels)));
        let Some((direct_ms, warp_ms)) = self.workers.values().find_map(measured) else { return };
        let own = survey.choose(|index| self.set.rig.level(index) == Some(0), MOST_SAMPLES);
        let is_sound = |bundle: &[u64]| predicted_excess(Some(survey.coverage(bundle)), 1.0).1;
        let bundle = match is_sound(&own) {
            true => own,
            false => survey.choose(|_| true, MOST_SAMPLES),
        };
        let views = f64::from(std::mem::take(&mut self.unthought));
        if is_sound(&bundle) {
            self.investments.learn(bundle, views * (direct_ms - warp_ms) * 1e-3);
        }
    }

    /// Ticks have passed: the bundle that is worth most for its price is rendered, one after the other.
    pub(super) fn invest(&mut self, ticks: f64) {
        self.investments.tick(ticks);
        let is_coming =
            |index: u64| self.placement.is_placed(index) && !self.whereabouts.is_held(self.served(index));
        if !(self.config.refining_share > 0.0) || self.placement.placed().any(is_coming) {
            return;
        }
        let Some(sample_secs) = self.sample_price_secs() else { return };
        let missing = |bundle: &[u64]| -> Vec<u64> {
            let lacks = |index: &u64| !self.whereabouts.is_held(self.served(*index));
            bundle.iter().copied().filter(lacks).collect()
        };
        let price = |bundle: &[u64]| sample_secs * missing(bundle).len() as f64;
        let ticks_an_epoch = match self.epochs.moves() {
            true => self.config.epoch.as_secs_f64() / self.config.tick.as_secs_f64(),
            false => f64::INFINITY,
        };
        let Some((bundle, secs)) = self.investments.best(price, ticks_an_epoch) else { return };
        let (bundle, missing) = (bundle.to_vec(), missing(bundle));
        let most = (self.config.refining_bytes / self.sample_bytes().max(1)) as usize;
        if self.placement.placed().count() + missing.len() > most {
            return;
        }
        let pixels = self.pixels_for(secs) / bundle.len() as f64;
        bundle.iter().for_each(|index| self.placement.invest(*index, pixels));
        self.rates.samples.count(missing.len() as u64);
        self.to_refine = true;
    }

    /// Seconds of one process that a sample takes: as measured, or else as a direct view of its texels with four sub-samples
    /// each would.
    fn sample_price_secs(&self) -> Option<f64> {
        let texels = self.set.rig.sample_texels() * SUB_SAMPLES;
        let as_a_view = || {
            let cost = self.workers.values().find_map(|worker| worker.report.direct_cost);
            cost.map(|cost| cost.ms(texels) * 1e-3)
        };
        self.costs.sample.value().or_else(as_a_view).filter(|secs| *secs > 0.0)
    }

    /// How many pixels of holes are worth so many seconds of one process: as many as rays would be traced in that time.
    fn pixels_for(&self, secs: f64) -> f64 {
        let ray_secs = self.costs.ray.value().unwrap_or(USUAL_RAY_SECS).max(1e-9);
        secs.max(0.0) / ray_secs
    }

    /// The sample of a camera at the epoch that is served.
    fn served(&self, index: u64) -> SampleId {
        SampleId { epoch: self.set.epoch, generation: self.set.generation, index }
    }

    /// Decides how a view is answered and by whom, and gives it to that worker; false if no worker has room.
    pub(super) fn place_open(&mut self, ticket: Ticket, actions: &mut Vec<Action>) -> bool {
        let Some(view) = self.views.get(&ticket) else { return true };
        let Some(open) = &view.open else { return true };
        let Some((offer, decision)) = planner::choose(self.offers(view, open), &open.aim) else {
            return false;
        };
        let is_first = view.attempt == 0;
        let Some(view) = self.views.get_mut(&ticket) else { return true };
        self.in_flight.subtract(view);
        view.plan = offer.plan;
        view.epoch = self.set.epoch;
        if let Some(open) = &mut view.open {
            open.decision = Some(decision);
        }
        self.in_flight.add(view);
        let samples = view.samples().to_vec();
        if is_first {
            match view.is_direct() {
                true => self.rates.direct_anywhere.count(1),
                false => self.rates.views.count(1),
            }
        }
        let at_hand = |&id: &SampleId| Source { id, addresses: Vec::new(), dispensable: true };
        let sources = samples.iter().map(at_hand).collect();
        self.dispatch(ticket, offer.worker, &samples, sources, actions);
        true
    }

    /// What workers with room could do about a view.
    fn offers(&self, view: &Pending, open: &OpenView) -> Vec<Offer> {
        let asked = self.asked(view, open);
        // Workers mostly hold the same: what a set of samples comes to is found out once.
        let mut known: HashMap<Vec<u64>, Option<FromSamples>> = HashMap::new();
        let mut offers = Vec::new();
        for worker in asked {
            let turn = (worker.views.len(), worker.dispatched);
            let wait_ms = self.wait_before(worker);
            let cost = self.direct_cost(worker);
            let work = view.pixels.saturating_mul(u64::from(open.samples_per_pixel));
            let base = Offer {
                worker: worker.id,
                turn,
                plan: Plan::Direct { samples_per_pixel: open.samples_per_pixel },
                wait_ms,
                render_ms: cost.map(|cost| cost.ms(work)),
                excess: 0.0,
                is_sound: true,
            };
            let (Some(warp_cost), held) = (worker.report.warp_cost, self.held_for(worker, view, open)) else {
                offers.push(base);
                continue;
            };
            let plan = known.entry(held.clone()).or_insert_with(|| self.warp_from(&held, open));
            if let Some(FromSamples { plan, uncovered, excess, is_sound }) = plan.clone() {
                let rays_ms = worker.report.ray_ms.unwrap_or(0.0) * uncovered * view.pixels as f64;
                let render_ms = Some(warp_cost.ms(work) + rays_ms);
                offers.push(Offer { plan, render_ms, excess, is_sound, ..base.clone() });
            }
            offers.push(base);
        }
        offers
    }

    /// Workers that are asked for an offer: those that answer, with room, which have not failed at the view.
    fn asked(&self, view: &Pending, open: &OpenView) -> Vec<&Worker> {
        let has_room = |worker: &&Worker| worker.views.len() < self.config.max_views_per_worker;
        let untried = |worker: &&Worker| !view.tried.contains(&worker.id);
        let front = self.lines.anyone().iter().take(MOST_ASKED + view.tried.len());
        let mut ids: Vec<WorkerId> = front.map(|turn| turn.worker).collect();
        if self.lines.anyone().len() > ids.len() {
            let best = open.survey.as_ref().and_then(|survey| survey.choose(|_| true, 1).first().copied());
            let from = ids.first().copied().unwrap_or(WorkerId(0));
            let holders = best.into_iter().flat_map(|index| self.whereabouts.near(self.served(index), from));
            ids.extend(holders.take(MOST_ASKED));
        }
        let able = |ids: &[WorkerId]| -> Vec<&Worker> {
            ids.iter()
                .filter_map(|id| self.workers.get(id))
                .filter(|w| w.answers())
                .filter(has_room)
                .collect()
        };
        let mut asked = able(&ids);
        if asked.iter().any(|worker| !worker.is_measuring()) {
            asked.retain(|worker| !worker.is_measuring());
        }
        let fresh: Vec<&Worker> = asked.iter().copied().filter(untried).collect();
        if !fresh.is_empty() {
            return fresh;
        }
        if !asked.is_empty() || !self.lines.anyone().is_empty() {
            return asked;
        }
        // Whoever seems to hang, or fails, is asked where there is nobody else.
        self.workers.values().filter(|w| w.is_ready()).filter(has_room).collect()
    }

    /// What a view from triangles costs at a worker: what it measured, or else what those with the same device did.
    fn direct_cost(&self, worker: &Worker) -> Option<super::quality::Cost> {
        let alike = || {
            let same = self.workers.values().filter(|other| other.hello.device == worker.hello.device);
            same.take(MOST_ASKED).find_map(|other| other.report.direct_cost)
        };
        worker.report.direct_cost.or_else(alike)
    }

    /// Milliseconds of what a worker has to do before another view.
    pub(super) fn wait_before(&self, worker: &Worker) -> f64 {
        let samples = f64::from(worker.report.queued_samples) * worker.report.sample_ms.unwrap_or(0.0);
        let slices = if worker.is_refining() { HALF_SLICE_MS } else { 0.0 };
        worker.queued_ms() + samples + slices
    }

    /// The cameras that were surveyed whose samples a worker holds; without a survey, the nearest ones if it has all.
    fn held_for(&self, worker: &Worker, view: &Pending, open: &OpenView) -> Vec<u64> {
        let has = |index: u64| worker.has(self.served(index));
        match &open.survey {
            Some(survey) => survey.cameras().filter(|index| has(*index)).collect(),
            None => {
                let near = Among { refined: self.placement.usable(), sight: None };
                let nearest = self.set.rig.nearest_among(&view.camera, MOST_SAMPLES, near);
                if nearest.iter().all(|index| has(*index)) { nearest } else { Vec::new() }
            }
        }
    }

    /// What a view would be from the best of those cameras' samples; `None` without samples.
    fn warp_from(&self, held: &[u64], open: &OpenView) -> Option<FromSamples> {
        let cameras = match &open.survey {
            Some(survey) => survey.choose(|index| held.contains(&index), MOST_SAMPLES),
            None => held.to_vec(),
        };
        if cameras.is_empty() {
            return None;
        }
        let ids = cameras.iter().map(|index| self.served(*index)).collect();
        let samples = self.set.with_surroundings(ids);
        let coverage = open.survey.as_ref().map(|survey| survey.coverage(&cameras));
        let (excess, is_sound) = predicted_excess(coverage, self.error.factor());
        let search = Search::default();
        let supersampling = open.samples_per_pixel.isqrt();
        let steps = self.config.steps_of(search);
        let plan = Plan::Warp(Warp { search, steps, supersampling, samples, holes: Holes::Trace });
        let uncovered = coverage.map_or(0.0, |coverage| 1.0 - coverage.covered);
        Some(FromSamples { plan, uncovered, excess, is_sound })
    }
}
