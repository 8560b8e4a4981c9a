//! What a coordinator is watched by.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1;
use parking_lot::Mutex;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;
use tokio::time::Instant;

use super::hub::Hub;
use crate::core::Status;
use crate::observe::{Exposition, PREFIX, Watched};

/// A coordinator whose clock was not looked at for this long is wedged: it looks ten times a second.
const WEDGED: Duration = Duration::from_secs(10);

/// From 1 ms on, each bound twice the one before: up to 65 s.
const BOUNDS: (f64, f64, u16) = (1e-3, 2.0, 17);

type Labels = Vec<(String, String)>;

/// What is recorded of frames as they pass.
pub(super) struct Frames {
    seconds: Histogram,
    stages: Family<Labels, Histogram, fn() -> Histogram>,
    pixels: Family<Labels, prometheus_client::metrics::counter::Counter>,
    ways: Family<Labels, prometheus_client::metrics::counter::Counter>,
    last_tick: Mutex<Instant>,
}

fn histogram() -> Histogram {
    let (start, factor, count) = BOUNDS;
    Histogram::new(exponential_buckets(start, factor, count))
}

impl Default for Frames {
    fn default() -> Self {
        Self {
            seconds: histogram(),
            stages: Family::new_with_constructor(histogram),
            pixels: Family::default(),
            ways: Family::default(),
            last_tick: Mutex::new(Instant::now()),
        }
    }
}

impl Frames {
    /// A client has a frame whole, or will as soon as its last chunk is there.
    pub(super) fn arrived(&self, header: &v1::FrameHeader) {
        let seconds = |ms: f64| ms.max(0.0) * 1e-3;
        if header.age_ms.is_finite() {
            self.seconds.observe(seconds(header.age_ms));
        }
        // What no sample saw, and how the rest came about; a share that is no number counts as nothing.
        let pixels = u64::from(header.width) * u64::from(header.height);
        let unseen = (header.unresolved_fraction * pixels as f64).round() as u64;
        let traced = header.served.map_or(0, |served| served.traced);
        let seen = pixels.saturating_sub(unseen).saturating_sub(traced);
        for (how, count) in [("sample", seen), ("traced", traced), ("guessed", unseen)] {
            self.pixels.get_or_create(&vec![("served".to_owned(), how.to_owned())]).inc_by(count);
        }
        for stage in header.stages.iter().filter(|stage| stage.ms.is_finite()) {
            let label = vec![("stage".to_owned(), stage.name.clone())];
            self.stages.get_or_create(&label).observe(seconds(stage.ms));
        }
    }

    /// A client has fetched a frame from its worker.
    pub(super) fn fetched(&self) {
        self.ways.get_or_create(&vec![("way".to_owned(), "fetched".to_owned())]).inc();
    }

    /// A frame passed this process.
    pub(super) fn relayed(&self) {
        self.ways.get_or_create(&vec![("way".to_owned(), "relayed".to_owned())]).inc();
    }

    /// The core was told the time.
    pub(super) fn ticked(&self) {
        *self.last_tick.lock() = Instant::now();
    }

    /// What was recorded, for the page of metrics.
    pub(super) fn registry(&self) -> Registry {
        let mut registry = Registry::with_prefix(PREFIX);
        let help = "From a view's request to its frame's first byte at the coordinator";
        registry.register("view_seconds", help, self.seconds.clone());
        registry.register("stage_seconds", "What a stage of a frame took", self.stages.clone());
        registry.register("frames", "Frames, by their way to the client", self.ways.clone());
        registry.register("pixels", "Pixels of frames, by where they came from", self.pixels.clone());
        registry
    }
}

/// A coordinator, as it is watched.
pub(super) struct Watch(pub(super) Arc<Hub>);

impl Watched for Watch {
    fn ready(&self) -> Result<(), String> {
        self.0.check_leading().map_err(|fault| fault.to_string())?;
        self.0.look(|core| match (core.is_draining(), core.can_answer()) {
            (true, _) => Err("the coordinator is shutting down".to_owned()),
            (_, true) => Ok(()),
            (_, false) => Err("no worker is ready to render; start one with `argus worker`".to_owned()),
        })
    }

    fn live(&self) -> Result<(), String> {
        let silent = self.0.frames.last_tick.lock().elapsed();
        match silent < WEDGED {
            true => Ok(()),
            false => Err(format!("the coordinator has not moved for {} s", silent.as_secs())),
        }
    }

    fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        let (status, in_flight) = self.0.look(|core| (core.status(), core.views_in_flight()));
        cluster(to, &status, in_flight)?;
        counters(to, &status)?;
        workers(to, &status)
    }
}

fn cluster(to: &mut Exposition<'_>, status: &Status, in_flight: usize) -> fmt::Result {
    let unready = status.workers.len().saturating_sub(status.processes as usize);
    to.gauges(
        "processes",
        "Workers: those that sample, those that composite (one may do both), and those that are not ready",
        [
            ([("role", "sampler")], f64::from(status.samplers)),
            ([("role", "compositor")], f64::from(status.compositors)),
            ([("role", "unready")], unready as f64),
        ],
    )?;
    let kinds = ["sample", "view", "direct", "ray"].map(|kind| [("kind", kind)]);
    let per_tick =
        [status.samples_per_tick, status.views_per_tick, status.direct_views_per_tick, status.rays_per_tick];
    to.gauges(
        "demand_per_tick",
        "S, V, D and R: what is asked for per tick",
        kinds.into_iter().zip(per_tick),
    )?;
    let ms = [status.sample_ms, status.view_ms, status.direct_ms, status.ray_ms];
    let seconds = ms.map(|ms| ms * 1e-3);
    to.gauges("cost_seconds", "g, c, g_direct and g_ray, as measured", kinds.into_iter().zip(seconds))?;
    to.gauges(
        "tick_seconds",
        "What the balance formula says a tick's work takes, and how long the busiest worker worked",
        [
            ([("which", "predicted")], status.tick_predicted_ms * 1e-3),
            ([("which", "measured")], status.tick_measured_ms * 1e-3),
        ],
    )?;
    to.gauge("views_in_flight", "Views waiting or in work", in_flight as f64)?;
    to.gauge("sessions_open", "Sessions that are open", status.counters.sessions_open as f64)?;
    let refinements = status.refinements;
    to.gauges(
        "refinements",
        "Samples beside the rig's own, where views have holes",
        [
            ([("state", "wanted")], f64::from(refinements.wanted)),
            ([("state", "placed")], f64::from(refinements.placed)),
            ([("state", "usable")], f64::from(refinements.usable)),
        ],
    )
}

fn counters(to: &mut Exposition<'_>, status: &Status) -> fmt::Result {
    let counters = &status.counters;
    to.counters(
        "views",
        "Views, by how they ended",
        [
            ([("outcome", "answered")], counters.views_answered as f64),
            ([("outcome", "failed")], counters.views_failed as f64),
            ([("outcome", "rejected")], counters.views_rejected as f64),
        ],
    )?;
    to.counter("views_retried", "Attempts at a view by another worker", counters.views_retried)?;
    to.counter("frames_refused", "Frames not good enough for their request", counters.frames_refused)?;
    let superseded = counters.cameras_superseded;
    to.counter("cameras_superseded", "Session cameras that a newer one overtook", superseded)?;
    to.counter("roles_changed", "Changes of role", counters.roles_changed)?;
    to.counter("workers_joined", "Workers that joined", counters.workers_joined)?;
    to.counter("workers_lost", "Workers that fell silent or ended unannounced", counters.workers_lost)
}

fn workers(to: &mut Exposition<'_>, status: &Status) -> fmt::Result {
    let rows = |value: fn(&crate::core::Report) -> f64| {
        status
            .workers
            .iter()
            .map(move |worker| ([("worker", worker.hello.name.as_str())], value(&worker.report)))
    };
    let queued = |report: &crate::core::Report| f64::from(report.queued_samples + report.queued_views);
    to.gauges("worker_queue", "Samples and views that wait at a worker", rows(queued))?;
    to.gauges("worker_samples_held", "Samples that a worker holds", rows(|report| report.held.len() as f64))
}
