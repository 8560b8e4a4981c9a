//! Views from triangles in less detail: their time and error, which the planner weighs under load.
//!
//! Each scene is lit as the service lights it. The reference of a view is the view itself with many samples a pixel.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::SamplerSettings;
use argus_scene::metrics::Comparison;
use argus_scene::{
    Camera, Detail, Frame, Indirect, LightEffects, Outputs, PathSettings, Plan, RigSettings, ViewJob,
    Visibility, path,
};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, compare, image_of};
use crate::median::{mean, median};
use crate::metered::open_metered;
use crate::{Machine, Report, report};

/// Measures views from triangles in less detail: time and error, which the planner weighs under load
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:50000,terrain:500000,rooms", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("320x240", "96x72"))]
    pub size: [u32; 2],
    /// Number of views of each scene
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub views: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "16")]
    pub reference_samples: u32,
}

/// Runs the study; `progress` counts scenes × views.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length((options.scenes.len() * options.views) as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        rows.extend(rows_of(&gpu, spec, options, progress).with_context(|| spec.clone())?);
    }
    Ok(Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows))
}

/// Times and errors of one detail.
#[derive(Default)]
struct Measured {
    ms: Vec<f64>,
    judged: Vec<Comparison>,
}

/// A row for each detail of a scene.
fn rows_of(
    gpu: &Arc<Gpu>,
    spec: &str,
    options: &Options,
    progress: &ProgressBar,
) -> Result<Vec<Map<String, Value>>> {
    let settings = SamplerSettings {
        effects: LightEffects::ALL,
        indirect: Indirect::Paths(PathSettings::default()),
        ..SamplerSettings::default()
    };
    let mut bench = Bench::with_scene(gpu, open_metered(spec)?, &RigSettings::default(), settings)?;
    let mut measured = Detail::ALL.map(|_| Measured::default());
    for camera in path::viewpoints(&bench.suggested(), options.views) {
        let reference = reference(&mut bench, camera, options)?;
        for round in 0..=options.rounds {
            for (detail, measured) in Detail::ALL.into_iter().zip(&mut measured) {
                let job = job(
                    &bench,
                    camera,
                    options.size,
                    Plan::Direct { samples_per_pixel: 1, detail, light: None },
                );
                let (ms, frames) = bench.time(&[job])?;
                // The first round also compiles pipelines.
                if round == 0 {
                    let frame = frames.first().context("no frame came")?;
                    measured.judged.push(compare(frame, &reference)?);
                } else {
                    measured.ms.push(ms);
                }
            }
        }
        progress.inc(1);
    }
    let (whole_ms, whole) = (median(&measured[0].ms), mean(measured[0].judged.iter().map(|c| c.flip_mean)));
    let row = |(detail, measured): (Detail, &Measured)| {
        let flip = mean(measured.judged.iter().map(|c| c.flip_mean));
        let ms = median(&measured.ms);
        report::row(json!({
            "scene": bench.scene.name,
            "size": format!("{}x{}", options.size[0], options.size[1]),
            "detail": detail.name(),
            "view_ms": ms,
            "per_full": ms / whole_ms,
            "flip": flip,
            "excess": flip - whole,
            "psnr_db": mean(measured.judged.iter().map(|c| c.psnr_db)),
            "ssim": mean(measured.judged.iter().map(|c| c.ssim)),
        }))
    };
    Ok(Detail::ALL.into_iter().zip(&measured).map(row).collect())
}

fn job(bench: &Bench, camera: Camera, size: [u32; 2], plan: Plan) -> ViewJob {
    ViewJob { visibility: Visibility::Cpu, ..bench.job(camera, size, Outputs::COLOR, plan) }
}

/// The view with many samples a pixel.
fn reference(bench: &mut Bench, camera: Camera, options: &Options) -> Result<RgbImage> {
    let job = job(bench, camera, options.size, Plan::direct(options.reference_samples));
    let (_, frames): (f64, Vec<Frame>) = bench.time(&[job])?;
    image_of(frames.first().context("no reference came")?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_detail_takes_less_time_and_errs_more() {
        let report = run(&crate::arguments::options(true), &ProgressBar::hidden()).unwrap();
        let column =
            |name: &str| -> Vec<f64> { report.rows.iter().map(|row| row[name].as_f64().unwrap()).collect() };
        let flips = column("flip");
        assert!(flips[4] > flips[2] && flips[2] > flips[0], "{flips:?}");
        assert!(column("per_full")[4] < 1.0, "{:?}", column("per_full"));
    }
}
