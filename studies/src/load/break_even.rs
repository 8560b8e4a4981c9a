//! Break-even: the number of views from which rendering samples is cheaper than rendering every view directly.
//!
//! N views cost S·g + N·c from samples and N·g directly, for each visibility backend. Both costs are linear in N, so
//! two measurements give each curve; the largest N is also timed in full as a check. Shading is plain; with effects of
//! light, which make direct views dearer, [`crate::light::equal_error`] has these numbers.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus::args;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::SamplerSettings;
use argus_scene::{Camera, Outputs, Plan, ViewJob, Visibility, Warp, path};
use indicatif::ProgressBar;
use serde_json::json;

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, SamplingCost};
use crate::median::median;
use crate::{Machine, Report, report};

/// Measures from how many views on samples are cheaper than direct views, for each visibility backend
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:2000000", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "64x48"))]
    pub size: [u32; 2],
    #[command(flatten)]
    rig: args::Rig,
    /// Largest number of views: a power of two
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("512", "32"))]
    pub most: usize,
    /// Direct views over which their cost is averaged
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub direct: usize,
    /// Warped views in a batch
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("64", "8"))]
    pub batch: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
}

/// The cost of samples and of direct views by one visibility backend.
struct BackendCost {
    visibility: Visibility,
    taken: SamplingCost,
    direct_ms: Vec<f64>,
}

/// Runs the study; `progress` counts scenes × rounds.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length((options.scenes.len() * (options.rounds + 1)) as u64);
    let mut report = Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), Vec::new());
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        scene(&gpu, spec, options, &mut report, progress).with_context(|| spec.clone())?;
    }
    Ok(report)
}

fn scene(
    gpu: &Arc<Gpu>,
    spec: &str,
    options: &Options,
    report: &mut Report,
    progress: &ProgressBar,
) -> Result<()> {
    let opened = Arc::new(argus_scene::open(spec)?);
    let mut backends = Vec::new();
    let mut bench =
        Bench::with_scene(gpu, Arc::clone(&opened), &options.rig.settings(), SamplerSettings::default())?;
    let cameras: Vec<Camera> = path::viewpoints(&bench.suggested(), options.most);
    let ids = bench.all_ids(&cameras, options.rig.samples(4));
    for visibility in Visibility::ALL {
        bench.set_visibility(visibility);
        // Views are warped from the last backend's samples; backends differ only along edges.
        let taken = bench.render_timed(ids.clone(), 1)?;
        backends.push(BackendCost { visibility, taken, direct_ms: Vec::new() });
    }
    let direct = |bench: &Bench, camera: &Camera, visibility| ViewJob {
        visibility,
        ..bench.job(*camera, options.size, Outputs::COLOR, Plan::direct(1))
    };
    let warped = |bench: &Bench, camera: &Camera| {
        let samples = bench.sample_ids(camera, options.rig.samples(4));
        bench.job(*camera, options.size, Outputs::COLOR, Plan::Warp(Warp { samples, ..Warp::default() }))
    };
    let mut warp_ms = Vec::new();
    for round in 0..=options.rounds {
        for backend in &mut backends {
            let jobs: Vec<ViewJob> = cameras
                .iter()
                .take(options.direct)
                .map(|camera| direct(&bench, camera, backend.visibility))
                .collect();
            let (ms, _) = bench.time(&jobs)?;
            // The first round also compiles the pipelines.
            if round > 0 {
                backend.direct_ms.push(ms / jobs.len() as f64);
            }
        }
        let jobs: Vec<ViewJob> = cameras.iter().map(|camera| warped(&bench, camera)).collect();
        let (mut total, mut done) = (0.0, 0);
        // The last round renders all views, so that the largest number is measured.
        let many = if round == options.rounds { jobs.len() } else { options.batch.min(jobs.len()) };
        for batch in jobs[..many].chunks(options.batch.max(1)) {
            total += bench.time(batch)?.0;
            done += batch.len();
        }
        if round > 0 {
            warp_ms.push(total / done as f64);
        }
        progress.inc(1);
    }
    let c = median(&warp_ms);
    let cheapest_samples =
        backends.iter().min_by(|a, b| a.taken.ms.total_cmp(&b.taken.ms)).context("there is a backend")?;
    let samples_ms = cheapest_samples.taken.ms;
    let name = &opened.name;
    let counts: Vec<f64> = (0..=options.most.max(1).ilog2()).map(|k| f64::from(1u32 << k)).collect();
    let mut series = vec![Series {
        name: "from samples, samples included".to_owned(),
        points: counts.iter().map(|&n| (n, (samples_ms + n * c) / n)).collect(),
        line: true,
    }];
    for backend in &backends {
        let g = median(&backend.direct_ms);
        let label = backend.visibility.name();
        for &n in &counts {
            report.rows.push(report::row(json!({
                "scene": name,
                "visibility": label,
                "views": n as u64,
                "direct_view_ms": g,
                "samples_ms": samples_ms,
                "warped_view_ms": c,
                "direct_total_ms": n * g,
                "warped_total_ms": samples_ms + n * c,
                "speed_up": n * g / (samples_ms + n * c),
            })));
        }
        report.notes.push(format!(
            "{name}: against direct views by {label} ({g:.2} ms each, its {} samples {:.0} ms), views from samples \
             ({c:.2} ms each after {samples_ms:.0} ms, by {}) {}.",
            backend.taken.count,
            backend.taken.ms,
            cheapest_samples.visibility.name(),
            match break_even(samples_ms, c, g) {
                Some(n) => format!("win from {n} on"),
                None => "never win".to_owned(),
            }
        ));
        let points = counts.iter().map(|&n| (n, g)).collect();
        series.push(Series { name: format!("direct, {label}"), points, line: true });
    }
    let [width, height] = options.size;
    report.plots.push(Plot {
        name: name.replace(|c: char| !c.is_ascii_alphanumeric(), "-"),
        title: format!("{name}, {width}×{height}: what a view costs"),
        x: Axis::log("views of one scene"),
        y: Axis::log("milliseconds a view, samples included"),
        series,
        ..Plot::default()
    });
    Ok(())
}

/// The smallest number of views for which samples and warped views cost less than direct views. `None` if a warped view
/// is no cheaper than a direct one, or if a cost is NaN.
pub(crate) fn break_even(samples_ms: f64, warped_ms: f64, direct_ms: f64) -> Option<u64> {
    let gain = direct_ms - warped_ms;
    (gain > 0.0 && samples_ms >= 0.0).then(|| (samples_ms / gain).floor() as u64 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_pay_from_the_first_view_whose_gain_covers_them() {
        assert_eq!(break_even(100.0, 1.0, 11.0), Some(11));
        assert_eq!(break_even(99.0, 1.0, 11.0), Some(10));
        assert_eq!(break_even(0.0, 1.0, 2.0), Some(1));
        assert_eq!(break_even(100.0, 2.0, 2.0), None);
        assert_eq!(break_even(f64::NAN, 1.0, 2.0), None);
        assert_eq!(break_even(1.0, f64::NAN, 2.0), None);
    }
}
