//! A crowd on a simulated cluster: the coordinator's core decides, and workers take the times that are told, in slices as real ones.
//!
//! Viewers stand before a wall at a distance, or walk along it. A worker answers one view at a time, and renders sources in slices of
//! 20 ms, after each of which waiting views have 60. Errors are those that the core predicts.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use argus_scene::{Camera, Detail, FrameSource, Plan, PlanRequest, SampleId, SceneState, View, Visibility};
use glam::DVec3;

use super::sim::Sim;
use crate::core::market::source_grid::POINTS;
use crate::core::quality::Cost;
use crate::core::*;

/// Seconds of a step.
const STEP: f64 = 0.002;
/// Seconds of a slice, and those that waiting views have after it.
const SLICE: f64 = 0.02;
const OWED: f64 = 0.06;
/// Distance of the wall that viewers look at, metres.
const WALL: f64 = 6.0;
/// Pixels of a view.
const SIZE: [u32; 2] = [200, 150];

/// What a crowd does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crowd {
    pub(super) workers: usize,
    pub(super) viewers: u32,
    /// Views a second of all, as a multiple of what all workers carry from triangles.
    pub(super) times: f64,
    /// Metres that a viewer walks in a second, never back; 0: it sways about its place.
    pub(super) speed: f64,
    /// Seconds of a view from triangles.
    pub(super) full_secs: f64,
    /// K at first.
    pub(super) first_k: u32,
    /// Whether K is held at its first value.
    pub(super) holds_k: bool,
}

impl Default for Crowd {
    fn default() -> Self {
        let (times, speed, full_secs) = (3.0, 0.0, 0.08);
        Self { workers: 2, viewers: 16, times, speed, full_secs, first_k: 1, holds_k: false }
    }
}

/// An answered or refused view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answered {
    pub(super) asked_at: f64,
    pub(super) viewer: u32,
    /// Seconds until its answer; `None`: refused.
    pub(super) secs: Option<f64>,
    pub(super) excess: f64,
    pub(super) kind: Kind,
}

/// How a view was answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Full,
    Reduced,
    Warped,
    Refused,
}

#[derive(Default)]
struct Hands {
    queue: VecDeque<(ViewId, f64)>,
    /// The source in work, and seconds that are left of it and of its slice.
    source: Option<(Purchase, f64)>,
    slice: f64,
    owed: f64,
    held: BTreeSet<SampleId>,
    done: Vec<FrameSource>,
}

/// A crowd in work.
pub(super) struct Run {
    crowd: Crowd,
    pub(super) sim: Sim,
    pub(super) secs: f64,
    hands: BTreeMap<WorkerId, Hands>,
    known: BTreeMap<SampleId, HeldSource>,
    asked: BTreeMap<ViewId, (f64, u32)>,
    next_view: f64,
    count: u64,
    refused: usize,
    pub(super) answered: Vec<Answered>,
    /// K by tenth of a second.
    pub(super) k: Vec<u32>,
}

impl Run {
    pub(super) fn new(crowd: Crowd) -> Self {
        let mut sim = Sim::new(Config::default());
        let mut hands = BTreeMap::new();
        for i in 0..crowd.workers {
            let id = sim.join(&format!("w{i}"));
            let cost =
                |share: f64| Some(Cost { fixed_ms: crowd.full_secs * 1e3 * share, ms_per_megapixel: 0.0 });
            let report = &mut sim.workers.get_mut(&id).unwrap().report;
            (report.direct_cost, report.frame_cost, report.warp_cost) = (cost(1.0), cost(0.09), cost(0.09));
            hands.insert(id, Hands::default());
        }
        (0..3).for_each(|_| sim.report_all());
        sim.core.set_most_purchases(crowd.first_k);
        Self {
            crowd,
            sim,
            secs: 0.0,
            hands,
            known: BTreeMap::new(),
            asked: BTreeMap::new(),
            next_view: 0.0,
            count: 0,
            refused: 0,
            answered: Vec::new(),
            k: Vec::new(),
        }
    }

    /// Changes the load, as a multiple of what triangles carry.
    pub(super) fn ask_times(&mut self, times: f64) {
        self.crowd.times = times;
    }

    /// Runs for some seconds.
    pub(super) fn run(&mut self, secs: f64) -> &mut Self {
        let steps = (secs / STEP).round() as u64;
        for _ in 0..steps {
            self.secs += STEP;
            self.sim.now = Uptime(Duration::from_secs_f64(self.secs));
            while self.next_view <= self.secs {
                self.ask();
                self.next_view += self.crowd.full_secs / (self.crowd.workers as f64 * self.crowd.times);
            }
            for id in self.hands.keys().copied().collect::<Vec<_>>() {
                self.work(id);
            }
            let tick = (self.secs / STEP).round() as u64;
            if tick.is_multiple_of(50) {
                self.sim.step(Event::Tick);
                if self.crowd.holds_k {
                    self.sim.core.set_most_purchases(self.crowd.first_k);
                }
                self.k.push(self.sim.core.status().priced().most_purchases);
            }
            if tick.is_multiple_of(125) {
                self.sim.report_all();
            }
        }
        self
    }

    fn camera(&self, viewer: u32) -> Camera {
        let phase = f64::from(viewer) * 0.618;
        let group = f64::from(viewer % 4);
        let sways = (0.5 * self.secs + std::f64::consts::TAU * phase).sin();
        let x = match self.crowd.speed > 0.0 {
            true => self.crowd.speed * self.secs + 0.6 * f64::from(viewer / 4),
            false => 0.4 * sways,
        };
        let eye = DVec3::new(x, 1.7, 100.0 * group);
        let aside = 0.15 * sways;
        Camera { fov_deg: 60.0, ..Camera::look_at(eye, eye + DVec3::new(aside, 0.0, -1.0)) }
    }

    fn ask(&mut self) {
        let viewer = (self.count % u64::from(self.crowd.viewers)) as u32;
        self.count += 1;
        let view_id = ViewId(self.sim.next);
        self.sim.next += 1;
        let view = Box::new(View::new(self.camera(viewer), SIZE, PlanRequest::default()));
        let client = "a client".into();
        self.asked.insert(view_id, (self.secs, viewer));
        self.sim.step(Event::Requested { view_id, client, view, deadline: None, last: None });
        for (view_id, _) in self.sim.refused.split_off(self.refused.min(self.sim.refused.len())) {
            let Some((asked_at, viewer)) = self.asked.remove(&view_id) else { continue };
            self.answered.push(Answered { asked_at, viewer, secs: None, excess: 0.0, kind: Kind::Refused });
        }
        self.refused = self.sim.refused.len();
        self.take_orders();
    }

    /// Puts new orders into the queues of their workers.
    fn take_orders(&mut self) {
        let queued: BTreeSet<ViewId> =
            self.hands.values().flat_map(|hands| hands.queue.iter().map(|(view_id, _)| *view_id)).collect();
        for (view_id, order) in &self.sim.orders {
            if !queued.contains(view_id) {
                let secs = self.secs_of(&order.plan);
                self.hands.get_mut(&order.worker).unwrap().queue.push_back((*view_id, secs));
            }
        }
    }

    fn secs_of(&self, plan: &Plan) -> f64 {
        let share = match plan {
            Plan::Direct { detail: Detail::Full, .. } => 1.0,
            Plan::Direct { detail: Detail::FewRays, .. } => 0.95,
            Plan::Direct { detail: Detail::Quarter, .. } => 0.24,
            Plan::Direct { .. } => 0.43,
            Plan::Warp(warp) => 0.09 + 0.004 * (warp.frames.len() as f64 - 1.0),
        };
        share * self.crowd.full_secs
    }

    /// A step of one worker.
    fn work(&mut self, id: WorkerId) {
        let purchase = self.sim.workers[&id].assignments.last().map(|assigned| assigned.purchases.clone());
        let ratio = |source: &FrameSource| if source.samples_per_pixel == 4 { 3.55 } else { 1.27 };
        let full_secs = self.crowd.full_secs;
        let hands = self.hands.get_mut(&id).unwrap();
        if hands.source.is_none() {
            let new = |purchase: &&Purchase| !hands.done.contains(&purchase.source);
            let next = purchase.iter().flatten().find(new).copied();
            hands.source = next.map(|purchase| (purchase, ratio(&purchase.source) * full_secs));
        }
        let views_wait = !hands.queue.is_empty();
        if hands.slice > 0.0 || (hands.source.is_some() && (hands.owed <= 0.0 || !views_wait)) {
            hands.slice = if hands.slice > 0.0 { hands.slice } else { SLICE };
            hands.slice -= STEP;
            if hands.slice <= 0.0 {
                hands.owed = OWED;
            }
            let Some((purchase, left)) = &mut hands.source else { return };
            *left -= STEP;
            if *left <= 0.0 {
                let (purchase, secs) = (*purchase, ratio(&purchase.source) * full_secs);
                (hands.source, hands.slice) = (None, 0.0);
                hands.done.push(purchase.source);
                // As real workers do, it chooses the bands.
                let source = FrameSource { band_rows: 8, ..purchase.source };
                self.keep(id, source, purchase.state, (true, secs));
            }
            return;
        }
        let Some((view_id, left)) = hands.queue.front_mut() else { return };
        *left -= STEP;
        hands.owed -= STEP;
        if *left <= 0.0 {
            let view_id = *view_id;
            hands.queue.pop_front();
            self.answer(id, view_id);
        }
    }

    fn answer(&mut self, id: WorkerId, view_id: ViewId) {
        let Some(order) = self.sim.orders.get(&view_id).cloned() else { return };
        let (asked_at, viewer) = self.asked.remove(&view_id).unwrap();
        let kind = match &order.plan {
            Plan::Direct { detail: Detail::Full, .. } => Kind::Full,
            Plan::Direct { .. } => Kind::Reduced,
            Plan::Warp(_) => Kind::Warped,
        };
        let excess = order.decision.map_or(0.0, |decision| decision.excess);
        self.answered.push(Answered { asked_at, viewer, secs: Some(self.secs - asked_at), excess, kind });
        let ms = self.secs_of(&order.plan) * 1e3;
        self.sim.answer_taking(view_id, ms);
        // What was fetched for it is held, too.
        for source in &order.sources {
            let held = self.known[&source.id].clone();
            self.report(id, HeldSource { render_ms: 0.0, ..held });
        }
        if order.keeps_frame && kind == Kind::Full {
            let camera = self.camera(viewer);
            let source = FrameSource {
                camera,
                width: SIZE[0],
                height: SIZE[1],
                samples_per_pixel: 1,
                band_rows: 0,
                light: None,
            };
            self.keep(id, source, order.state, (false, 0.0));
        }
        self.take_orders();
    }

    /// A worker keeps a source, and reports it.
    fn keep(&mut self, id: WorkerId, source: FrameSource, state: SceneState, (bought, secs): (bool, f64)) {
        let sample = SampleId { version: SampleId::FRAMES, camera: source.number() };
        let grid = market::ViewGrid::new(&source.camera, [source.width, source.height]);
        let ranges: Vec<f32> = (0..POINTS).map(|i| (-grid.ray(i).z / WALL).max(0.0) as f32).collect();
        let held = HeldSource {
            id: sample,
            source,
            state,
            visibility: Visibility::default(),
            ranges: Arc::from(ranges),
            bought,
            render_ms: (secs * 1e3) as f32,
        };
        self.report(id, held);
    }

    fn report(&mut self, id: WorkerId, held: HeldSource) {
        self.known.insert(held.id, held.clone());
        self.hands.get_mut(&id).unwrap().held.insert(held.id);
        let report = &mut self.sim.workers.get_mut(&id).unwrap().report;
        report.sources = Some(SourceNews { whole: false, added: vec![held], dropped: Vec::new() });
        self.sim.report(id);
        self.sim.workers.get_mut(&id).unwrap().report.sources = None;
    }

    /// The views that were asked for from one second to another.
    pub(super) fn between(&self, from: f64, to: f64) -> Figures {
        Figures(self.answered.iter().filter(|view| (from..to).contains(&view.asked_at)).copied().collect())
    }
}

/// Views of a time.
pub(super) struct Figures(pub(super) Vec<Answered>);

impl Figures {
    pub(super) fn excess(&self) -> f64 {
        self.0.iter().map(|view| view.excess).sum::<f64>() / self.0.len() as f64
    }

    pub(super) fn share(&self, kind: Kind) -> f64 {
        self.0.iter().filter(|view| view.kind == kind).count() as f64 / self.0.len() as f64
    }

    /// A quantile of the answers' milliseconds.
    pub(super) fn ms(&self, share: f64) -> f64 {
        let mut secs: Vec<f64> = self.0.iter().filter_map(|view| view.secs).collect();
        secs.sort_by(f64::total_cmp);
        secs[((secs.len() - 1) as f64 * share) as usize] * 1e3
    }

    /// Share of a viewer's consecutive views that are answered in another way than the one before.
    pub(super) fn changes(&self) -> f64 {
        let mut last = BTreeMap::new();
        let mut views = self.0.clone();
        views.sort_by(|a, b| a.asked_at.total_cmp(&b.asked_at));
        let changed =
            |view: &&Answered| last.insert(view.viewer, view.kind).is_some_and(|kind| kind != view.kind);
        let count = views.len();
        views.iter().filter(changed).count() as f64 / count as f64
    }
}

#[test]
fn a_crowd_at_three_times_what_triangles_carry_is_served_from_sources() {
    let mut run = Run::new(Crowd::default());
    let views = run.run(20.0).between(5.0, 20.0);
    assert!(views.share(Kind::Warped) > 0.95, "{}", views.share(Kind::Warped));
    assert!(views.excess() < 0.01, "{}", views.excess());
    assert!(views.ms(0.5) < 20.0 && views.ms(0.99) < 100.0, "{} {}", views.ms(0.5), views.ms(0.99));
    assert_eq!(views.share(Kind::Refused), 0.0);
    assert!(views.changes() < 0.05, "{}", views.changes());
    let market = run.sim.core.status().priced();
    assert!(market.purchases > 0 && market.sources_bought > 0 && market.speed_up > 3.0, "{market:?}");
}

#[test]
fn below_the_load_that_is_scarce_nothing_is_bought_and_nothing_is_reduced() {
    let mut run = Run::new(Crowd { times: 0.3, ..Crowd::default() });
    let views = run.run(15.0).between(0.0, 15.0);
    assert_eq!(views.share(Kind::Reduced) + views.share(Kind::Refused), 0.0);
    assert_eq!(run.sim.core.status().priced().purchases, 0);
    assert!(views.excess() < 0.01, "{}", views.excess());
}

#[test]
fn after_a_step_to_six_times_the_wait_is_back_within_three_seconds() {
    let mut run = Run::new(Crowd { times: 0.4, ..Crowd::default() });
    run.run(6.0);
    run.ask_times(6.0);
    run.run(10.0);
    let later = run.between(9.0, 16.0);
    assert!(later.ms(0.99) < 400.0, "{}", later.ms(0.99));
    assert!(later.excess() < 0.02 && later.changes() < 0.05, "{} {}", later.excess(), later.changes());
    assert_eq!(run.between(6.0, 16.0).share(Kind::Refused), 0.0);
}

#[test]
fn at_twelve_times_all_that_cannot_be_carried_is_refused_at_once_and_the_rest_waits_little() {
    let mut run = Run::new(Crowd { times: 24.0, ..Crowd::default() });
    let views = run.run(12.0).between(6.0, 12.0);
    assert!(views.share(Kind::Refused) > 0.1, "{}", views.share(Kind::Refused));
    assert!(views.ms(0.99) < 3000.0, "{}", views.ms(0.99));
}

#[test]
fn k_settles_at_one_value_from_either_end_and_costs_no_error() {
    for workers in [6, 12] {
        let crowd = |first_k, holds_k| Crowd {
            workers,
            viewers: 8 * workers as u32,
            speed: 1.2,
            first_k,
            holds_k,
            ..Crowd::default()
        };
        let settled = |first_k| {
            let mut run = Run::new(crowd(first_k, false));
            run.run(14.0);
            let k: Vec<u32> = run.k[50..].to_vec();
            (k, run.between(5.0, 14.0))
        };
        let (up, views) = settled(1);
        let (down, _) = settled(workers as u32 - 1);
        let mean = |k: &[u32]| k.iter().sum::<u32>() as f64 / k.len() as f64;
        assert!((mean(&up) - mean(&down)).abs() <= 1.0, "{workers}: {up:?} {down:?}");
        let mut all = Run::new(crowd(workers as u32, true));
        let all = all.run(14.0).between(5.0, 14.0);
        assert!(views.excess() <= all.excess() + 0.004, "{} {}", views.excess(), all.excess());
        assert!(views.ms(0.99) <= 1.1 * all.ms(0.99), "{} {}", views.ms(0.99), all.ms(0.99));
    }
}
