//! Burst: many views at once over gRPC, from a cluster that has rendered nothing yet.
//!
//! The cluster paper's 290 views (section 5), one by one or as one batch, whose plan the service chooses. The time includes the
//! samples; the baseline renders every view directly.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use argus_client::load::{IN_FLIGHT, burst, path_views, patient};
use argus_client::{Batch, Client};
use argus_local::{LocalCluster, connect};
use argus_proto::v1::Encoding;
use argus_scene::{Frame, Outputs, Plan, PlanRequest, View};
use futures::StreamExt as _;
use indicatif::ProgressBar;
use serde_json::json;

use crate::arguments::{count, or_quick, size};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures many views at once over gRPC, from a cluster without samples, against rendering them all directly
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Number of views
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("290", "16"))]
    pub views: u32,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Number of rounds, each with a new cluster; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
}

/// How views are requested.
#[derive(Debug, Clone, Copy)]
enum Request {
    /// One by one, with this plan.
    Views(PlanRequest),
    /// As one batch that leaves the way open.
    Batch,
}

/// What the frames of a burst were.
#[derive(Debug, Default)]
struct Frames {
    unresolved: Vec<f64>,
    from_samples: Vec<f64>,
}

impl Frames {
    fn add(&mut self, frame: &Frame) {
        self.unresolved.push(frame.unresolved_fraction);
        self.from_samples.push(f64::from(u8::from(matches!(frame.provenance.plan, Plan::Warp(_)))));
    }
}

/// Runs the study with clusters of the program `argus`; `progress` counts rounds × methods.
///
/// # Errors
/// A cluster that does not come up, or a view that is not answered.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    // Once the samples are rendered, a sampler is idle unless it may also compose. Direct views are measured with the
    // cheapest visibility backend and with the rasteriser.
    let (direct, splat) = (Request::Views(direct), Request::Views(PlanRequest::from_samples()));
    let methods = [
        ("a batch, by default", Request::Batch, ["--samplers-composite=true", "--visibility=auto"]),
        ("splat, samplers also compose", splat, ["--samplers-composite=true", "--visibility=auto"]),
        ("splat", splat, ["--samplers-composite=false", "--visibility=auto"]),
        ("direct, cheapest way", direct, ["--samplers-composite=false", "--visibility=auto"]),
        ("direct, rasterised", direct, ["--samplers-composite=false", "--visibility=raster"]),
    ];
    progress.set_length((methods.len() * options.rounds) as u64);
    let mut secs = methods.map(|_| Vec::new());
    let (mut unresolved, mut from_samples) = (methods.map(|_| 0.0), methods.map(|_| 0.0));
    let mut device = String::new();
    for _ in 0..options.rounds {
        for (i, (name, request, arguments)) in methods.into_iter().enumerate() {
            progress.set_message(name);
            let cluster =
                LocalCluster::start(argus, &options.scene, options.workers, &arguments.map(str::to_owned))?;
            let client = connect(&cluster, options.workers).await?;
            device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
            let mut frames = Frames::default();
            secs[i].push(ask(&client, request, options, &mut frames).await?);
            unresolved[i] = mean(frames.unresolved);
            from_samples[i] = mean(frames.from_samples);
            cluster.stop()?;
            progress.inc(1);
        }
    }
    let (cheapest_secs, rasterised_secs) = (median(&secs[3]), median(&secs[4]));
    let rows = methods.iter().enumerate().map(|(i, (name, ..))| {
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
            "from_samples": from_samples[i],
            "unresolved_fraction": unresolved[i],
        });
        report::row(row)
    });
    Ok(Report::new(options.scene.clone(), Machine::here(&device), rows.collect()))
}

/// Requests all views, and takes their frames. Returns the seconds until all were answered.
///
/// # Errors
/// A view that is not answered.
async fn ask(client: &Client, request: Request, options: &Options, frames: &mut Frames) -> Result<f64> {
    let views = |plan| path_views(client.description(), options.views, options.size, plan);
    let plan = match request {
        Request::Batch => return ask_as_a_batch(client, views(PlanRequest::default()), frames).await,
        Request::Views(plan) => plan,
    };
    let outcome =
        burst(client, views(plan), IN_FLIGHT, &patient(), |_, answer| frames.add(&answer.frame)).await;
    if let Some(error) = outcome.first_error {
        bail!("{} of {} views were not answered: {error}", outcome.failed, outcome.views);
    }
    Ok(outcome.total_ms / 1e3)
}

async fn ask_as_a_batch(client: &Client, views: Vec<View>, frames: &mut Frames) -> Result<f64> {
    let first = views.first().context("no views were asked for")?;
    let (width, height, plan) = (first.width, first.height, first.plan);
    let cameras = views.iter().map(|view| view.camera).collect();
    let batch = Batch { cameras, width, height, outputs: Outputs::COLOR, plan };
    let began = Instant::now();
    let mut answers = std::pin::pin!(client.render_batch(batch, Encoding::Unspecified));
    while let Some((index, answer)) = answers.next().await {
        let (frame, _) = answer.with_context(|| format!("view {index} was not answered"))?;
        frames.add(&frame);
    }
    Ok(began.elapsed().as_secs_f64())
}
