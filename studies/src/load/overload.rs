//! Overload: what a cluster still answers, and how late, under more load than it can carry.
//!
//! First a load far above capacity finds the largest throughput, since batches are then fullest. Then open loads at
//! fractions and multiples of it follow: views fall due regardless of earlier ones. A service that queues what it
//! cannot answer in time answers fewer and fewer views in time; one that rejects at once keeps its peak throughput.

use std::path::Path;
use std::time::Duration;

use anyhow::{Result, ensure};
use argus_client::load::{self, IN_FLIGHT, LoadOptions, LoadReport, burst, path_views, patient};
use argus_local::{LocalCluster, connect};
use argus_scene::PlanRequest;
use indicatif::ProgressBar;
use serde_json::json;

use crate::arguments::{count, is_quick, or_quick, positive, size};
use crate::{Machine, Report, report};

/// Measures a cluster under more load than it can carry: which views it still answers, how late, and what happens
/// to the rest
///
/// Loads are multiples of the cluster's measured capacity.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "400x300")]
    pub size: [u32; 2],
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Views of the burst that estimates capacity
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("600", "50"))]
    pub views: u32,
    /// Loads, as factors of the measured capacity
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("0.5,0.9,1,1.5,2,4", "0.5,2"))]
    pub factors: Vec<f64>,
    /// Seconds of each load
    #[arg(long, value_name = "T", value_parser = positive, default_value = or_quick("15", "2"))]
    pub seconds: f64,
    /// Seconds that a view may wait in the queue before the service rejects it
    #[arg(long = "wait", value_name = "SECONDS", value_parser = positive, default_value = "1")]
    pub wait_secs: f64,
    /// Whether rows pass or fail; over a few seconds, figures are noise.
    #[arg(skip = !is_quick())]
    pub judged: bool,
}

/// Clients that share the load.
const CLIENTS: u32 = 16;
/// Far longer than any accepted view takes, so that only the service decides what is rejected.
const DEADLINE: Duration = Duration::from_secs(30);
/// Load of the capacity measurement, as a factor of the burst's rate: a burst alone does not saturate the service.
const SATURATION: f64 = 4.0;
/// From this load on, throughput must reach [`LEAST_OF_PEAK`]. Just at capacity, chance decides.
const OVERLOAD: f64 = 1.5;
/// Least throughput under overload, as a share of the peak.
const LEAST_OF_PEAK: f64 = 0.9;
/// The p99 of accepted views may be this many times `wait_secs`: costs are estimates, and a batch is not divided.
const MOST_WAITS: f64 = 3.0;

/// Runs the study with a cluster of the program `argus`; `progress` counts loads.
///
/// # Errors
/// A cluster that does not start, or that answers nothing before it is overloaded.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(options.factors.len() as u64 + 3);
    let more = [format!("--set=limits.wait_secs={}", options.wait_secs)];
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &more)?;
    let client = connect(&cluster, options.workers).await?;
    let device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();

    let mut capacity = 0.0;
    // The first burst renders samples and compiles shaders.
    for message in ["warming up", "finding the capacity"] {
        progress.set_message(message);
        let views = path_views(client.description(), options.views, options.size, PlanRequest::default());
        let outcome = burst(&client, views, IN_FLIGHT, &patient(), |_, _| ()).await;
        ensure!(outcome.failed == 0, "{} views were not answered: {:?}", outcome.failed, outcome.first_error);
        capacity = outcome.views_per_sec;
        progress.inc(1);
    }

    let seconds = Duration::try_from_secs_f64(options.seconds)?;
    let asked = |per_sec: f64| LoadOptions {
        clients: CLIENTS,
        duration: seconds,
        rate: per_sec / f64::from(CLIENTS),
        size: options.size,
        deadline: DEADLINE,
        ..LoadOptions::default()
    };
    capacity = load::run(&client, &asked(SATURATION * capacity)).await?.views_per_sec.max(capacity);
    progress.inc(1);

    let mut loads: Vec<(f64, LoadReport)> = Vec::new();
    for &factor in &options.factors {
        progress.set_message(format!("load {factor} of capacity"));
        loads.push((factor, load::run(&client, &asked(factor * capacity)).await?));
        progress.inc(1);
    }
    cluster.stop()?;

    let peak = loads.iter().map(|(_, load)| load.views_per_sec).fold(capacity, f64::max);
    let rows = loads.iter().map(|(factor, load)| {
        let bound_ms = MOST_WAITS * options.wait_secs * 1e3;
        let keeps_up = *factor < OVERLOAD || load.views_per_sec >= LEAST_OF_PEAK * peak;
        let passed = load.failed == 0 && keeps_up && load.latency_ms.p99 <= bound_ms;
        let row = json!({
            "scene": options.scene,
            "size": format!("{}x{}", options.size[0], options.size[1]),
            "workers": options.workers,
            "load": factor,
            "asked_per_sec": factor * capacity,
            "answered_per_sec": load.views_per_sec,
            "per_peak": load.views_per_sec / peak,
            "sent": load.sent,
            "answered": load.answered,
            "rejected": load.rejected,
            "failed": load.failed,
            "p50_ms": load.latency_ms.p50,
            "p99_ms": load.latency_ms.p99,
            "p99_bound_ms": bound_ms,
            "passed": options.judged.then_some(passed),
        });
        report::row(row)
    });
    let mut report = Report::new(options.scene.clone(), Machine::here(&device), rows.collect());
    report.notes.push(format!(
        "Capacity: {capacity:.1} views a second, the larger of a burst of {} views, {IN_FLIGHT} at a time, and an open load \
        of {SATURATION} times its rate. The load generator runs on the same machine.",
        options.views
    ));
    Ok(report)
}
