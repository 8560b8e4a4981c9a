//! Visibility: the cost of each visibility backend, and how far the backends agree.
//!
//! For each scene, view size and number of sub-samples it measures:
//! - the time to fill a visibility buffer by the rasteriser, by packets on the CPU and by packets in compute;
//! - the share of sub-samples whose ids differ from the rasteriser's;
//! - the time of a whole direct view with each backend, and of 1% and 5% of its pixels as single rays;
//! - the time of a sample of the scene's rig.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::SamplerSettings;
use argus_scene::{
    Camera, Cancel, Outputs, PixelJob, Plan, RenderError, RigSettings, SampleId, SampleJob, Sampler as _,
    SceneState, Visibility, path,
};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::Bench;
use crate::median::{mean, median};
use crate::{Machine, Report};

/// Measures the cost of each visibility backend, for whole views, single pixels and samples, and how far the backends
/// agree
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:500000,terrain:2000000", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Sizes of views in pixels, with commas between, each measured by itself
    #[arg(long = "size", value_name = "WxH", value_delimiter = ',', value_parser = size, default_value = or_quick("200x150,640x480", "96x72"))]
    pub sizes: Vec<[u32; 2]>,
    /// Samples a pixel: square numbers
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("1,4", "1"))]
    pub sub_samples: Vec<u32>,
    /// Viewpoints over which times are averaged
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub views: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
}

/// The compared backends, where the device has them. A row names the cheapest.
const BACKENDS: [Visibility; 3] = [Visibility::Raster, Visibility::Cpu, Visibility::Trace];

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length((options.scenes.len() * options.sizes.len() * options.sub_samples.len()) as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let mut subject = Subject::new(&gpu, spec)?;
        let backends = subject.backends.clone();
        let sample_ms = backends
            .into_iter()
            .map(|backend| subject.sample_ms(backend, options.rounds))
            .collect::<Result<Vec<_>>>()?;
        let cameras = path::viewpoints(&subject.bench.suggested(), options.views);
        for &size in &options.sizes {
            for &samples in &options.sub_samples {
                rows.push(subject.row(spec, &cameras, size, samples, &sample_ms, options.rounds)?);
                progress.inc(1);
            }
        }
    }
    let mut report = Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows);
    report.note_longest_pass(&gpu);
    Ok(report)
}

/// One scene, and the device's visibility backends.
struct Subject {
    bench: Bench,
    backends: Vec<Visibility>,
    build_ms: f64,
}

impl Subject {
    fn new(gpu: &Arc<Gpu>, spec: &str) -> Result<Self> {
        let mut bench = Bench::new(gpu, spec, &RigSettings::default(), SamplerSettings::default())?;
        let camera = bench.scene.default_camera();
        // Built first, before other work of the sampler.
        let begin = Instant::now();
        bench.sampler.identify(&camera, [8, 8], 1, Visibility::Cpu)?;
        let build_ms = ms(begin.elapsed());
        let mut has = |backend: &Visibility| match bench.sampler.identify(&camera, [8, 8], 1, *backend) {
            Ok(_) => Ok(Some(*backend)),
            Err(RenderError::Invalid(_)) => Ok(None),
            Err(error) => Err(error),
        };
        let backends = BACKENDS.iter().map(&mut has).collect::<Result<Vec<_>, RenderError>>()?;
        Ok(Self { backends: backends.into_iter().flatten().collect(), bench, build_ms })
    }

    /// Median milliseconds of one sample in the middle of the scene's rig.
    fn sample_ms(&mut self, backend: Visibility, rounds: usize) -> Result<f64> {
        let camera = self.bench.suggested()[0];
        let index = self.bench.info.rig.nearest(&camera, 1).first().copied().unwrap_or(0);
        self.bench.set_visibility(backend);
        let ids = vec![SampleId { version: 0, camera: index }];
        let job = SampleJob::new(Arc::clone(&self.bench.info), ids, false);
        let sampler = &mut self.bench.sampler;
        timed(rounds, || {
            sampler.render_samples(&job, &Cancel::new()).into_iter().collect::<Result<Vec<_>, _>>()
        })
    }

    fn row(
        &mut self,
        spec: &str,
        cameras: &[Camera],
        size: [u32; 2],
        samples: u32,
        sample_ms: &[f64],
        rounds: usize,
    ) -> Result<Map<String, Value>> {
        let backends = self.backends.clone();
        let mut see = vec![Vec::new(); backends.len()];
        let mut direct = vec![Vec::new(); backends.len()];
        let mut differing = vec![Vec::new(); backends.len()];
        let (mut few, mut some) = (Vec::new(), Vec::new());
        for camera in cameras {
            let mut found = Vec::new();
            for (i, &backend) in backends.iter().enumerate() {
                let sampler = &mut self.bench.sampler;
                let mut times = Vec::new();
                let mut ids = Vec::new();
                // The first round is not counted: the driver compiles.
                for round in 0..=rounds {
                    let (seen, took) = sampler.identify(camera, size, samples.isqrt(), backend)?;
                    ids = seen;
                    if round > 0 {
                        times.push(ms(took));
                    }
                }
                see[i].push(median(&times));
                found.push(ids);
                self.bench.set_visibility(backend);
                let job = self.bench.job(*camera, size, Outputs::COLOR, Plan::direct(samples));
                direct[i].push(timed(rounds, || self.bench.time(std::slice::from_ref(&job)))?);
            }
            for (ids, differing) in found.iter().zip(&mut differing) {
                let apart = found[0].iter().zip(ids).filter(|(a, b)| a != b).count();
                differing.push(apart as f64 / ids.len().max(1) as f64);
            }
            for (percent, times) in [(1, &mut few), (5, &mut some)] {
                let job = pixels(camera, size, samples, percent);
                let sampler = &mut self.bench.sampler;
                let cancel = Cancel::new();
                times.push(timed(rounds, || {
                    sampler
                        .render_pixels(std::slice::from_ref(&job), &cancel)
                        .into_iter()
                        .collect::<Result<Vec<_>, _>>()
                })?);
            }
        }
        let cheapest =
            (0..backends.len()).min_by(|&a, &b| mean_of(&direct[a]).total_cmp(&mean_of(&direct[b])));
        let name = |i: usize| backends[i].name();
        let mut row = Map::new();
        row.insert("scene".to_owned(), json!(spec));
        row.insert("size".to_owned(), json!(format!("{}x{}", size[0], size[1])));
        row.insert("sub_samples".to_owned(), json!(samples));
        for (i, times) in see.iter().enumerate() {
            row.insert(format!("see_{}_ms", name(i)), json!(mean_of(times)));
        }
        for (i, shares) in differing.iter().enumerate().skip(1) {
            row.insert(format!("differing_{}_fraction", name(i)), json!(mean_of(shares)));
        }
        for (i, times) in direct.iter().enumerate() {
            row.insert(format!("direct_{}_ms", name(i)), json!(mean_of(times)));
        }
        row.insert("cheapest".to_owned(), json!(cheapest.map(name)));
        row.insert("pixels_1_percent_ms".to_owned(), json!(mean_of(&few)));
        row.insert("pixels_5_percent_ms".to_owned(), json!(mean_of(&some)));
        for (i, time) in sample_ms.iter().enumerate() {
            row.insert(format!("sample_{}_ms", name(i)), json!(time));
        }
        row.insert("build_ms".to_owned(), json!(self.build_ms));
        Ok(row)
    }
}

/// Some of a view's pixels, scattered in 4 × 4 squares as holes are; a hash of each square selects them.
fn pixels(camera: &Camera, [width, height]: [u32; 2], samples_per_pixel: u32, percent: u32) -> PixelJob {
    let holed = |pixel: &u32| {
        let square =
            (pixel / width / 4).wrapping_mul(0x9e37_79b1) ^ (pixel % width / 4).wrapping_mul(0x85eb_ca77);
        let mixed = (square ^ square >> 15).wrapping_mul(0x2c1b_3c6d);
        (mixed >> 12) % 100 < percent
    };
    let pixels = (0..width * height).filter(holed).collect();
    let (camera, reflections) = (*camera, None);
    PixelJob {
        camera,
        width,
        height,
        pixels,
        samples_per_pixel,
        state: SceneState::default(),
        time_secs: 0.0,
        reflections,
    }
}

/// Median milliseconds of a call, without the first round.
fn timed<T>(rounds: usize, mut call: impl FnMut() -> Result<T, RenderError>) -> Result<f64> {
    let mut times = Vec::new();
    for round in 0..=rounds {
        let begin = Instant::now();
        call()?;
        if round > 0 {
            times.push(ms(begin.elapsed()));
        }
    }
    Ok(median(&times))
}

fn mean_of(values: &[f64]) -> f64 {
    mean(values.iter().copied())
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_pixels_are_about_as_many_as_asked_and_ascend() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
        for percent in [1, 5] {
            let job = pixels(&camera, [640, 480], 1, percent);
            let share = job.pixels.len() as f64 / (640.0 * 480.0) * 100.0;
            assert!((share - f64::from(percent)).abs() < 0.4 * f64::from(percent), "{share}");
            assert!(job.pixels.is_sorted());
        }
    }
}
