//! Error bounds: how often frames keep them, and what they cost.
//!
//! Random views are rendered with every setting. Some of them calibrate a model. On the rest the coordinator's choice is
//! replayed: try a setting, judge the frame, deliver it or try the next. Discarded frames count towards the time. The
//! baseline is an oracle that knows every error beforehand and takes the cheapest setting within the bound.

use anyhow::Result;
use argus_cluster::core::quality::choose::{self, QualityTarget, Step};
use argus_cluster::core::quality::{Answer, Model, Pace, Setting, Trial};
use argus_gpu::{Gpu, GpuOptions};
use argus_local::models;
use argus_scene::{Holes, PlanRequest, RigSettings, Search};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, is_quick, or_quick, size};
use crate::load::calibration::{self, Answers, share, tally};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures how often error bounds hold in random views, and what they cost against the cheapest setting that keeps them.
/// The calibrated model is saved, and services on this machine use it from then on
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Number of random views that calibrate the model
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("100", "12"))]
    pub calibration: usize,
    /// Number of further random views that test the bounds
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("100", "6"))]
    pub views: usize,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "64x48"))]
    pub size: [u32; 2],
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("16", "4"))]
    pub reference_samples: u32,
    /// Cells of a `cell` rig from which views are drawn
    #[arg(long, value_name = "N", value_parser = count, default_value = "12")]
    pub cells: usize,
    /// Error bounds, as multiples of the calibration views' median error in the default setting
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0.5,1,2")]
    pub bounds: Vec<f64>,
    /// Whether fitted models are saved for coordinators to use.
    #[arg(skip = !is_quick())]
    pub keep: bool,
}

/// Random seeds of the two disjoint sets of views.
const CALIBRATION_SEED: u64 = 11;
const TEST_SEED: u64 = 12;

/// Runs the study; `progress` counts views.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length((options.scenes.len() * (options.calibration + options.views)) as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let mut bench = Answers::open(&gpu, spec, &RigSettings::default())?;
        let calibrating = bench.views(options.calibration, options.cells, CALIBRATION_SEED);
        let testing = bench.views(options.views, options.cells, TEST_SEED);
        // References first: tracing them would disturb the timings.
        for camera in calibrating.iter().chain(&testing) {
            bench.reference(camera, options.size, options.reference_samples);
        }
        bench.hold(&calibrating)?;
        bench.hold(&testing)?;
        let settings = calibration::settings(&bench.rig());
        let settings = bench.supported(&testing[0], &settings)?;
        let measure = |bench: &mut Answers, cameras| {
            bench.trials(cameras, options.size, &settings, options.reference_samples, progress)
        };
        let trials = measure(&mut bench, &calibrating)?;
        let tests = measure(&mut bench, &testing)?;
        let other_sizes = [options.size.map(|side| side / 2)];
        let timings = bench.timings(&calibrating[..calibrating.len().min(4)], &other_sizes, &settings)?;
        let model = bench.fit(&trials, &timings);
        if options.keep {
            let path = models::keep(&model)?;
            progress.suspend(|| eprintln!("model: {}", path.display()));
        }
        rows.extend(options.bounds.iter().map(|factor| row(spec, &model, &tests, *factor)));
    }
    Ok(Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows))
}

/// The outcome of one view with an error bound.
struct Outcome<'a> {
    /// The delivered frame.
    delivered: &'a Answer,
    /// Milliseconds of all tries together.
    ms: f64,
    tries: usize,
    /// The predicted error.
    predicted: f64,
    /// The oracle's choice: the cheapest answer within the bound.
    cheapest: &'a Answer,
}

/// Replays the coordinator's choice over a view's answers.
fn play<'a>(model: &Model, trial: &'a Trial, request: &PlanRequest) -> Option<Outcome<'a>> {
    let (target, pace) = (QualityTarget::of(request)?, Pace::new(1.0));
    let bound = target.max_error?;
    let candidates = model.candidates(request, &trial.situation, trial.pixels, &pace);
    let answer = |setting: Setting| trial.answers.iter().find(|answer| answer.setting == setting);
    let (mut ms, mut tried) = (0.0, Vec::new());
    let mut step = choose::first(&candidates, &target, |_| 0.0)?;
    let (delivered, predicted) = loop {
        match step {
            Step::Deliver { expected } => break (answer(*tried.last()?)?, expected.error),
            Step::Try { setting, expected, judged } => {
                let seen = answer(setting)?;
                ms += seen.ms;
                tried.push(setting);
                if !judged {
                    break (seen, expected.error);
                }
                let light = model.enlightened(&candidates, &trial.situation, setting, &seen.observed);
                step = choose::next(&light, &target, &tried, ms, |_| 0.0);
            }
        }
    };
    let keeps = |answer: &&Answer| answer.error <= bound;
    let by_ms = |a: &&Answer, b: &&Answer| a.ms.total_cmp(&b.ms);
    let by_error = |a: &&Answer, b: &&Answer| a.error.total_cmp(&b.error);
    let all = || trial.answers.iter();
    let cheapest = all().filter(keeps).min_by(by_ms).or_else(|| all().min_by(by_error))?;
    Some(Outcome { delivered, ms, tries: tried.len(), predicted, cheapest })
}

/// The row of one error bound.
fn row(scene: &str, model: &Model, tests: &[Trial], factor: f64) -> Map<String, Value> {
    let default =
        Setting::Warp { search: Search::Splat, steps: 0, supersampling: 1, samples: 4, holes: Holes::Mark };
    let bound = factor * model.of(default).map_or(f64::NAN, |calibrated| calibrated.median_error);
    let request = PlanRequest { max_error: Some(bound), ..PlanRequest::default() };
    let outcomes: Vec<Outcome<'_>> = tests.iter().filter_map(|trial| play(model, trial, &request)).collect();
    let of = |value: fn(&Outcome<'_>) -> f64| outcomes.iter().map(value).collect::<Vec<f64>>();
    let (ours, best) = (of(|o| o.ms), of(|o| o.cheapest.ms));
    let row = json!({
        "scene": scene,
        "bound_factor": factor,
        "bound": bound,
        "calibration": model.views,
        "views": outcomes.len(),
        "within_share": share(&outcomes, |o| o.delivered.error <= bound),
        "unreachable_share": share(&outcomes, |o| o.cheapest.error > bound),
        "median_ms": median(&ours),
        "cheapest_ms": median(&best),
        "ratio": median(&ours) / median(&best),
        "ratio_of_view": median(&of(|o| o.ms / o.cheapest.ms)),
        "mean_ms": mean(ours),
        "cheapest_mean_ms": mean(best),
        "direct_share": share(&outcomes, |o| o.delivered.setting.is_direct()),
        "traced_share": share(&outcomes, |o| o.delivered.setting.traces()),
        "cheapest_direct_share": share(&outcomes, |o| o.cheapest.setting.is_direct()),
        "tries": mean(of(|o| o.tries as f64)),
        "predicted": median(&of(|o| o.predicted)),
        "true": median(&of(|o| o.delivered.error)),
        "chosen": tally(outcomes.iter().map(|o| o.delivered.setting)),
        "cheapest": tally(outcomes.iter().map(|o| o.cheapest.setting)),
    });
    report::row(row)
}
