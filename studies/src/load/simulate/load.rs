//! Loads of simulated clients: ticks of V views as in the cluster paper, or clients that ask at random.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::rc::Rc;

use argus_scene::Camera;
use glam::DVec3;
use rand::Rng;

use super::Nanos;
use super::world::{Load, World};

/// Ticks of V views. The next tick's views are requested as soon as the limit in flight allows. The tick after that
/// waits for new samples. So, as in the paper's pipeline, a tick takes as long as its slower stage.
pub(super) struct Ticks {
    views: u64,
    in_flight: Rc<Cell<usize>>,
    direct: bool,
    refreshed: bool,
    asked: u64,
    open: usize,
    waits: bool,
    /// The epoch served when each tick began.
    epochs: Vec<u64>,
    progress: Rc<RefCell<Progress>>,
}

/// The progress of the ticks.
#[derive(Debug, Clone, Default)]
pub(super) struct Progress {
    answered: u64,
    /// When the last view of each tick was answered.
    pub(super) ticks: Vec<Nanos>,
}

const POLL: Nanos = 1_000_000;

impl Ticks {
    pub(super) fn new(
        views: u64,
        in_flight: usize,
        direct: bool,
        refreshed: bool,
    ) -> (Self, Rc<RefCell<Progress>>) {
        let progress = Rc::new(RefCell::new(Progress::default()));
        let (asked, open, waits, epochs) = (0, 0, false, Vec::new());
        let in_flight = Rc::new(Cell::new(in_flight));
        (
            Self {
                views,
                in_flight,
                direct,
                refreshed,
                asked,
                open,
                waits,
                epochs,
                progress: progress.clone(),
            },
            progress,
        )
    }

    /// The limit of views in flight, which may be changed during the run.
    pub(super) fn in_flight(&self) -> Rc<Cell<usize>> {
        self.in_flight.clone()
    }

    /// Requests views up to the limit.
    fn ask(&mut self, world: &mut World) {
        while self.open < self.in_flight.get() {
            let tick = (self.asked / self.views) as usize;
            if tick == self.epochs.len() {
                let epoch = world.core.set().version.state.epoch;
                // The previous tick used samples that were rendered during the tick before it.
                if self.refreshed && tick >= 2 && epoch <= self.epochs[tick - 1] {
                    if !self.waits {
                        self.waits = true;
                        world.wake_after(POLL, 1);
                    }
                    return;
                }
                self.epochs.push(epoch);
            }
            world.ask(self.asked, somewhere(self.asked), self.direct);
            self.asked += 1;
            self.open += 1;
        }
    }
}

/// A viewpoint above the ground, different for each client.
pub(super) fn somewhere(client: u64) -> Camera {
    let turn = client as f64 * 2.399;
    let eye = DVec3::new(8.0 * turn.cos(), 30.0, 8.0 * turn.sin());
    Camera::look_at(eye, DVec3::new(2.0, 0.0, 2.0))
}

impl Load for Ticks {
    fn wake(&mut self, _tag: u64, world: &mut World) {
        self.waits = false;
        self.ask(world);
    }

    fn answered(&mut self, _client: u64, _latency: Nanos, world: &mut World) {
        self.open -= 1;
        {
            let mut progress = self.progress.borrow_mut();
            progress.answered += 1;
            if progress.answered.is_multiple_of(self.views) {
                progress.ticks.push(world.now);
            }
        }
        self.ask(world);
    }

    fn refused(&mut self, client: u64, _overload: bool, world: &mut World) {
        // Repeats the request.
        world.ask(client, somewhere(client), self.direct);
    }
}

/// Clients that request views in turn. A client that still waits for its previous view skips its turn.
pub(super) struct Clients {
    /// Views per second that are requested, by seconds since the start.
    rate: Box<dyn Fn(f64) -> f64>,
    /// A client's camera at a time in seconds.
    camera: Box<dyn Fn(u64, f64) -> Camera>,
    clients: u64,
    /// Share of direct views, by seconds since the start.
    direct: Box<dyn Fn(f64) -> f64>,
    next: u64,
    waiting: HashSet<u64>,
    stats: Rc<RefCell<ClientStats>>,
}

/// What the clients received.
#[derive(Debug, Clone, Default)]
pub(super) struct ClientStats {
    /// Latencies of all views in milliseconds.
    pub(super) latencies_ms: Vec<f64>,
    /// Views that were skipped because the client still waited for its previous one.
    pub(super) superseded: u64,
}

impl Clients {
    pub(super) fn new(
        clients: u64,
        direct: bool,
        rate: impl Fn(f64) -> f64 + 'static,
        camera: impl Fn(u64, f64) -> Camera + 'static,
    ) -> (Self, Rc<RefCell<ClientStats>>) {
        let stats = Rc::new(RefCell::new(ClientStats::default()));
        let load = Self {
            rate: Box::new(rate),
            camera: Box::new(camera),
            clients,
            direct: Box::new(move |_| f64::from(u8::from(direct))),
            next: 0,
            waiting: HashSet::new(),
            stats: stats.clone(),
        };
        (load, stats)
    }

    /// Sets a constant share of direct views.
    #[cfg(test)]
    pub(super) fn some_direct(self, share: f64) -> Self {
        self.some_direct_at(move |_| share)
    }

    /// Sets a share of direct views that depends on the time in seconds.
    #[cfg(test)]
    pub(super) fn some_direct_at(self, share: impl Fn(f64) -> f64 + 'static) -> Self {
        Self { direct: Box::new(share), ..self }
    }
}

impl Load for Clients {
    fn wake(&mut self, _tag: u64, world: &mut World) {
        let secs = world.now as f64 * 1e-9;
        let rate = (self.rate)(secs);
        if !(rate > 1e-3) {
            return world.wake_after(100_000_000, 0);
        }
        let client = self.next % self.clients;
        self.next += 1;
        if self.waiting.insert(client) {
            let direct = world.rng.random::<f64>() < (self.direct)(secs);
            world.ask(client, (self.camera)(client, secs), direct);
        } else {
            self.stats.borrow_mut().superseded += 1;
        }
        // Exponential intervals, as between independent clients.
        let pause = -(1.0 - world.rng.random::<f64>()).ln() / rate;
        world.wake_after((pause * 1e9) as Nanos, 0);
    }

    fn answered(&mut self, client: u64, latency: Nanos, _world: &mut World) {
        self.waiting.remove(&client);
        let mut stats = self.stats.borrow_mut();
        stats.latencies_ms.push(latency as f64 * 1e-6);
    }

    fn refused(&mut self, client: u64, _overload: bool, _world: &mut World) {
        self.waiting.remove(&client);
    }
}
