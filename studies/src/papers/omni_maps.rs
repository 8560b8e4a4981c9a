//! Omni maps: omnidirectional samples from triangles against samples from maps of an octree (MegaViews). Measures the
//! cost of samples and the error of views warped from them.

use std::time::Instant;

use anyhow::Result;
use argus::args;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::SamplerSettings;
use argus_scene::{
    Camera, Cancel, MegaViews, Output, Outputs, Plan, RenderError, RigKind, RigSettings, Sample, SampleId,
    SampleJob, Sampler as _, Sampling, ViewJob, Visibility, Warp,
};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, FrameErrors, Truth};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures omnidirectional samples from triangles beside those from maps of an octree (`argus serve --sampling
/// megaviews`): their cost, and the error of views warped from them
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example:
  LP_NUM_THREADS=1 argus-lab study method omni-maps --scene sponza.glb --map-side 256,512,1024 --levels 8,9,10 --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("400x300", "64x48"))]
    pub size: [u32; 2],
    /// Number of views in the walk
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub views: usize,
    /// Side of a map's hemisphere in texels
    #[arg(long = "map-side", value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=1024), default_value = or_quick("256,512", "64,128"))]
    pub map_sides: Vec<u32>,
    /// Levels of the scene's octree below its root
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10), default_value = or_quick("8,9", "7"))]
    pub levels: Vec<u32>,
    /// Cameras along an edge of the blocks that share maps: 1, 2 or 4
    #[arg(long = "block", value_name = "N", value_delimiter = ',', value_parser = block, default_value = "1")]
    pub blocks: Vec<u32>,
    /// Samples a pixel of the reference: a square number
    #[arg(skip = or_quick(16_u32, 4))]
    pub reference_samples: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    #[command(flatten)]
    rig: args::Rig,
}

impl Options {
    /// Samples that a view is warped from.
    fn samples(&self) -> usize {
        self.rig.samples(4)
    }
}

fn block(text: &str) -> Result<u32, String> {
    let found = [1, 2, 4].into_iter().find(|block: &u32| block.to_string() == text);
    found.ok_or_else(|| "must be 1, 2 or 4".to_owned())
}

/// One source of samples.
struct Source {
    visibility: Visibility,
    sampling: Sampling,
}

/// Runs the study; `progress` counts sources.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let rig = options.rig.settings();
    let face = rig.face.or(Some(or_quick(256, 64)));
    let rig = RigSettings { kind: Some(RigKind::Cell), face, ..rig };
    let mut bench = Bench::new(&gpu, &options.scene, &rig, SamplerSettings::default())?;
    let sources = sources(options);
    progress.set_length(sources.len() as u64);
    progress.set_message(options.scene.clone());
    let walk = bench.walk(options.views);
    let truths: Vec<Truth> =
        walk.iter().map(|view| bench.truth(view, options.size, options.reference_samples, &[1])).collect();
    let mut rows = Vec::new();
    for source in &sources {
        rows.push(row(&mut bench, options, source, &walk, &truths)?);
        progress.inc(1);
    }
    let mut report = Report::new(&bench.scene.name, Machine::here(gpu.kind()), rows);
    report.notes.push(format!(
        "{} views of {}×{} pixels, each warped from {} omnidirectional samples. sample_ms: time per sample. ready_ms: time \
        before the first sample, once per pose and lights, to build the octree and shade its leaves; 0 if the octree of the \
        row before is reused.",
        walk.len(),
        options.size[0],
        options.size[1],
        options.samples()
    ));
    report.plots = vec![plot(&bench.scene.name, &report.rows)];
    Ok(report)
}

/// Triangles by each visibility backend, then maps from coarse to fine.
fn sources(options: &Options) -> Vec<Source> {
    let triangles = Visibility::ALL.map(|visibility| Source { visibility, sampling: Sampling::Triangles });
    let mut sources = Vec::from(triangles);
    for &block in &options.blocks {
        for &levels in &options.levels {
            for &map_side in &options.map_sides {
                let sampling = Sampling::MegaViews(MegaViews { map_side, levels, block });
                sources.push(Source { visibility: Visibility::default(), sampling });
            }
        }
    }
    sources
}

fn row(
    bench: &mut Bench,
    options: &Options,
    source: &Source,
    walk: &[Camera],
    truths: &[Truth],
) -> Result<Map<String, Value>> {
    bench.set_visibility(source.visibility);
    bench.set_sampling(source.sampling)?;
    let ids = bench.all_ids(walk, options.samples());
    let (sample_ms, ready_ms) = time(bench, &ids, options.rounds)?;
    let held = ids.clone();
    bench.hold(&ids)?;
    let jobs: Vec<ViewJob> = walk
        .iter()
        .map(|camera| {
            let samples = bench.sample_ids(camera, options.samples());
            let plan = Plan::Warp(Warp { samples, ..Warp::default() });
            bench.job(*camera, options.size, Outputs::COLOR.with(Output::Range), plan)
        })
        .collect();
    let (_, frames) = bench.time(&jobs)?;
    let judge = |(frame, truth)| Bench::judge(frame, truth, 1);
    let judged = frames.iter().zip(truths).map(judge).collect::<Result<Vec<FrameErrors>>>()?;
    bench.release(&held);
    let maps = match source.sampling {
        Sampling::Triangles => None,
        Sampling::MegaViews(maps) => Some(maps),
    };
    Ok(report::row(json!({
        "way": maps.map_or(source.visibility.name(), |_| source.sampling.name()),
        "map_side": maps.map(|maps| maps.map_side),
        "levels": maps.map(|maps| maps.levels),
        "block": maps.map(|maps| maps.block),
        "samples": held.len(),
        "sample_ms": sample_ms,
        "ready_ms": ready_ms,
        "flip": mean(judged.iter().map(|j| j.image.flip_mean)),
        "psnr_db": mean(judged.iter().map(|j| j.image.psnr_db)),
        "wrong_surface_fraction": mean(judged.iter().map(|j| j.wrong_surface)),
        "unresolved_fraction": mean(judged.iter().map(|j| j.unresolved)),
    })))
}

/// Milliseconds per sample (median of the rounds), and milliseconds of preparation before the first sample.
fn time(bench: &mut Bench, ids: &[SampleId], rounds: usize) -> Result<(f64, f64)> {
    let Some((&first, _)) = ids.split_first() else { return Ok((f64::NAN, f64::NAN)) };
    let mut take = |ids: &[SampleId]| -> Result<(f64, Vec<Sample>), RenderError> {
        let job = SampleJob::new(bench.info.clone(), ids.to_vec(), false);
        let begin = Instant::now();
        let samples = bench.sampler.render_samples(&job, &Cancel::new());
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        Ok((ms, samples.into_iter().collect::<Result<_, _>>()?))
    };
    let (_, begun) = take(&[first])?;
    let ready = begun.iter().flat_map(|sample| &sample.stages);
    let ready = ready.filter(|stage| ["build octree", "shade leaves"].contains(&stage.name.as_str()));
    let ready_ms = ready.fold(0.0, |sum, stage| sum + stage.ms);
    let mut times = Vec::new();
    for round in 0..=rounds {
        let (ms, _) = take(ids)?;
        // The first round also compiles the pipelines.
        if round > 0 {
            times.push(ms / ids.len() as f64);
        }
        // A sampler keeps the maps of its last traversal. Another request between rounds evicts them.
        take(&[first])?;
    }
    Ok((median(&times), ready_ms))
}

/// A plot of error against the time of a sample.
fn plot(scene: &str, rows: &[Map<String, Value>]) -> Plot {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let name = match row.get("levels").and_then(Value::as_u64) {
            Some(levels) => format!("megaviews, {levels} levels, blocks of {}", number(row, "block")),
            None => format!("triangles by {}", row.get("way").and_then(Value::as_str).unwrap_or_default()),
        };
        if series.last().is_none_or(|last| last.name != name) {
            series.push(Series { name, points: Vec::new(), line: true });
        }
        if let Some(last) = series.last_mut() {
            last.points.push((number(row, "sample_ms"), number(row, "flip")));
        }
    }
    Plot {
        name: "flip".to_owned(),
        title: format!("{scene}: omni samples from triangles and from maps of an octree"),
        x: Axis::log("milliseconds a sample"),
        y: Axis::linear("mean FLIP of views against the reference"),
        series,
        ..Plot::default()
    }
}
