//! The state of the market: prices, errors, accounts and purchases of one scene.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::{Detail, FrameSource, Plan, SceneState};

use super::cluster::Cluster;
use super::open_view::OpenView;
use super::pending::Pending;
use crate::core::event::{ProbeResult, ViewId, WorkerId};
use crate::core::market::buy::eye_sample;
use crate::core::market::pool::Near;
use crate::core::market::{
    Accounts, Chosen, Coming, Decision, Errors, Gain, OfferKind, Place, Pool, Prices, Purchasable, Site,
    TimePrice, WarpFeatures, buy,
};
use crate::core::smooth::Rate;
use crate::core::time::Uptime;
use crate::core::workers::balance::{self, Load};
use crate::core::workers::{Worker, Workers};

/// Share of the workers' time that probes take.
///
/// Tuned: 3% of a busy worker (issue 54, item 4).
const PROBED_SHARE: f64 = 0.03;

/// Time of a probe over that of the view from triangles in full, without its other plans.
const PROBE: f64 = 1.0;

/// Most time that probes may save up, in views from triangles in full.
const MOST_SAVED: f64 = 4.0;

/// Most probes whose results are awaited.
const MOST_PROBES: usize = 64;

/// A purchase is given up after this many times its predicted time, and this long at least.
const PATIENCE: (f64, Duration) = (30.0, Duration::from_secs(10));

/// What a probe measures.
#[derive(Debug, Clone)]
struct Probed {
    view_id: ViewId,
    attempt: u32,
    /// The answered offer, and then the others.
    offers: Vec<(OfferKind, WarpFeatures)>,
}

/// The market of one scene.
#[derive(Debug)]
pub(super) struct Market {
    prices: BTreeMap<WorkerId, Prices>,
    pub(super) errors: Errors,
    pub(super) time: TimePrice,
    pub(super) accounts: Accounts,
    /// The state of the scene that accounts are of.
    state: SceneState,
    /// Worth of the best purchase on offer, FLIP a second.
    best_worth: f64,
    /// Sources bought, microseconds spent on them, and microseconds of open views, a tick.
    bought: Rate,
    buying_us: Rate,
    viewing_us: Rate,
    /// K: most purchases at a time.
    most_purchases: u32,
    /// Sources bought since the coordinator started.
    purchases: u64,
    /// Seconds that probes may take, and when they were last counted.
    probe_secs: (f64, Uptime),
    probes: Vec<Probed>,
    /// Turn of the plans that are probed beside an answered one.
    turn: usize,
}

impl Market {
    /// Nothing is known; `weight` of the newest tick is in (0, 1].
    pub(super) fn new(weight: f64) -> Self {
        let rate = || Rate::new(weight);
        Self {
            prices: BTreeMap::new(),
            errors: Errors::default(),
            time: TimePrice::default(),
            accounts: Accounts::default(),
            state: SceneState::default(),
            best_worth: 0.0,
            bought: rate(),
            buying_us: rate(),
            viewing_us: rate(),
            most_purchases: 1,
            purchases: 0,
            probe_secs: (0.0, Uptime::default()),
            probes: Vec::new(),
            turn: 0,
        }
    }

    /// The prices of a worker: its own, or those of another one with the same device.
    pub(super) fn prices_of(&self, worker: &Worker, workers: &Workers) -> Option<&Prices> {
        let alike = || {
            let same = workers.iter().filter(|other| other.hello().device == worker.hello().device);
            same.take(64).find_map(|other| self.prices.get(&other.id()))
        };
        self.prices.get(&worker.id()).or_else(alike)
    }

    /// Learns the first price of a worker from its report, and forgets those of lost workers.
    pub(super) fn meet(&mut self, workers: &Workers) {
        self.prices.retain(|id, _| workers.get(*id).is_some());
        for worker in workers.iter() {
            if let Some(cost) = worker.report().direct_cost {
                self.prices.entry(worker.id()).or_insert_with(|| Prices::new(cost));
            }
        }
    }

    /// Learns from an answered view.
    pub(super) fn learn_answer(&mut self, view: &Pending, uncovered: Option<u64>, secs: f64) {
        let Some(worker) = view.worker else { return };
        let pixels = view.full_work();
        let holes = uncovered.unwrap_or(0) as f64 / view.pixels.max(1) as f64;
        let kind = match &view.plan {
            Plan::Direct { detail, .. } => OfferKind::Direct(*detail),
            Plan::Warp(_) if view.needs_samples() => return,
            Plan::Warp(_) if view.traces_holes() => OfferKind::Traced,
            Plan::Warp(_) => OfferKind::Guessed,
        };
        if view.open.is_some() {
            self.viewing_us.count((secs * 1e6).max(0.0) as u64);
        }
        match self.prices.get_mut(&worker) {
            Some(prices) => prices.learn(kind, (view.plan.frames().len(), holes), pixels, secs),
            None if kind == OfferKind::Direct(Detail::Full) => {
                if let Some(prices) = Prices::of_first(pixels, secs * 1e3) {
                    self.prices.insert(worker, prices);
                }
            }
            None => {}
        }
    }

    /// Learns from a purchase that is done.
    pub(super) fn learn_purchase(&mut self, done: &Coming, secs: f64) {
        let (kind, pixels) = done.kind;
        self.buying_us.count((secs * 1e6).max(0.0) as u64);
        if let Some(prices) = self.prices.get_mut(&done.worker) {
            prices.learn_source(kind, pixels, secs);
        }
    }

    /// Seconds of a view from triangles in full, the mean of all workers; 0 until one has a price.
    pub(super) fn full_secs(&self, pixels: u64) -> f64 {
        self.mean(|prices| prices.full_secs(pixels))
    }

    fn mean(&self, secs: impl Fn(&Prices) -> f64) -> f64 {
        self.prices.values().map(secs).sum::<f64>() / (self.prices.len() as f64).max(1.0)
    }

    /// Counts a view that was decided for the first time: its demand, and what it would have gained from another source.
    pub(super) fn count(
        &mut self,
        open: &OpenView,
        decision: &Decision,
        near: &[Near<'_>],
        (price, cluster): (f64, Cluster<'_>),
        now: Uptime,
    ) {
        let pixels = u64::from(open.direct.width) * u64::from(open.direct.height);
        let pixels = pixels * u64::from(open.direct.samples_per_pixel);
        let (workers, limits) = (cluster.answering(), &cluster.config.limits);
        let full_secs = self.full_secs(pixels);
        self.time.ask(full_secs, now);
        let (spare, counted) = self.probe_secs;
        let earned = PROBED_SHARE * workers * now.since(counted).as_secs_f64();
        self.probe_secs = ((spare + earned).min(MOST_SAVED * full_secs), now);
        let view = FrameSource { samples_per_pixel: 1, ..open.direct };
        let fits = || eye_sample(&view, Purchasable::Four).validate(limits).is_ok();
        if !(open.may_warp && self.time.is_scarce(workers, now) && fits()) {
            return;
        }
        let nearest = near.first().map(|near| (near.held.id, near.held.grid.place.distance(&open.grid)));
        let nearest = nearest.filter(|(_, distance)| Pool::is_accounted(*distance));
        let distance = nearest.map_or(f64::INFINITY, |(_, distance)| distance);
        if cluster.samples.pool().is_coming(&open.grid, distance) {
            return;
        }
        let Chosen { excess, secs, .. } = decision.chosen;
        let warp_secs = self.mean(|prices| prices.warp_secs(1, pixels));
        let gains = Purchasable::ALL.map(|kind| Gain {
            error: excess - self.errors.of_source(kind.samples_per_pixel()).max(0.0),
            secs: secs - warp_secs,
        });
        let site =
            nearest.map_or_else(|| Site::Place(open.place(cluster.reach())), |(id, _)| Site::Source(id));
        self.accounts.add(site, gains, view, price, now);
    }

    /// The best purchase on offer, if it is worth its price and fewer than K are being rendered. `None` while time is not scarce.
    pub(super) fn purchase(&mut self, cluster: Cluster<'_>, now: Uptime) -> Option<Coming> {
        let (workers, state) = (cluster.answering(), cluster.samples.set().version.state);
        if state != self.state || !self.time.is_scarce(workers, now) {
            self.accounts.clear();
            self.state = state;
        }
        let queue = self.time.of_queue();
        let pixels = |view: &FrameSource| u64::from(view.width) * u64::from(view.height);
        let secs =
            |own: &Self, kind, view: &FrameSource| own.mean(|prices| prices.source_secs(kind, pixels(view)));
        let (worth, purchase) = buy(&self.accounts, queue, |kind, view| secs(self, kind, view), now);
        self.best_worth = worth;
        self.time.follow(cluster.mean_wait_secs(now), worth, workers, now);
        let pool = cluster.samples.pool();
        let purchase = purchase.filter(|_| pool.coming().len() < self.most_purchases as usize)?;
        let is_free = |worker: &&Worker| {
            let renders = |coming: &Coming| coming.worker == worker.id();
            worker.answers() && worker.report().frame_cost.is_some() && !pool.coming().iter().any(renders)
        };
        let wait = |worker: &Worker| cluster.wait_secs(worker, now);
        let free = cluster.workers.iter().filter(is_free);
        let worker = free.min_by(|a, b| wait(a).total_cmp(&wait(b)))?;
        let view = purchase.view;
        let nearest = match purchase.site {
            Site::Source(id) => pool.get(id).map(|held| held.grid.place.mean_inverse),
            Site::Place(_) => None,
        };
        let usual = || pool.mean_inverse(state).unwrap_or(1.0 / cluster.reach());
        let axis = (view.camera.target - view.camera.eye).normalize();
        let took = secs(self, purchase.kind, &view);
        self.accounts.end(purchase.site);
        self.bought.count(1);
        self.purchases += 1;
        Some(Coming {
            worker: worker.id(),
            source: eye_sample(&view, purchase.kind),
            state,
            kind: (purchase.kind, pixels(&view)),
            place: Place { eye: view.camera.eye, axis, mean_inverse: nearest.unwrap_or_else(usual) },
            due: (
                now,
                now.after(PATIENCE.1.max(Duration::try_from_secs_f64(took * PATIENCE.0).unwrap_or_default())),
            ),
        })
    }

    /// Sets K, for tests.
    #[cfg(test)]
    pub(super) fn set_most_purchases(&mut self, most: u32) {
        self.most_purchases = most;
    }

    /// Closes a tick: K follows from what was bought and what views took.
    pub(super) fn tick(&mut self, workers: u32) {
        [&mut self.bought, &mut self.buying_us, &mut self.viewing_us].into_iter().for_each(Rate::roll);
        let load = Load {
            sampling_secs: self.buying_us.per_tick() * 1e-6,
            compositing_secs: self.viewing_us.per_tick() * 1e-6,
        };
        self.most_purchases = balance::samplers(load, workers).max(1);
    }

    /// The other plans that are probed beside a view's, if a probe is due: a warp that it did not take, and a reduced detail. So a kind
    /// that is never taken, since it erred much, is still looked at.
    pub(super) fn probe(
        &mut self,
        (view_id, attempt): (ViewId, u32),
        (open, chosen): (&OpenView, &Chosen),
        plan_of: impl Fn(&Chosen) -> Plan,
    ) -> Option<Vec<Plan>> {
        let pixels = u64::from(open.direct.width) * u64::from(open.direct.height);
        let price = self.full_secs(pixels) * PROBE;
        if !(open.may_warp && open.may_guess() && price > 0.0 && self.probe_secs.0 >= price) {
            return None;
        }
        self.turn += 1;
        const BESIDE: [Detail; 2] = [Detail::Quarter, Detail::Half];
        let detail = BESIDE[self.turn % BESIDE.len()];
        let reduced = Chosen { kind: OfferKind::Direct(detail), sources: Vec::new(), ..chosen.clone() };
        // Only sources that the worker holds are warped in passing.
        let warped = open.warped.clone().filter(|warped| warped.kind != chosen.kind);
        let others: Vec<Chosen> =
            warped.into_iter().chain((chosen.kind != reduced.kind).then_some(reduced)).collect();
        let plans = others.iter().map(plan_of).collect();
        self.probe_secs.0 -= price + self.mean(|prices| prices.direct_secs(detail, pixels));
        let offers =
            std::iter::once(chosen).chain(&others).map(|offer| (offer.kind, offer.features)).collect();
        if self.probes.len() == MOST_PROBES {
            self.probes.remove(0);
        }
        self.probes.push(Probed { view_id, attempt, offers });
        Some(plans)
    }

    /// Learns from a probe.
    pub(super) fn learn_probe(&mut self, result: &ProbeResult) {
        let is_it = |probed: &Probed| (probed.view_id, probed.attempt) == (result.view_id, result.attempt);
        let Some(at) = self.probes.iter().position(is_it) else { return };
        let Probed { offers, .. } = self.probes.remove(at);
        for ((kind, features), excess) in offers.into_iter().zip(&result.excess) {
            let excess = f64::from(*excess);
            match kind {
                OfferKind::Direct(detail) => self.errors.learn_detail(detail, excess),
                OfferKind::Guessed => self.errors.learn_warp(&features, true, excess),
                OfferKind::Traced => self.errors.learn_warp(&features, false, excess),
            }
        }
    }

    /// A snapshot for people.
    pub(super) fn status(&self, cluster: Cluster<'_>, now: Uptime) -> argus_proto::v1::Market {
        let (sources, bought) = cluster.samples.pool().count();
        let workers = cluster.answering();
        let asked = self.time.asked_secs(now);
        let spent = (self.viewing_us.per_tick() * 1e-6).max(f64::MIN_POSITIVE);
        argus_proto::v1::Market {
            price: self.time.of_view(None, 0.0, workers, now),
            price_of_queue: self.time.of_queue(),
            worth: self.time.worth(),
            best_worth: self.best_worth,
            load: self.time.load(workers, now),
            accounts: self.accounts.len() as u32,
            purchases: self.purchases,
            purchases_coming: cluster.samples.pool().coming().len() as u32,
            purchases_per_tick: self.bought.per_tick(),
            most_purchases: self.most_purchases,
            sources: sources as u32,
            sources_bought: bought as u32,
            asked,
            carried: self.viewing_us.per_tick() * 1e-6,
            speed_up: if self.viewing_us.per_tick() > 0.0 { asked / spent } else { 0.0 },
            wait_ms: cluster.mean_wait_secs(now) * 1e3,
            probes: self.errors.probes(),
        }
    }
}
