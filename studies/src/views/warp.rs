//! Warp: accuracy against time of every search and its settings, over a walk that reveals hidden surfaces.
//!
//! Colour is judged against a supersampled reference image by FLIP, PSNR and SSIM. Range is judged pixel by pixel: a
//! pixel shows the *wrong surface* if its range differs from the reference by more than [`WRONG_SURFACE`], or if only
//! one of them is sky. Two bounds stand beside: the error of direct views, which no warp can be expected to beat, and
//! the time of a pass with one colour fetch per pixel.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus::args;
use argus_compositor::BareFetch;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Mark, Plot, Series, pareto_front};
use argus_sampler::SamplerSettings;
use argus_scene::{
    Camera, Cancel, Frame, Output, Outputs, Plan, RenderError, Rig, RigSettings, Search, ViewJob, Warp,
};
use indicatif::ProgressBar;
use serde_json::json;

use crate::arguments::{count, is_quick, or_quick, positive, size};
use crate::bench::{Bench, FrameErrors, Truth, WRONG_SURFACE};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures accuracy against time: every search × its steps × samples × supersampling, over a walk that reveals hidden
/// surfaces
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Number of views in the walk
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("12", "3"))]
    pub views: usize,
    #[command(flatten)]
    rig: args::Rig,
    /// Sub-pixels a side
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1,2")]
    pub supersampling: Vec<u32>,
    /// Searches to measure; leaves out the rows with other sample resolutions [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = args::search())]
    pub searches: Vec<Search>,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Milliseconds of a setting in a round; slow settings are timed over fewer views
    #[arg(long, value_name = "MS", value_parser = positive, default_value = or_quick("600", "200"))]
    pub round_ms: f64,
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "16")]
    pub reference_samples: u32,
}

impl Options {
    /// Numbers of samples that views are warped from.
    fn samples(&self) -> Vec<usize> {
        match self.rig.samples {
            Some(samples) => vec![samples as usize],
            None if is_quick() => vec![2],
            None => vec![1, 2, 4, 8],
        }
    }

    fn most_samples(&self) -> usize {
        self.samples().into_iter().max().unwrap_or(1)
    }

    fn searches(&self) -> Vec<Search> {
        if self.searches.is_empty() { Search::ALL.to_vec() } else { self.searches.clone() }
    }

    /// Further sample resolutions for the default search, as factors of the rig's.
    fn resolutions(&self) -> &'static [f64] {
        if self.searches.is_empty() && !is_quick() { &[0.5, 1.5, 2.0, 4.0] } else { &[] }
    }
}

/// Steps to measure for a search that takes them.
fn steps(search: Search) -> &'static [u32] {
    match search {
        Search::Splat | Search::Pyramid => &[],
        _ if is_quick() => &[8],
        Search::Linear => &[16, 64, 200],
        Search::Seeded => &[2, 4],
    }
}

/// One setting for rendering views: a row.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Setting {
    Direct { samples_per_pixel: u32 },
    Warp { search: Search, steps: Option<u32>, samples: usize, side: u32 },
}

impl Setting {
    fn plan(self, bench: &Bench, camera: &Camera) -> Plan {
        match self {
            Self::Direct { samples_per_pixel } => Plan::direct(samples_per_pixel),
            Self::Warp { search, steps, samples, side } => Plan::Warp(Warp {
                search,
                steps: steps.unwrap_or(Warp::default().steps),
                supersampling: side,
                samples: bench.sample_ids(camera, samples),
                ..Warp::default()
            }),
        }
    }

    /// Sub-pixels a side of the frame's range.
    fn side(self) -> u32 {
        match self {
            Self::Direct { .. } => 1,
            Self::Warp { side, .. } => side,
        }
    }

    fn search(self) -> &'static str {
        match self {
            Self::Direct { .. } => "direct",
            Self::Warp { search, .. } => search.name(),
        }
    }

    /// A short name for plots.
    fn label(self) -> String {
        match self {
            Self::Direct { samples_per_pixel } => format!("direct ×{samples_per_pixel}"),
            Self::Warp { search, steps, samples, side } => {
                let steps = steps.map_or(String::new(), |n| format!(" {n}"));
                let fine = if side > 1 { format!(", {side}×{side}") } else { String::new() };
                format!("{}{steps}, {samples} samples{fine}", search.name())
            }
        }
    }
}

/// A setting's times and errors.
struct Measured {
    setting: Setting,
    rig: Rig,
    /// Whether sample cameras were selected by visibility rather than by distance.
    by_sight: bool,
    ms: Vec<f64>,
    /// Milliseconds per view of each stage, in each round.
    stages: BTreeMap<String, Vec<f64>>,
    judged: Vec<FrameErrors>,
    /// Views over which it is timed.
    timed: usize,
}

impl Measured {
    fn view_ms(&self) -> f64 {
        median(&self.ms)
    }

    /// Adds a round with its milliseconds per view.
    fn add_round(&mut self, view_ms: f64, frames: &[Frame]) {
        self.ms.push(view_ms);
        let mut round: BTreeMap<&str, f64> = BTreeMap::new();
        for stage in frames.iter().flat_map(|frame| &frame.stages) {
            *round.entry(&stage.name).or_default() += stage.ms / frames.len() as f64;
        }
        // The rest is submission, and waiting for the device.
        round.insert("rest", view_ms - round.values().sum::<f64>());
        for (name, ms) in round {
            self.stages.entry(name.to_owned()).or_default().push(ms);
        }
    }

    /// Milliseconds of a view's stages, the longest first.
    fn made_of(&self) -> String {
        let mut stages: Vec<(f64, &str)> =
            self.stages.iter().map(|(name, ms)| (median(ms), name.as_str())).collect();
        stages.sort_by(|a, b| b.0.total_cmp(&a.0));
        let shown = stages.iter().filter(|(ms, _)| *ms >= 0.005);
        shown.map(|(ms, name)| format!("{name} {ms:.2}")).collect::<Vec<_>>().join(", ")
    }

    /// How sample cameras were selected.
    fn cameras(&self) -> &'static str {
        if self.by_sight { "seen" } else { "nearest" }
    }

    /// The setting's name, with the size of its samples if it has any.
    fn label(&self) -> String {
        match self.setting {
            Setting::Direct { .. } => self.setting.label(),
            Setting::Warp { .. } => {
                format!("{} {} of {}", self.setting.label(), self.cameras(), texels(&self.rig))
            }
        }
    }

    fn flip(&self) -> f64 {
        mean(self.judged.iter().map(|j| j.image.flip_mean))
    }
}

/// Runs the study; `progress` counts settings × rounds.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_message(options.scene.clone());
    let mut bench = Bench::new(&gpu, &options.scene, &options.rig.settings(), SamplerSettings::default())?;
    let mut study = Study::new(&bench, options);
    let directs = [1, 4, 16].map(|samples_per_pixel| Setting::Direct { samples_per_pixel });
    let settings: Vec<Setting> = directs.into_iter().chain(study.grid(&bench)).collect();
    let rigs = options.resolutions().iter().map(|&factor| finer(&bench.info.rig, factor)).collect::<Vec<_>>();
    let few = |samples| {
        let setting =
            move |&side: &u32| Setting::Warp { search: Search::default(), steps: None, samples, side };
        options.supersampling.iter().map(setting)
    };
    let few: Vec<Setting> = few(2).chain(few(4)).collect();
    let most = options.most_samples();
    let nearest =
        |setting: &&Setting| matches!(setting, Setting::Warp { samples, side: 1, .. } if *samples == most);
    let nearest: Vec<Setting> =
        settings.iter().filter(nearest).copied().filter(|_| bench.chooses_by_sight()).collect();
    let count = settings.len() + few.len() * rigs.len() + nearest.len();
    progress.set_length((count * (options.rounds + 1)) as u64);
    let fetch_ms = study.measure(&mut bench, &settings, progress)?;
    for rig in rigs {
        bench.replace_rig(&rig, &study.held)?;
        match study.measure(&mut bench, &few, progress) {
            Ok(_) => {}
            Err(error) => study.leave_out_samples(&bench, error)?,
        }
    }
    if !nearest.is_empty() {
        bench.ignore_sight();
        bench.replace_rig(&options.rig.settings(), &study.held)?;
        study.measure(&mut bench, &nearest, progress)?;
    }
    Ok(study.report(&bench, &gpu, fetch_ms))
}

/// Settings for the same cameras with `factor` times as many texels a side.
fn finer(rig: &Rig, factor: f64) -> RigSettings {
    let scaled = |n: u32| ((f64::from(n) * factor).round() as u32).max(8);
    match *rig {
        Rig::TileCorners { tiles, size, .. } => {
            RigSettings { tiles: Some(tiles), size: Some(size.map(scaled)), ..RigSettings::default() }
        }
        Rig::Cell { spacing, face, .. } => {
            RigSettings { spacing: Some(spacing), face: Some(scaled(face)), ..RigSettings::default() }
        }
    }
}

/// Median milliseconds to select the samples of a view.
fn choosing_ms(bench: &Bench, cameras: &[Camera], count: usize) -> f64 {
    let chosen = cameras.iter().map(|camera| {
        let begin = Instant::now();
        bench.sample_ids(camera, count);
        begin.elapsed().as_secs_f64() * 1e3
    });
    median(&chosen.collect::<Vec<f64>>())
}

struct Study<'a> {
    options: &'a Options,
    cameras: Vec<Camera>,
    truths: Vec<Truth>,
    measured: Vec<Measured>,
    held: Vec<argus_scene::SampleId>,
    /// Samples that the compositor refused, with its reason.
    refused: BTreeMap<String, String>,
    /// Median milliseconds to select the samples of a view.
    choosing_ms: f64,
}

impl<'a> Study<'a> {
    fn new(bench: &Bench, options: &'a Options) -> Self {
        let cameras = bench.walk(options.views);
        let mut sides = options.supersampling.clone();
        sides.push(1);
        let truth = |camera| bench.truth(camera, options.size, options.reference_samples, &sides);
        let truths = cameras.iter().map(truth).collect();
        Self {
            options,
            choosing_ms: choosing_ms(bench, &cameras, options.most_samples()),
            cameras,
            truths,
            measured: Vec::new(),
            held: Vec::new(),
            refused: BTreeMap::new(),
        }
    }

    /// Every search × its steps × samples × supersampling, without duplicates where the rig has fewer samples.
    fn grid(&self, bench: &Bench) -> Vec<Setting> {
        let most = self.cameras.iter().map(|camera| bench.sample_ids(camera, usize::MAX).len()).max();
        let mut counts: Vec<usize> =
            self.options.samples().iter().map(|&n| n.min(most.unwrap_or(n))).collect();
        counts.dedup();
        let mut settings = Vec::new();
        for search in self.options.searches() {
            let steps = steps(search);
            let steps: Vec<Option<u32>> =
                if steps.is_empty() { vec![None] } else { steps.iter().copied().map(Some).collect() };
            for steps in steps {
                for &samples in &counts {
                    for &side in &self.options.supersampling {
                        settings.push(Setting::Warp { search, steps, samples, side });
                    }
                }
            }
        }
        settings
    }

    fn jobs(&self, bench: &Bench, setting: Setting, outputs: Outputs) -> Vec<ViewJob> {
        let job =
            |camera: &Camera| bench.job(*camera, self.options.size, outputs, setting.plan(bench, camera));
        self.cameras.iter().map(job).collect()
    }

    /// Judges each setting in a first round, then times all in turns. Returns the median milliseconds of a view with
    /// one fetch per pixel.
    fn measure(&mut self, bench: &mut Bench, settings: &[Setting], progress: &ProgressBar) -> Result<f64> {
        let most = self.options.most_samples();
        self.held = bench.all_ids(&self.cameras, most);
        bench.hold(&self.held)?;
        let first = self.measured.len();
        for &setting in settings {
            progress.inc(1);
            progress.set_message(setting.label());
            self.measured.push(self.judge(bench, setting).with_context(|| setting.label())?);
        }
        let mut bare_fetch = BareFetch::default();
        self.one_fetch(bench, &mut bare_fetch)?;
        let mut fetch_ms = Vec::new();
        for _ in 0..self.options.rounds {
            fetch_ms.push(self.one_fetch(bench, &mut bare_fetch)?);
            for at in first..self.measured.len() {
                let Measured { setting, timed, .. } = self.measured[at];
                progress.inc(1);
                progress.set_message(setting.label());
                let jobs = every(self.jobs(bench, setting, Outputs::COLOR), timed);
                let (ms, frames) = bench.time(&jobs)?;
                self.measured[at].add_round(ms / jobs.len() as f64, &frames);
            }
        }
        Ok(median(&fetch_ms))
    }

    /// Runs one round for quality, which also compiles the pipelines.
    fn judge(&self, bench: &mut Bench, setting: Setting) -> Result<Measured> {
        let jobs = self.jobs(bench, setting, Outputs::COLOR.with(Output::Range));
        let (_, frames) = bench.time(&jobs)?;
        let judged =
            frames.iter().zip(&self.truths).map(|(frame, truth)| Bench::judge(frame, truth, setting.side()));
        let judged = judged.collect::<Result<_>>()?;
        let jobs = self.jobs(bench, setting, Outputs::COLOR);
        bench.time(&jobs[..1])?;
        let (ms, _) = bench.time(&jobs[..1])?;
        let timed = ((self.options.round_ms / ms) as usize).clamp(2, jobs.len().max(2));
        // Batches of other sizes use other programs.
        bench.time(&every(jobs, timed))?;
        Ok(Measured {
            setting,
            rig: bench.info.rig,
            by_sight: bench.chooses_by_sight(),
            ms: Vec::new(),
            stages: BTreeMap::new(),
            judged,
            timed,
        })
    }

    /// Leaves out samples that exceed the compositor's memory, with the reason. Returns any other error.
    fn leave_out_samples(&mut self, bench: &Bench, error: anyhow::Error) -> Result<()> {
        let samples = format!("samples of {}", texels(&bench.info.rig));
        match error.downcast_ref::<RenderError>() {
            Some(RenderError::OutOfMemory(reason)) => {
                self.refused.insert(samples, reason.clone());
                Ok(())
            }
            _ => Err(error.context(samples)),
        }
    }

    /// Milliseconds per view of a pass with one colour fetch per pixel.
    fn one_fetch(&self, bench: &mut Bench, bare_fetch: &mut BareFetch) -> Result<f64> {
        let setting = Setting::Warp { search: Search::default(), steps: None, samples: 1, side: 1 };
        let jobs = self.jobs(bench, setting, Outputs::COLOR);
        let begin = Instant::now();
        let frames = bare_fetch.compose(&mut bench.compositor, &jobs, &Cancel::new());
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        frames.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(ms / jobs.len().max(1) as f64)
    }

    fn report(&self, bench: &Bench, gpu: &Arc<Gpu>, fetch_ms: f64) -> Report {
        let direct = self.measured.iter().find(|m| m.setting == Setting::Direct { samples_per_pixel: 1 });
        let direct_ms = direct.map_or(f64::NAN, Measured::view_ms);
        let rows = self.measured.iter().map(|m| {
            let (steps, samples, side) = match m.setting {
                Setting::Direct { samples_per_pixel } => (None, None, samples_per_pixel.isqrt()),
                Setting::Warp { steps, samples, side, .. } => (steps, Some(samples), side),
            };
            report::row(json!({
                "search": m.setting.search(),
                "steps": steps,
                "samples": samples,
                "supersampling": side,
                "texels": samples.map(|_| texels(&m.rig)),
                "cameras": samples.map(|_| m.cameras()),
                "view_ms": m.view_ms(),
                "per_direct": m.view_ms() / direct_ms,
                "per_fetch": m.view_ms() / fetch_ms,
                "flip": m.flip(),
                "psnr_db": mean(m.judged.iter().map(|j| j.image.psnr_db)),
                "ssim": mean(m.judged.iter().map(|j| j.image.ssim)),
                "unresolved_fraction": mean(m.judged.iter().map(|j| j.unresolved)),
                "wrong_surface_fraction": mean(m.judged.iter().map(|j| j.wrong_surface)),
            }))
        });
        let mut report = Report::new(&bench.scene.name, Machine::here(gpu.kind()), rows.collect());
        report.notes = self.notes(fetch_ms);
        report.note_longest_pass(gpu);
        report.plots = vec![self.plot(bench, fetch_ms)];
        report
    }

    fn notes(&self, fetch_ms: f64) -> Vec<String> {
        let Options { size: [width, height], views, reference_samples, .. } = self.options;
        let mut notes = vec![format!(
            "{views} views of {width}×{height} pixels, in one batch; reference of {reference_samples} samples a \
             pixel; wrong surface: range off by more than {}%.",
            WRONG_SURFACE * 100.0
        )];
        notes.push(format!("One fetch a pixel: {fetch_ms:.3} ms a view."));
        let most = self.options.most_samples();
        let whole =
            |m: &&Measured| matches!(m.setting, Setting::Warp { samples, side: 1, .. } if samples == most);
        for m in self.measured.iter().filter(whole).filter(|m| m.by_sight == self.measured[0].by_sight) {
            notes.push(format!("A view by {}, milliseconds: {}.", m.setting.label(), m.made_of()));
        }
        notes.push(format!(
            "A coordinator selects a view's samples in {:.3} ms on one core.",
            self.choosing_ms
        ));
        notes.extend(self.refused.iter().map(|(samples, reason)| format!("Left out: {samples} ({reason}).")));
        notes
    }

    fn plot(&self, bench: &Bench, fetch_ms: f64) -> Plot {
        let point = |m: &Measured| (m.view_ms(), m.flip());
        let names = ["direct"].into_iter().chain(Search::ALL.map(Search::name));
        let series = names.map(|name| Series {
            name: name.to_owned(),
            points: self.measured.iter().filter(|m| m.setting.search() == name).map(point).collect(),
            line: false,
        });
        let points: Vec<(f64, f64)> = self.measured.iter().map(point).collect();
        let mark = |i: usize| Mark { at: points[i], label: self.measured[i].label() };
        let [width, height] = self.options.size;
        Plot {
            name: "pareto".to_owned(),
            title: format!("{}, {width}×{height}: error against time", bench.scene.name),
            x: Axis::log("milliseconds a view"),
            y: Axis::linear("mean FLIP against the reference"),
            series: series.filter(|series| !series.points.is_empty()).collect(),
            front: pareto_front(&points).into_iter().map(mark).collect(),
            guides: vec![(fetch_ms, "one fetch a pixel".to_owned())],
            ..Plot::default()
        }
    }
}

/// `count` jobs, evenly spaced.
fn every(jobs: Vec<ViewJob>, count: usize) -> Vec<ViewJob> {
    let (all, count) = (jobs.len(), count.min(jobs.len()));
    let taken = |i: &usize| (i * count) / all != ((i + 1) * count) / all;
    jobs.into_iter().enumerate().filter(|(i, _)| taken(i)).map(|(_, job)| job).collect()
}

/// The size of a rig's sample in texels: `400x300`, or `6x512x512`.
fn texels(rig: &Rig) -> String {
    match rig {
        Rig::TileCorners { size: [width, height], .. } => format!("{width}x{height}"),
        Rig::Cell { face, .. } => format!("6x{face}x{face}"),
    }
}

#[cfg(test)]
mod tests;
