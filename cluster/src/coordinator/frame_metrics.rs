//! Metrics of frames, for `/metrics`.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1;
use parking_lot::Mutex;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;
use tokio::time::Instant;

use crate::observe::PREFIX;

/// Histogram bounds: 17 from 1 ms to 65 s, each twice the previous one.
const BOUNDS: (f64, f64, u16) = (1e-3, 2.0, 17);

type Labels = Vec<(String, String)>;

/// Metrics of the frames of one scene. Clones, and those of other scenes, share the registry's page.
#[derive(Clone)]
pub(super) struct FrameMetrics {
    /// The label of the scene; none where the service has one scene.
    scene: Labels,
    seconds: Family<Labels, Histogram, fn() -> Histogram>,
    stages: Family<Labels, Histogram, fn() -> Histogram>,
    pixels: Family<Labels, Counter>,
    ways: Family<Labels, Counter>,
    last_tick: Arc<Mutex<Instant>>,
}

fn histogram() -> Histogram {
    let (start, factor, count) = BOUNDS;
    Histogram::new(exponential_buckets(start, factor, count))
}

impl Default for FrameMetrics {
    fn default() -> Self {
        Self {
            scene: Labels::new(),
            seconds: Family::new_with_constructor(histogram),
            stages: Family::new_with_constructor(histogram),
            pixels: Family::default(),
            ways: Family::default(),
            last_tick: Arc::new(Mutex::new(Instant::now())),
        }
    }
}

impl FrameMetrics {
    /// The metrics of one of several scenes.
    pub(super) fn of_scene(&self, name: &str) -> Self {
        Self { scene: vec![("scene".to_owned(), name.to_owned())], ..self.clone() }
    }

    /// The labels of a row: the scene's and another one.
    fn labels(&self, name: &str, value: &str) -> Labels {
        self.scene.iter().cloned().chain([(name.to_owned(), value.to_owned())]).collect()
    }

    /// Records a frame that its client has, or has as soon as the last chunk arrives.
    pub(super) fn arrived(&self, header: &v1::FrameHeader) {
        let seconds = |ms: f64| ms.max(0.0) * 1e-3;
        if header.age_ms.is_finite() {
            self.seconds.get_or_create(&self.scene).observe(seconds(header.age_ms));
        }
        // A share that is not a number counts as 0.
        let pixels = u64::from(header.width) * u64::from(header.height);
        let unseen = (header.unresolved_fraction * pixels as f64).round() as u64;
        let traced = header.served.map_or(0, |served| served.traced);
        let seen = pixels.saturating_sub(unseen).saturating_sub(traced);
        for (how, count) in [("sample", seen), ("traced", traced), ("guessed", unseen)] {
            self.pixels.get_or_create(&self.labels("served", how)).inc_by(count);
        }
        for stage in header.stages.iter().filter(|stage| stage.ms.is_finite()) {
            self.stages.get_or_create(&self.labels("stage", &stage.name)).observe(seconds(stage.ms));
        }
    }

    /// Counts a frame that a client fetched from a worker.
    pub(super) fn fetched(&self) {
        self.ways.get_or_create(&self.labels("way", "fetched")).inc();
    }

    /// Counts a frame that this process relayed.
    pub(super) fn relayed(&self) {
        self.ways.get_or_create(&self.labels("way", "relayed")).inc();
    }

    /// Records that the core got a tick.
    pub(super) fn ticked(&self) {
        *self.last_tick.lock() = Instant::now();
    }

    /// Time since the core's last tick.
    pub(super) fn silent(&self) -> Duration {
        self.last_tick.lock().elapsed()
    }

    /// The registry for `/metrics`.
    pub(super) fn registry(&self) -> Registry {
        let mut registry = Registry::with_prefix(PREFIX);
        let help = "Time from a view's request to the first byte of its frame at the coordinator";
        match self.scene.is_empty() {
            // Shown also before the first frame.
            true => registry.register("view_seconds", help, self.seconds.get_or_create(&self.scene).clone()),
            false => registry.register("view_seconds", help, self.seconds.clone()),
        }
        registry.register("stage_seconds", "Time of each stage of a frame", self.stages.clone());
        registry.register(
            "frames",
            "Frames, relayed by the coordinator or fetched from a worker",
            self.ways.clone(),
        );
        registry.register("pixels", "Pixels of frames, by their source", self.pixels.clone());
        registry
    }
}
