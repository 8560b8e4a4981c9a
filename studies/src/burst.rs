//! Many views at once, by gRPC, from a cluster that has rendered nothing yet: the cluster paper's 290 views
//! (section 5), the samples' own cost included, against the same views all rendered directly.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use argus_client::load::{burst, path_views};
use argus_client::{Answer, Client, ClientError, ConnectOptions, RenderOptions};
use argus_scene::PlanRequest;
use indicatif::ProgressBar;
use serde_json::json;

use crate::local_cluster::LocalCluster;
use crate::median::{mean, median};
use crate::{Effort, Machine, Report, report};

/// What is measured, and how often.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// Views asked for at once.
    pub views: u32,
    /// Pixels of a view.
    pub size: [u32; 2],
    /// Worker processes.
    pub workers: usize,
    /// Rounds that medians are taken over, each with a cluster of its own.
    pub rounds: usize,
}

impl Default for Options {
    /// The cluster paper's views.
    fn default() -> Self {
        Self { scene: "terrain:500000".to_owned(), views: 290, size: [200, 150], workers: 2, rounds: 3 }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self { scene: "terrain:20000".to_owned(), views: 16, size: [96, 72], rounds: 1, ..Self::default() }
    }
}

/// Views in flight at once: enough for full batches on every worker, few enough that none is turned away.
pub const IN_FLIGHT: usize = 128;

/// Runs the study with clusters of the program `argus`; `progress` counts rounds × ways.
///
/// # Errors
/// A cluster that does not come up, or a view that is not answered.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    // Whole K leaves a sampler idle once the samples are there, unless it may compose as well. Direct views are asked
    // for by the cheapest way to see triangles, and by the rasteriser.
    let ways = [
        (
            "splat, samplers also compose",
            PlanRequest::from_samples(),
            ["--samplers-composite=true", "--visibility=auto"],
        ),
        ("splat", PlanRequest::from_samples(), ["--samplers-composite=false", "--visibility=auto"]),
        ("direct, cheapest way", direct, ["--samplers-composite=false", "--visibility=auto"]),
        ("direct, rasterised", direct, ["--samplers-composite=false", "--visibility=raster"]),
    ];
    progress.set_length((ways.len() * options.rounds) as u64);
    let mut secs = ways.map(|_| Vec::new());
    let mut unresolved = ways.map(|_| 0.0);
    let mut device = String::new();
    for _ in 0..options.rounds {
        for (i, (name, plan, arguments)) in ways.into_iter().enumerate() {
            progress.set_message(name);
            let cluster =
                LocalCluster::start(argus, &options.scene, options.workers, &arguments.map(str::to_owned))?;
            let client = connect(&cluster, options.workers).await?;
            device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
            let views = path_views(client.description(), options.views, options.size, plan);
            let mut fractions = Vec::new();
            let unresolved_of = |_, answer: Answer| fractions.push(answer.frame.unresolved_fraction);
            let outcome = burst(&client, views, IN_FLIGHT, &patient(), unresolved_of).await;
            if let Some(error) = outcome.first_error {
                bail!("{} of {} views were not answered: {error}", outcome.failed, outcome.views);
            }
            secs[i].push(outcome.total_ms / 1e3);
            unresolved[i] = mean(fractions);
            cluster.stop()?;
            progress.inc(1);
        }
    }
    let (cheapest_secs, rasterised_secs) = (median(&secs[2]), median(&secs[3]));
    let rows = ways.iter().enumerate().map(|(i, (name, ..))| {
        let total_secs = median(&secs[i]);
        let row = json!({
            "scene": options.scene,
            "method": name,
            "views": options.views,
            "size": format!("{}x{}", options.size[0], options.size[1]),
            "workers": options.workers,
            "total_secs": total_secs,
            "views_per_sec": f64::from(options.views) / total_secs,
            "per_direct": total_secs / rasterised_secs,
            "per_cheapest_direct": total_secs / cheapest_secs,
            "unresolved_fraction": unresolved[i],
        });
        report::row(row)
    });
    Ok(Report::new(options.scene.clone(), Machine::here(&device), rows.collect()))
}

/// For views that are worth waiting for: in a burst, the last one waits for all others.
pub fn patient() -> RenderOptions {
    RenderOptions { deadline: Duration::from_secs(600), ..RenderOptions::default() }
}

/// Connects, and waits until the workers have joined and opened the scene: a cluster's start is not what is
/// measured.
///
/// # Errors
/// If they do not join within two minutes.
pub async fn connect(cluster: &LocalCluster, workers: usize) -> Result<Client> {
    let options = ConnectOptions { connections: 4, ..ConnectOptions::default() };
    let client = Client::connect_with(cluster.url(), &options).await?;
    let joined = async {
        while (client.status().await?.processes as usize) < workers {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        Ok::<_, ClientError>(())
    };
    tokio::time::timeout(Duration::from_secs(120), joined)
        .await
        .context("the workers did not join in time")??;
    Ok(client)
}
