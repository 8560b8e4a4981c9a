//! What is recorded of the frames that pass, for the page of metrics.

use std::time::Duration;

use argus_proto::v1;
use parking_lot::Mutex;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;
use tokio::time::Instant;

use crate::observe::PREFIX;

/// From 1 ms on, each bound twice the one before: up to 65 s.
const BOUNDS: (f64, f64, u16) = (1e-3, 2.0, 17);

type Labels = Vec<(String, String)>;

/// What is recorded of frames as they pass.
pub(super) struct FrameMetrics {
    seconds: Histogram,
    stages: Family<Labels, Histogram, fn() -> Histogram>,
    pixels: Family<Labels, Counter>,
    ways: Family<Labels, Counter>,
    last_tick: Mutex<Instant>,
}

fn histogram() -> Histogram {
    let (start, factor, count) = BOUNDS;
    Histogram::new(exponential_buckets(start, factor, count))
}

impl Default for FrameMetrics {
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

impl FrameMetrics {
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

    /// How long ago the core was told the time.
    pub(super) fn silent(&self) -> Duration {
        self.last_tick.lock().elapsed()
    }

    /// What was recorded, for the page of metrics.
    pub(super) fn registry(&self) -> Registry {
        let mut registry = Registry::with_prefix(PREFIX);
        let help = "From a view's request to its frame's first byte at the coordinator";
        registry.register("view_seconds", help, self.seconds.clone());
        registry.register("stage_seconds", "What a stage of a frame took", self.stages.clone());
        registry.register("frames", "FrameMetrics, by their way to the client", self.ways.clone());
        registry.register("pixels", "Pixels of frames, by where they came from", self.pixels.clone());
        registry
    }
}
