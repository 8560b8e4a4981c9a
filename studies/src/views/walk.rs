//! Walk: laps through a scene over gRPC. Measures how many pixels no sample saw, and how they vanish while the
//! cluster places samples where views have holes.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result};
use argus::args;
use argus_client::load::patient;
use argus_client::{Answer, Client};
use argus_local::{LocalCluster, connect};
use argus_scene::metrics;
use argus_scene::{Bounds, Camera, Output, Outputs, PlanRequest, View};
use glam::DVec3;
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use crate::arguments::{count, or_quick, positive, size};
use crate::median::{mean, median};
use crate::{Machine, Report};

/// Measures laps through a scene: pixels that no sample saw, and how they vanish as samples are placed where views have
/// holes
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:50000", "terrain:20000"))]
    pub scene: String,
    /// Number of viewpoints in a lap
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("48", "8"))]
    pub views: usize,
    /// Number of laps
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("6", "2"))]
    pub laps: usize,
    /// Longest pause between two laps in seconds, for samples to be placed
    #[arg(long = "pause", value_name = "SECONDS", value_parser = positive, default_value = or_quick("60", "3"))]
    pub pause_secs: f64,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Views of a lap whose FLIP is measured
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "1"))]
    pub judged: usize,
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    #[command(flatten)]
    rig: args::PassedOn<args::Rig>,
}

/// Samples a side of a reference's pixel.
const REFERENCE_SIDE: u32 = 4;

/// Runs the study with a cluster of the program `argus`; `progress` counts laps.
///
/// # Errors
/// A cluster that does not start, or a view that is not answered.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(options.laps as u64);
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &options.rig.arguments)?;
    let client = connect(&cluster, options.workers).await?;
    let device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
    let cameras = walk(&client.description().bounds, options.views);
    let step = (options.views / options.judged.max(1)).max(1);
    let mut truths: Vec<Option<Truth>> = cameras.iter().map(|_| None).collect();
    let mut rows = Vec::new();
    for lap in 0..options.laps {
        if lap > 0 {
            progress.set_message("samples are placed");
            settle(&client, options.pause_secs).await?;
        }
        progress.set_message("a lap");
        let (mut unresolved, mut flips, mut direct_flips) = (Vec::new(), Vec::new(), Vec::new());
        let (mut view_ms, mut samples_ms) = (Vec::new(), Vec::new());
        for (i, camera) in cameras.iter().enumerate() {
            let answer = look(&client, options, *camera, PlanRequest::from_samples()).await?;
            unresolved.push(answer.frame.unresolved_fraction);
            let stage = |of: fn(&str) -> bool| {
                answer.frame.stages.iter().filter(|s| of(&s.name)).map(|s| s.ms).sum::<f64>()
            };
            view_ms.push(stage(|name| !["samples", "queue", "relay", "encode"].contains(&name)));
            samples_ms.push(stage(|name| name == "samples"));
            if i % step == 0 && flips.len() < options.judged {
                if truths[i].is_none() {
                    truths[i] = Some(Truth::of(&client, options, *camera).await?);
                }
                if let Some(truth) = &truths[i] {
                    flips.push(metrics::compare(&truth.reference, &image_of(&answer)?)?.flip_mean);
                    direct_flips.push(truth.direct_flip);
                }
            }
        }
        let status = client.status().await?;
        let row = json!({
            "scene": options.scene,
            "lap": lap + 1,
            "views": options.views,
            "unresolved_fraction": mean(unresolved.iter().copied()),
            "unresolved_worst": unresolved.iter().copied().fold(0.0, f64::max),
            "flip": mean(flips),
            "direct_flip": mean(direct_flips),
            "samples_held": status.workers.iter().map(|w| w.samples_held).max().unwrap_or(0),
            "refinements": status.refined().usable,
            "refinements_wanted": status.refined().wanted,
            "samples_rendered": status.workers.iter().map(|w| w.samples_rendered).sum::<u64>(),
            "sample_ms": status.sample_ms,
            "view_ms": median(&view_ms),
            "samples_wait_ms": mean(samples_ms),
        });
        let Value::Object(row) = row else { unreachable!("an object literal is an object") };
        rows.push(row);
        progress.inc(1);
    }
    cluster.stop()?;
    Ok(Report::new(options.scene.clone(), Machine::here(&device), rows))
}

/// The reference of a view.
struct Truth {
    /// A direct view with many samples per pixel.
    reference: RgbImage,
    /// FLIP of the direct view with one sample per pixel, which no warp can be expected to beat.
    direct_flip: f64,
}

impl Truth {
    async fn of(client: &Client, options: &Options, camera: Camera) -> Result<Self> {
        let direct = |supersampling| PlanRequest {
            direct: true,
            supersampling: Some(supersampling),
            ..PlanRequest::default()
        };
        let reference = image_of(&look(client, options, camera, direct(REFERENCE_SIDE)).await?)?;
        let shown = image_of(&look(client, options, camera, direct(1)).await?)?;
        let direct_flip = metrics::compare(&reference, &shown)?.flip_mean;
        Ok(Self { reference, direct_flip })
    }
}

async fn look(client: &Client, options: &Options, camera: Camera, plan: PlanRequest) -> Result<Answer> {
    let [width, height] = options.size;
    let view =
        View { camera, width, height, outputs: Outputs::COLOR, plan, pin: None, flow_to: None, rays: None };
    Ok(client.render(&view, &patient()).await?)
}

fn image_of(answer: &Answer) -> Result<RgbImage> {
    let frame = &answer.frame;
    let color = frame.images[Output::Color].as_ref().context("the frame has no colour")?;
    RgbImage::from_raw(frame.width, frame.height, color.to_vec()).context("the frame is not of its size")
}

/// Waits until the cluster has placed all wanted samples, for at most `secs` seconds.
async fn settle(client: &Client, secs: f64) -> Result<()> {
    let until = tokio::time::Instant::now() + Duration::from_secs_f64(secs);
    let mut calm = 0;
    while calm < 4 && tokio::time::Instant::now() < until {
        tokio::time::sleep(Duration::from_millis(500)).await;
        let refinements = client.status().await?.refined();
        let done = refinements.wanted == 0 && refinements.usable == refinements.placed;
        calm = if done { calm + 1 } else { 0 };
    }
    Ok(())
}

/// Viewpoints along a closed oval at eye height, 56% of the scene's extent in x and 12% in z. In Sponza it leads up
/// the nave and back, past columns, curtains and plants. Views look ahead and sometimes aside.
fn walk(bounds: &Bounds, count: usize) -> Vec<Camera> {
    let (center, size) = (bounds.center(), bounds.size());
    let height = bounds.min.y + 0.21 * size.y;
    let at = |turn: f64| {
        let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
        DVec3::new(center.x + 0.28 * size.x * cos, height, center.z + 0.06 * size.z * sin)
    };
    (0..count)
        .map(|i| {
            let turn = i as f64 / count as f64;
            let (eye, ahead) = (at(turn), at(turn + 0.05) - at(turn));
            // 50° to either side, slower than a step, so that a lap sees the walls too.
            let aside = 50.0_f64.to_radians() * (turn * 7.0 * std::f64::consts::TAU).sin();
            let look = glam::DQuat::from_rotation_y(aside) * ahead.normalize_or(DVec3::X);
            Camera { fov_deg: 60.0, ..Camera::look_at(eye, eye + look + DVec3::Y * 0.1) }
        })
        .collect()
}
