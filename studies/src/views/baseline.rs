//! Baseline: the cost of direct views, samples and warped views, and their error against the reference.
//!
//! For each scene and view size it measures:
//! - g, the time of one direct view, and S·g, the time of all samples, in milliseconds;
//! - c, the time of one warped view for each search, in a batch and alone, in milliseconds;
//! - FLIP, PSNR and SSIM of each method against the CPU reference.
//!
//! These are the quantities of the cluster paper, section 3. Both roles run in one process, so no network time is
//! included.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::SamplerSettings;
use argus_scene::metrics::Comparison;
use argus_scene::sample::SampleId;
use argus_scene::{Camera, Frame, Outputs, Plan, RigSettings, Search, ViewJob, Warp, path};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, SamplingCost, compare};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures the cost of direct views, samples, and the splat and linear searches, and their error against the reference
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:50000,terrain:500000,terrain:2000000", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Sizes of views in pixels, with commas between, each measured by itself
    #[arg(long = "size", value_name = "WxH", value_delimiter = ',', value_parser = size, default_value = or_quick("200x150,640x480", "96x72"))]
    pub sizes: Vec<[u32; 2]>,
    /// Views in a batch
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("64", "8"))]
    pub batch: usize,
    /// Views compared with the reference
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("8", "2"))]
    pub judged: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("64", "16"))]
    pub reference_samples: u32,
    /// Samples that a view is warped from
    #[arg(long, value_name = "N", value_parser = count, default_value = "4")]
    pub samples: usize,
}

/// The methods compared; each is a row.
const METHODS: [Method; 5] = [
    Method { name: "direct", plan: |_| Plan::direct(1) },
    Method { name: "direct 16×", plan: |_| Plan::direct(16) },
    Method { name: "splat", plan: |samples| warp(Search::Splat, 1, samples) },
    Method { name: "linear 64", plan: |samples| warp(Search::Linear, 64, samples) },
    Method { name: "linear 200", plan: |samples| warp(Search::Linear, 200, samples) },
];

struct Method {
    name: &'static str,
    plan: fn(Vec<SampleId>) -> Plan,
}

fn warp(search: Search, steps: u32, samples: Vec<SampleId>) -> Plan {
    Plan::Warp(Warp { search, steps, samples, ..Warp::default() })
}

/// Runs the study; `progress` counts scenes × sizes × methods.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let steps = options.scenes.len() * options.sizes.len() * METHODS.len();
    progress.set_length(steps as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let mut subject = Subject::new(&gpu, spec, options)?;
        for &size in &options.sizes {
            rows.extend(subject.rows(size, options, progress).with_context(|| spec.clone())?);
        }
    }
    let mut report = Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows);
    report.note_longest_pass(&gpu);
    Ok(report)
}

/// One scene with its samples rendered and held.
struct Subject {
    bench: Bench,
    cameras: Vec<Camera>,
    taken: SamplingCost,
}

impl Subject {
    fn new(gpu: &Arc<Gpu>, spec: &str, options: &Options) -> Result<Self> {
        let mut bench = Bench::new(gpu, spec, &RigSettings::default(), SamplerSettings::default())?;
        let cameras = path::viewpoints(&bench.suggested(), options.batch);
        let ids = bench.all_ids(&cameras, options.samples);
        let taken = bench.render_timed(ids, options.rounds.min(3))?;
        Ok(Self { bench, cameras, taken })
    }

    /// A row for each method at one size of view.
    fn rows(
        &mut self,
        size: [u32; 2],
        options: &Options,
        progress: &ProgressBar,
    ) -> Result<Vec<Map<String, Value>>> {
        let jobs = METHODS.map(|method| -> Vec<ViewJob> {
            let job = |&camera: &Camera| {
                let plan = (method.plan)(self.bench.sample_ids(&camera, options.samples));
                self.bench.job(camera, size, Outputs::COLOR, plan)
            };
            self.cameras.iter().map(job).collect()
        });
        let mut batch_ms = [const { Vec::new() }; METHODS.len()];
        let mut alone_ms = [const { Vec::new() }; METHODS.len()];
        let mut frames: [Vec<Frame>; METHODS.len()] = Default::default();
        for round in 0..=options.rounds {
            for (method, jobs) in jobs.iter().enumerate() {
                // Only the splat search gains from a batch. A linear step costs the same alone, so fewer views are
                // enough.
                let batched = matches!(&jobs[0].plan, Plan::Warp(warp) if warp.search == Search::Splat);
                let many = if batched { jobs.len() } else { options.judged.min(jobs.len()) };
                let (ms, answered) = self.bench.time(&jobs[..many])?;
                let (one_ms, _) = self.bench.time(&jobs[..1])?;
                if round > 0 {
                    batch_ms[method].push(ms / many as f64);
                    alone_ms[method].push(one_ms);
                }
                frames[method] = answered;
            }
        }
        let references = self.references(size, options);
        let g = median(&batch_ms[0]);
        let mut rows = Vec::new();
        for (i, method) in METHODS.iter().enumerate() {
            let judged =
                frames[i].iter().zip(&references).map(|(frame, reference)| compare(frame, reference));
            let judged = judged.collect::<Result<Vec<Comparison>>>()?;
            let view_ms = median(&batch_ms[i]);
            let unresolved = mean(frames[i].iter().map(|frame| frame.unresolved_fraction));
            let row = json!({
                "scene": self.bench.scene.name,
                "triangles": self.bench.scene.triangles(),
                "size": format!("{}x{}", size[0], size[1]),
                "method": method.name,
                "view_ms": view_ms,
                "view_alone_ms": median(&alone_ms[i]),
                "per_direct": view_ms / g,
                "samples": self.taken.count,
                "samples_ms": self.taken.ms,
                "flip": mean(judged.iter().map(|c| c.flip_mean)),
                "psnr_db": mean(judged.iter().map(|c| c.psnr_db)),
                "ssim": mean(judged.iter().map(|c| c.ssim)),
                "unresolved_fraction": unresolved,
            });
            rows.push(report::row(row));
            progress.inc(1);
        }
        Ok(rows)
    }

    /// Reference images of the judged views.
    fn references(&self, size: [u32; 2], options: &Options) -> Vec<RgbImage> {
        let truth = |camera| self.bench.truth(camera, size, options.reference_samples, &[]).image;
        self.cameras.iter().take(options.judged).map(truth).collect()
    }
}
