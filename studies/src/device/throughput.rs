//! Throughput: warped views per second of one scene.
//!
//! Two rates are measured: the passes alone by the device's clock, and whole calls of the compositor, with frames read
//! back to the host. `argus-lab study load burst` measures answers over gRPC.

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::SamplerSettings;
use argus_scene::{Outputs, Plan, RigSettings, Search, Warp};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, compare, device_ms};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures warped views per second of one scene: on the device and read back
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Sizes of views in pixels, with commas between, each measured by itself
    #[arg(long = "size", value_name = "WxH", value_delimiter = ',', value_parser = size, default_value = or_quick("128x128,200x150", "64x64"))]
    pub sizes: Vec<[u32; 2]>,
    /// Number of views in a batch; larger batches are faster and use more memory
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("256", "8"))]
    pub batch: usize,
    /// Samples that a view is warped from
    #[arg(long, value_name = "N", value_parser = count, default_value = "4")]
    pub samples: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("5", "1"))]
    pub rounds: usize,
    /// Views of a batch whose error is measured
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("8", "2"))]
    pub judged: usize,
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "16")]
    pub reference_samples: u32,
}

/// Runs the study; `progress` counts sizes.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a view that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let mut bench = Bench::new(&gpu, &options.scene, &RigSettings::default(), SamplerSettings::default())?;
    progress.set_length(options.sizes.len() as u64);
    let mut rows = Vec::new();
    for &size in &options.sizes {
        rows.push(row(&mut bench, options, size)?);
        progress.inc(1);
    }
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    let Options { batch, samples, judged, reference_samples, .. } = options;
    report.notes = vec![format!(
        "{batch} views of a walk in a batch, {samples} samples each, splat search; FLIP of {judged} of them against \
         {reference_samples} rays a pixel."
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
        "flip": finite(mean(errors)),
        "unresolved_fraction": finite(unresolved),
    })))
}

fn finite(figure: f64) -> Option<f64> {
    figure.is_finite().then_some(figure)
}
