//! Throughput: warped views per second of one scene.
//!
//! Three rates are measured: the passes alone by the device's clock; whole calls of the compositor, with frames read
//! back to the host; and answers over gRPC of a service on this machine.

use std::path::Path;

use anyhow::{Result, bail};
use argus_client::Answer;
use argus_client::load::{IN_FLIGHT, burst, path_views, patient};
use argus_gpu::{Gpu, GpuOptions};
use argus_local::{LocalCluster, connect};
use argus_sampler::SamplerKnobs;
use argus_scene::{Outputs, Plan, PlanRequest, RigKnobs, Search, Warp};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::bench::{Bench, compare, device_ms};
use crate::median::{mean, median};
use crate::{Effort, Machine, Report, report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// A scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// View sizes in pixels.
    pub sizes: Vec<[u32; 2]>,
    /// Views in a batch of the compositor.
    pub batch: usize,
    /// Samples used for each warped view.
    pub samples: usize,
    /// Views requested from the service at once, per round.
    pub delivered: u32,
    /// Worker processes of the service; 0: the service is not measured.
    pub workers: usize,
    /// Measured rounds; each rate is their median.
    pub rounds: usize,
    /// Views of a batch whose error is measured.
    pub judged: usize,
    /// Reference samples per pixel: a square number.
    pub reference_samples: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            scene: "terrain:500000".to_owned(),
            sizes: vec![[128, 128], [200, 150]],
            batch: 256,
            samples: 4,
            delivered: 4096,
            workers: 2,
            rounds: 5,
            judged: 8,
            reference_samples: 16,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:20000".to_owned(),
            sizes: vec![[64, 64]],
            batch: 8,
            delivered: 32,
            rounds: 1,
            judged: 2,
            ..Self::default()
        }
    }
}

/// Runs the study with services of the program `argus`; `progress` counts sizes.
///
/// # Errors
/// A scene that cannot be opened, no GPU, a view that fails or is not answered.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(2 * options.sizes.len() as u64);
    let local = {
        let (options, progress) = (options.clone(), progress.clone());
        tokio::task::spawn_blocking(move || local(&options, &progress)).await??
    };
    let mut report = local;
    for (row, &size) in report.rows.iter_mut().zip(&options.sizes) {
        let rate = if options.workers > 0 { Some(delivered(argus, options, size).await?) } else { None };
        row.insert("delivered_views_per_sec".to_owned(), json!(rate));
        progress.inc(1);
    }
    Ok(report)
}

/// The rows without the service.
fn local(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let mut bench = Bench::new(&gpu, &options.scene, &RigKnobs::default(), SamplerKnobs::default())?;
    let mut rows = Vec::new();
    for &size in &options.sizes {
        rows.push(row(&mut bench, options, size)?);
        progress.inc(1);
    }
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.notes = vec![format!(
        "{} views of a walk in a batch, {} samples each, splat search; FLIP of {} of them against {} rays a pixel. Delivered: \
        {} views requested at once, {IN_FLIGHT} in flight, from {} worker processes, losslessly packed.",
        options.batch,
        options.samples,
        options.judged,
        options.reference_samples,
        options.delivered,
        options.workers
    )];
    report.note_longest_pass(&gpu);
    Ok(report)
}

fn row(bench: &mut Bench, options: &Options, size: [u32; 2]) -> Result<Map<String, Value>> {
    let cameras = bench.walk(options.batch);
    bench.hold(&bench.all_ids(&cameras, options.samples))?;
    let job = |camera| {
        let samples = bench.sample_ids(camera, options.samples);
        let warp = Warp { search: Search::Splat, samples, ..Warp::default() };
        bench.job(*camera, size, Outputs::COLOR, Plan::Warp(warp))
    };
    let jobs: Vec<_> = cameras.iter().map(job).collect();
    let (mut on_device, mut read_back) = (Vec::new(), Vec::new());
    let (mut errors, mut unresolved) = (Vec::new(), f64::NAN);
    // The first rounds compile pipelines and try both programs of the search.
    let program = bench.decide_program(&jobs)?;
    for _ in 0..options.rounds {
        let (ms, frames) = bench.time(&jobs)?;
        on_device.push(1e3 / device_ms(&frames));
        read_back.push(jobs.len() as f64 * 1e3 / ms);
        if errors.is_empty() {
            unresolved = mean(frames.iter().map(|frame| frame.unresolved_fraction));
            let step = (frames.len() / options.judged.max(1)).max(1);
            for (frame, camera) in frames.iter().zip(&cameras).step_by(step).take(options.judged) {
                let truth = bench.truth(camera, size, options.reference_samples, &[]);
                errors.push(compare(frame, &truth.image)?.flip_mean);
            }
        }
    }
    Ok(report::row(json!({
        "scene": options.scene,
        "size": format!("{}x{}", size[0], size[1]),
        "batch": options.batch,
        "program": program,
        "device_views_per_sec": finite(median(&on_device)),
        "read_back_views_per_sec": finite(median(&read_back)),
        "delivered_views_per_sec": null,
        "flip": finite(mean(errors)),
        "unresolved_fraction": finite(unresolved),
    })))
}

/// Views per second of a service whose samples are rendered.
async fn delivered(argus: &Path, options: &Options, size: [u32; 2]) -> Result<f64> {
    let arguments = ["--samplers-composite=true", "--visibility=auto"].map(str::to_owned);
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &arguments)?;
    let client = connect(&cluster, options.workers).await?;
    let plan = PlanRequest::from_samples();
    let mut rates = Vec::new();
    // The first round waits for the samples.
    for round in 0..=options.rounds {
        let views = path_views(client.description(), options.delivered, size, plan);
        let outcome = burst(&client, views, IN_FLIGHT, &patient(), |_, _: Answer| ()).await;
        if let Some(error) = outcome.first_error {
            bail!("{} of {} views were not answered: {error}", outcome.failed, outcome.views);
        }
        if round > 0 {
            rates.push(outcome.views_per_sec);
        }
    }
    cluster.stop()?;
    Ok(median(&rates))
}

fn finite(figure: f64) -> Option<f64> {
    figure.is_finite().then_some(figure)
}
