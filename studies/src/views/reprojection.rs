//! Reprojection: whether a search should start from a coarse splat of the samples or from the session's previous frame.
//!
//! The views stay fixed and the previous frame's camera varies, so that all rows share the same reference images and the
//! same cost of starting from samples. The time of a row with reprojection includes what the service does besides: range
//! and source are read back with the colour, and kept for the next frame.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use argus::args;
use argus_compositor::{CompositorSettings, GpuCompositor};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::SamplerSettings;
use argus_scene::{Camera, Frame, History, Output, Outputs, Plan, SampleId, Search, ViewJob, Warp};
use glam::DQuat;
use indicatif::ProgressBar;
use serde_json::json;

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, FrameErrors, Truth, WRONG_SURFACE};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures temporal reprojection: whether a session's search should start from its previous frame or from samples,
/// by time and error against the camera's motion, and over a chain of frames
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
    /// Camera turns between two frames in degrees
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("0,0.5,1,2,5,10,20", "0,2,90"))]
    pub turns_deg: Vec<f64>,
    /// Camera moves between two frames, forward and sideways, as shares of the median visible range
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("0.001,0.005,0.01,0.02,0.05", "0.01"))]
    pub steps: Vec<f64>,
    /// Lengths of chains: frames that each start from the one before
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("3,5,8,12,30", "4"))]
    pub chains: Vec<usize>,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("9", "1"))]
    pub rounds: usize,
    /// Samples a pixel of the reference: a square number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "16")]
    pub reference_samples: u32,
}

/// A camera motion since the previous frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Motion {
    turn_deg: f64,
    /// Moves, as shares of the median visible range.
    forward: f64,
    aside: f64,
}

/// The motion per frame of a chain: one degree, and half a per cent of the visible range sideways.
const CHAINED: Motion = Motion { turn_deg: 1.0, forward: 0.0, aside: 0.005 };

impl Motion {
    fn label(self) -> String {
        let parts = [
            (self.turn_deg, format!("turn {}°", self.turn_deg)),
            (self.forward, format!("forward {}%", self.forward * 100.0)),
            (self.aside, format!("aside {}%", self.aside * 100.0)),
        ];
        let said: Vec<String> =
            parts.into_iter().filter(|(much, _)| *much != 0.0).map(|(_, said)| said).collect();
        if said.is_empty() { "none".to_owned() } else { said.join(", ") }
    }

    fn times(self, count: f64) -> Self {
        Self { turn_deg: self.turn_deg * count, forward: self.forward * count, aside: self.aside * count }
    }

    /// The previous camera of `camera`; the move never passes through a surface.
    fn before(self, bench: &Bench, camera: &Camera, range: f64) -> Camera {
        let axis = camera.target - camera.eye;
        let forward = axis.normalize_or_zero();
        let right = forward.cross(camera.up).normalize_or_zero();
        let eye = bench.advance(camera.eye, -(forward * self.forward + right * self.aside) * range);
        let turned = DQuat::from_axis_angle(camera.up.normalize_or_zero(), self.turn_deg.to_radians()) * axis;
        Camera { eye, target: eye + turned, ..*camera }
    }
}

/// One way of starting the search: a row.
struct Variant {
    search: Search,
    /// The motion's name and the previous frames; `None` if the search starts from samples.
    motion: Option<(String, Vec<Arc<History>>)>,
    /// The views' errors; `ms` has one time per round.
    judged: Vec<FrameErrors>,
    used: f64,
    ms: Vec<f64>,
}

impl Variant {
    fn view_ms(&self) -> f64 {
        median(&self.ms)
    }

    fn flip(&self) -> f64 {
        mean(self.judged.iter().map(|j| j.image.flip_mean))
    }
}

/// Runs the study; `progress` counts variants × rounds.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_message(options.scene.clone());
    let mut bench = Bench::new(&gpu, &options.scene, &options.rig.settings(), SamplerSettings::default())?;
    // Chains of any length: the study shows where the setting should limit them.
    let settings = CompositorSettings { max_reprojections: u32::MAX, ..CompositorSettings::default() };
    bench.compositor = GpuCompositor::with_settings(Arc::clone(&gpu), settings)?;
    let cameras = bench.walk(options.views);
    let (truths, ranges, held) = (Vec::new(), Vec::new(), BTreeSet::new());
    let mut study = Study { options, cameras, truths, ranges, held };
    study.hold(&mut bench, &study.cameras.clone())?;
    study.truths =
        study.cameras.iter().map(|c| bench.truth(c, options.size, options.reference_samples, &[1])).collect();
    study.ranges = study.frames(&mut bench, Search::Seeded, None)?.iter().map(median_range).collect();

    let steps = options.steps.iter();
    let forward = steps.clone().map(|&forward| Motion { forward, ..Motion::default() });
    let aside = steps.map(|&aside| Motion { aside, ..Motion::default() });
    let turns = options.turns_deg.iter().map(|&turn_deg| Motion { turn_deg, ..Motion::default() });
    let motions: Vec<Motion> = turns.chain(forward).chain(aside).collect();
    progress.set_length(((motions.len() + options.chains.len() + 2) * (options.rounds + 1)) as u64);
    let mut variants = vec![
        study.variant(&mut bench, Search::Splat, None, progress)?,
        study.variant(&mut bench, Search::Seeded, None, progress)?,
    ];
    for motion in motions {
        let histories = study.histories(&mut bench, &[motion])?;
        variants.push(study.variant(
            &mut bench,
            Search::Seeded,
            Some((motion.label(), histories.0)),
            progress,
        )?);
    }
    for &frames in &options.chains {
        let came: Vec<Motion> = (1..=frames).rev().map(|left| CHAINED.times(left as f64)).collect();
        let (histories, begun) = study.histories(&mut bench, &came)?;
        let label = format!("{frames} frames, each {}", CHAINED.label());
        let mut chain = study.variant(&mut bench, Search::Seeded, Some((label, histories)), progress)?;
        // Weights the chain's frames with the view's. The first frame of the chain has no previous one.
        chain.used = (begun * (frames - 1) as f64 + chain.used) / frames as f64;
        variants.push(chain);
    }
    for _ in 0..options.rounds {
        for variant in &mut variants {
            progress.inc(1);
            let (ms, _) = study.time(&mut bench, variant)?;
            variant.ms.push(ms);
        }
    }
    Ok(study.report(&bench, &gpu, &variants))
}

struct Study<'a> {
    options: &'a Options,
    cameras: Vec<Camera>,
    truths: Vec<Truth>,
    /// Median range of each view, metres.
    ranges: Vec<f64>,
    /// Samples that the compositor holds.
    held: BTreeSet<SampleId>,
}

/// Adds the outputs from which a next frame can start.
fn with_depth(outputs: Outputs) -> Outputs {
    outputs.with(Output::Range).with(Output::Source)
}

impl Study<'_> {
    /// Renders the samples for the cameras that are not held yet.
    fn hold(&mut self, bench: &mut Bench, cameras: &[Camera]) -> Result<()> {
        let ids = bench.all_ids(cameras, self.options.rig.samples(4));
        let missing: Vec<SampleId> = ids.into_iter().filter(|id| self.held.insert(*id)).collect();
        if !missing.is_empty() {
            bench.hold(&missing)?;
        }
        Ok(())
    }

    fn job(&self, bench: &Bench, camera: &Camera, search: Search, history: Option<Arc<History>>) -> ViewJob {
        let samples = bench.sample_ids(camera, self.options.rig.samples(4));
        let plan = Plan::Warp(Warp { search, samples, steps: search.usual_steps(), ..Warp::default() });
        ViewJob { history, ..bench.job(*camera, self.options.size, with_depth(Outputs::COLOR), plan) }
    }

    fn jobs(&self, bench: &Bench, search: Search, histories: Option<&[Arc<History>]>) -> Vec<ViewJob> {
        let history = |i: usize| histories.and_then(|histories| histories.get(i).cloned());
        self.cameras
            .iter()
            .enumerate()
            .map(|(i, camera)| self.job(bench, camera, search, history(i)))
            .collect()
    }

    fn frames(
        &self,
        bench: &mut Bench,
        search: Search,
        histories: Option<&[Arc<History>]>,
    ) -> Result<Vec<Frame>> {
        let jobs = self.jobs(bench, search, histories);
        Ok(bench.time(&jobs)?.1)
    }

    /// The histories of frames along a chain of motions to the views. Each frame starts from the one before, the
    /// first from the samples. Also returns the share of later frames that did use the one before.
    fn histories(&mut self, bench: &mut Bench, came: &[Motion]) -> Result<(Vec<Arc<History>>, f64)> {
        let (mut last, mut begun): (Vec<Option<Arc<History>>>, Vec<f64>) =
            (vec![None; self.cameras.len()], Vec::new());
        for (step, motion) in came.iter().enumerate() {
            let views = self.cameras.iter().zip(&self.ranges);
            let cameras: Vec<Camera> =
                views.map(|(camera, range)| motion.before(bench, camera, *range)).collect();
            self.hold(bench, &cameras)?;
            let jobs: Vec<ViewJob> = cameras
                .iter()
                .zip(&last)
                .map(|(camera, history)| self.job(bench, camera, Search::Seeded, history.clone()))
                .collect();
            let (_, frames) = bench.time(&jobs)?;
            if step > 0 {
                begun.extend(frames.iter().map(|frame| f64::from(u8::from(frame.provenance.history))));
            }
            let left = frames.iter().zip(&cameras).zip(&last);
            let left = left.map(|((frame, camera), before)| History::of(frame, camera, before.as_deref()));
            last = left.map(|history| history.map(Arc::new)).collect();
        }
        let used = if begun.is_empty() { 1.0 } else { mean(begun) };
        Ok((last.into_iter().flatten().collect(), used))
    }

    /// Runs one round for quality and one to warm up, which compiles the pipelines.
    fn variant(
        &self,
        bench: &mut Bench,
        search: Search,
        motion: Option<(String, Vec<Arc<History>>)>,
        progress: &ProgressBar,
    ) -> Result<Variant> {
        progress.inc(1);
        let frames = self.frames(bench, search, motion.as_ref().map(|(_, histories)| &histories[..]))?;
        let judged = frames.iter().zip(&self.truths).map(|(frame, truth)| Bench::judge(frame, truth, 1));
        let judged = judged.collect::<Result<_>>()?;
        let used = mean(frames.iter().map(|frame| f64::from(u8::from(frame.provenance.history))));
        let variant = Variant { search, motion, judged, used, ms: Vec::new() };
        self.time(bench, &variant)?;
        Ok(variant)
    }

    /// Milliseconds per view, and the frames. With reprojection the time includes keeping the frame for the next one.
    fn time(&self, bench: &mut Bench, variant: &Variant) -> Result<(f64, Vec<Frame>)> {
        let histories = variant.motion.as_ref().map(|(_, histories)| &histories[..]);
        let mut jobs = self.jobs(bench, variant.search, histories);
        if histories.is_none() {
            jobs.iter_mut().for_each(|job| job.outputs = Outputs::COLOR);
        }
        let (mut ms, frames) = bench.time(&jobs)?;
        if histories.is_some() {
            let keeping = Instant::now();
            let kept = frames
                .iter()
                .zip(&self.cameras)
                .filter_map(|(frame, camera)| History::of(frame, camera, None));
            assert_eq!(kept.count(), frames.len(), "frames with range and source leave a history");
            ms += keeping.elapsed().as_secs_f64() * 1e3;
        }
        Ok((ms / jobs.len().max(1) as f64, frames))
    }

    fn report(&self, bench: &Bench, gpu: &Arc<Gpu>, variants: &[Variant]) -> Report {
        let seeded =
            variants.iter().find(|variant| variant.search == Search::Seeded && variant.motion.is_none());
        let seeded_ms = seeded.map_or(f64::NAN, Variant::view_ms);
        let rows = variants.iter().map(|variant| {
            let motion = variant.motion.as_ref().map(|(label, _)| label);
            report::row(json!({
                "search": variant.search.name(),
                "seed": if motion.is_some() { "history" } else { "samples" },
                "motion": motion,
                "view_ms": variant.view_ms(),
                "per_seeded": variant.view_ms() / seeded_ms,
                "flip": variant.flip(),
                "psnr_db": mean(variant.judged.iter().map(|j| j.image.psnr_db)),
                "ssim": mean(variant.judged.iter().map(|j| j.image.ssim)),
                "unresolved_fraction": mean(variant.judged.iter().map(|j| j.unresolved)),
                "wrong_surface_fraction": mean(variant.judged.iter().map(|j| j.wrong_surface)),
                "used_fraction": variant.used,
            }))
        });
        let mut report = Report::new(&bench.scene.name, Machine::here(gpu.kind()), rows.collect());
        let Options { size: [width, height], views, reference_samples, .. } = self.options;
        let samples = self.options.rig.samples(4);
        report.notes = vec![
            format!(
                "{views} views of {width}×{height} pixels, in one batch, {samples} samples a view; steps are shares \
                 of the median range of the visible surfaces; reference of {reference_samples} samples a pixel; wrong \
                 surface: range off by more than {}%. With history, a view's time includes range, source and \
                 their storage.",
                WRONG_SURFACE * 100.0
            ),
            verdict(variants),
        ];
        report
    }
}

/// For which motions reprojection is faster or better.
fn verdict(variants: &[Variant]) -> String {
    let from_samples = |search| variants.iter().find(|v| v.search == search && v.motion.is_none());
    let (Some(splat), Some(seeded)) = (from_samples(Search::Splat), from_samples(Search::Seeded)) else {
        return String::new();
    };
    let begun: Vec<(&str, &Variant)> = variants
        .iter()
        .filter(|variant| variant.used > 0.5)
        .filter_map(|variant| Some((variant.motion.as_ref()?.0.as_str(), variant)))
        .collect();
    let better = |figure: fn(&Variant) -> f64, than: &Variant| -> String {
        let (less, more): (Vec<_>, Vec<_>) =
            begun.iter().partition(|(_, variant)| figure(variant) < figure(than));
        let listed =
            |of: &[(&str, &Variant)]| of.iter().map(|(motion, _)| *motion).collect::<Vec<_>>().join("; ");
        match (less.len(), more.len()) {
            (0, _) => "after none of the motions".to_owned(),
            (_, 0) => "after all motions that it was used after".to_owned(),
            (few, many) if few <= many => format!("after {}", listed(&less)),
            _ => format!("after all but {}", listed(&more)),
        }
    };
    format!(
        "Beginning from history, the seeded search is faster than from samples ({:.2} ms) {}; shows a smaller FLIP \
         ({:.4}) {}; and is faster than the splat ({:.2} ms) {}.",
        seeded.view_ms(),
        better(Variant::view_ms, seeded),
        seeded.flip(),
        better(Variant::flip, seeded),
        splat.view_ms(),
        better(Variant::view_ms, splat),
    )
}

/// Median range in metres of the surfaces in a frame; 1 if it shows none.
fn median_range(frame: &Frame) -> f64 {
    let (ranges, _) = frame.images[Output::Range].as_deref().unwrap_or_default().as_chunks::<4>();
    let all = ranges.iter().map(|range| f64::from(f32::from_le_bytes(*range)));
    let seen: Vec<f64> = all.filter(|range| range.is_finite()).collect();
    if seen.is_empty() { 1.0 } else { median(&seen) }
}
