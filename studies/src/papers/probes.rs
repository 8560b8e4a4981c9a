//! Reflections: the cost of reflection probes, and their error against traced reflections (`--reflections maps`,
//! ManyLoDs' figure 3; `--reflections points`, `--reflections rays`).
//!
//! The reference traces rays over every reflector's lobe. Probe times are those of an animated scene, where octree,
//! light of its leaves and probes are rendered anew at each moment. A brute-force render of the same maps is timed
//! beside them.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_megaviews::hierarchy::{RootCube, stream};
use argus_megaviews::many_views::{RasterViews, Settings, ViewList, ViewPoint};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::SamplerSettings;
use argus_scene::reference::{Reflecting, Tracer};
use argus_scene::reflection::BOUNCES;
use argus_scene::{
    Camera, Cancel, Frame, Output, Outputs, Plan, ProbeSource, ReflectionProbeSet, Reflections, RenderError,
    RigKind, RigSettings, SampleId, SampleJob, SampleSetInfo, Sampler as _, Stage, Version, ViewJob, Warp,
};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, or_quick, size};
use crate::bench::{Bench, compare};
use crate::median::{mean, median};
use crate::{Machine, Report, report};

/// Measures reflection probes (`argus serve --reflections maps` and `points`): their cost beside brute force, and their error
/// against traced reflections
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example:
  LP_NUM_THREADS=1 argus-lab study method probes --scene mirrors:400 --images pictures --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("mirrors:60", "mirrors:4"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("320x240", "64x48"))]
    pub size: [u32; 2],
    /// Side of a probe's map in texels, besides 64 (with --quick 32): powers of two
    #[arg(long = "side", value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(16..=256), default_value = or_quick("16,32,128", "16"))]
    pub sides: Vec<u32>,
    /// Levels of the scene's octree, besides 8 (with --quick 6)
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10), default_value = or_quick("6,7,9", "5"))]
    pub levels: Vec<u32>,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Folder for images of all views, rows and references
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    /// Spacing in metres of the omnidirectional cameras that views are warped from, and texels of their faces
    #[arg(skip = or_quick((1.0, 384), (2.0, 64)))]
    pub rig: (f64, u32),
    /// Settings of the first row; each other row changes one of them
    #[arg(skip = base())]
    pub base: Reflections,
    /// Rays per lobe and samples per pixel of the reference
    #[arg(skip = or_quick((64, 9), (8, 1)))]
    pub truth: (u32, u32),
}

/// The first row's settings.
fn base() -> Reflections {
    let base = Reflections::default();
    let source = ProbeSource::Octree { levels: 6 };
    or_quick(base, Reflections { side: 32, source, ..base })
}

/// Seconds of scene time between the moments for which probes are rendered.
const EPOCH_SECS: f64 = 0.1;
/// Sub-pixels a side, so that reflections are judged rather than edges.
const SUPERSAMPLING: u32 = 2;
/// Samples used for each warped view.
const SAMPLES: usize = 4;

/// A scene, its views and their references.
struct Subject {
    bench: Bench,
    views: Vec<Camera>,
    truths: Vec<RgbImage>,
    size: [u32; 2],
    rounds: usize,
}

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened or has no reflector, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let rows = rows_of(options);
    progress.set_length(rows.len() as u64 + 1);
    progress.set_message(options.scene.clone());
    let (spacing, face) = options.rig;
    let rig = RigSettings {
        kind: Some(RigKind::Cell),
        spacing: Some(spacing),
        face: Some(face),
        ..RigSettings::default()
    };
    let mut bench = Bench::new(&gpu, &options.scene, &rig, SamplerSettings::default())?;
    bench.info = Arc::new(SampleSetInfo { epoch_secs: EPOCH_SECS, ..(*bench.info).clone() });
    let instances = bench.scene.reflectors(options.base.most);
    anyhow::ensure!(!instances.is_empty(), "{} has no reflective object", options.scene);
    let views = bench.suggested();
    let (rays, samples) = options.truth;
    let tracer = Tracer::new(bench.scene.clone()).reflecting(Reflecting {
        rays,
        bounces: BOUNCES,
        instances: instances.clone(),
    });
    let [width, height] = options.size;
    let exposure = bench.scene.lighting.exposure;
    let truth = |view: &Camera| tracer.render(view, width, height, samples, |_| ()).display(exposure);
    let truths = views.iter().map(truth).collect();
    progress.inc(1);
    let mut subject = Subject { bench, views, truths, size: options.size, rounds: options.rounds };
    if let Some(folder) = &options.images {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for (number, truth) in subject.truths.iter().enumerate() {
            truth.save(folder.join(format!("truth-{number}.png")))?;
        }
    }
    let mut found = Vec::new();
    for (number, (differs, settings)) in rows.into_iter().enumerate() {
        progress.set_message(differs);
        let (row, frames) = subject.row(&gpu, differs, settings)?;
        if let Some(folder) = &options.images {
            for (view, frame) in frames.iter().enumerate() {
                let pixels =
                    frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
                let image = RgbImage::from_raw(width, height, pixels).context("the frame is short")?;
                image.save(folder.join(format!("{number:02}-{}-{view}.png", differs.replace(' ', "-"))))?;
            }
        }
        found.push(row);
        progress.inc(1);
    }
    let scene = &subject.bench.scene;
    let mut report = Report::new(&scene.name, Machine::here(gpu.kind()), found);
    report.notes.push(format!(
        "{} views of {width}×{height} pixels at {SUPERSAMPLING}² rays a pixel; {} of {} instances are reflectors; {} triangles \
        in all. maps_ms: all probes at one moment. ready_ms: the octree, and the light of its leaves or of points. brute_force_ms: every \
        triangle rasterised into every probe. view_ms: a view warped from {SAMPLES} samples. flip: against {rays} rays per \
        lobe.",
        subject.views.len(),
        instances.len(),
        scene.instances.len(),
        scene.triangles(),
    ));
    report.plots = vec![plot(&scene.name, &report.rows)];
    report.note_longest_pass(&gpu);
    Ok(report)
}

/// The rows: without probes, the base, one changed setting each, and points and rays in place of the octree at each side.
fn rows_of(options: &Options) -> Vec<(&'static str, Option<Reflections>)> {
    let base = options.base;
    let sides = options.sides.iter().map(|&side| ("resolution", Some(Reflections { side, ..base })));
    let levels = options.levels.iter().map(|&levels| {
        ("octree levels", Some(Reflections { source: ProbeSource::Octree { levels }, ..base }))
    });
    let mut rows = vec![("sky alone", None), ("as given", Some(base))];
    rows.extend(sides.chain(levels));
    // Beside those of the octree.
    for source in [ProbeSource::POINTS, ProbeSource::Rays] {
        let all_sides = std::iter::once(base.side).chain(options.sides.iter().copied());
        rows.extend(all_sides.map(|side| (source.name(), Some(Reflections { side, source, ..base }))));
    }
    let mut unique: Vec<(&'static str, Option<Reflections>)> = Vec::new();
    for row in rows {
        if unique.iter().all(|(_, settings)| *settings != row.1) {
            unique.push(row);
        }
    }
    unique
}

impl Subject {
    fn row(
        &mut self,
        gpu: &Arc<Gpu>,
        differs: &str,
        settings: Option<Reflections>,
    ) -> Result<(Map<String, Value>, Vec<Frame>)> {
        let of = |settings| ReflectionProbeSet::of(&self.bench.scene, &self.bench.info.rig, settings);
        let maps = settings.map(of).transpose()?.flatten();
        let info = SampleSetInfo {
            reflections: maps,
            version: self.bench.next_version(),
            ..(*self.bench.info).clone()
        };
        self.bench.info = Arc::new(info);
        let [maps_ms, ready_ms] = maps.map_or(Ok([0.0; 2]), |_| self.time_maps())?;
        let brute_force_ms = maps.map(|maps| self.brute_force(gpu, maps)).transpose()?;

        let mut ids = self.bench.all_ids(&self.views, SAMPLES);
        ids = self.bench.info.with_reflection_probes(ids);
        let taken = self.bench.render_timed(ids.clone(), 0)?;
        let plan = |camera: &Camera| {
            let samples = self.bench.info.with_reflection_probes(self.bench.sample_ids(camera, SAMPLES));
            Plan::Warp(Warp { supersampling: SUPERSAMPLING, samples, ..Warp::default() })
        };
        let direct = Plan::direct(SUPERSAMPLING * SUPERSAMPLING);
        let job = |camera: &Camera, plan| self.bench.job(*camera, self.size, Outputs::COLOR, plan);
        let warped: Vec<ViewJob> = self.views.iter().map(|camera| job(camera, plan(camera))).collect();
        let direct: Vec<ViewJob> = self.views.iter().map(|camera| job(camera, direct.clone())).collect();
        let (view_ms, warped) = self.time_views(&warped)?;
        let (direct_ms, direct) = self.time_views(&direct)?;
        self.bench.release(&ids);
        let judge = |frames: &[Frame]| -> Result<[f64; 3]> {
            let judged = frames.iter().zip(&self.truths).map(|(frame, truth)| compare(frame, truth));
            let judged = judged.collect::<Result<Vec<_>>>()?;
            Ok([
                mean(judged.iter().map(|j| j.flip_mean)),
                mean(judged.iter().map(|j| j.psnr_db)),
                mean(judged.iter().map(|j| j.ssim)),
            ])
        };
        let [flip, psnr_db, ssim] = judge(&warped)?;
        let [direct_flip, direct_psnr_db, direct_ssim] = judge(&direct)?;
        let row = report::row(json!({
            "differs": differs,
            "maps": maps.map_or(0, |maps| maps.count),
            "side": settings.map(|settings| settings.side),
            "levels": settings.and_then(|settings| match settings.source {
                ProbeSource::Octree { levels } => Some(levels),
                ProbeSource::Points { .. } | ProbeSource::Rays => None,
            }),
            "maps_ms": maps_ms,
            "ready_ms": ready_ms,
            "brute_force_ms": brute_force_ms,
            "samples": taken.count,
            "view_ms": view_ms,
            "direct_ms": direct_ms,
            "flip": flip,
            "psnr_db": psnr_db,
            "ssim": ssim,
            "direct_flip": direct_flip,
            "direct_psnr_db": direct_psnr_db,
            "direct_ssim": direct_ssim,
            "unresolved_fraction": mean(warped.iter().map(|frame| frame.unresolved_fraction)),
        }));
        Ok((row, direct))
    }

    /// Milliseconds of all probes and of their preparation, over several moments.
    fn time_maps(&mut self) -> Result<[f64; 2]> {
        let mut times: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
        // The first moment also compiles pipelines. The last one is the moment of the views.
        for epoch in (0..=self.rounds as u64 + 1).rev() {
            let info = self.bench.info.at_version(&self.bench.scene, Version::of_epoch(epoch, epoch));
            let id = SampleId { version: epoch, camera: SampleId::REFLECTION_PROBES };
            let job = SampleJob::new(Arc::new(info), vec![id], true);
            let begin = Instant::now();
            let found = self.bench.sampler.render_samples(&job, &Cancel::new());
            let all = begin.elapsed().as_secs_f64() * 1e3;
            let found = found.into_iter().collect::<Result<Vec<_>, RenderError>>()?;
            let stages = || found.iter().flat_map(|sample| &sample.stages);
            let maps = stages()
                .filter(|stage: &&Stage| stage.name.starts_with("reflection "))
                .fold(0.0, |sum, s| sum + s.ms);
            if epoch <= self.rounds as u64 {
                times[0].push(maps);
                times[1].push(all - maps);
            }
        }
        Ok(times.map(|times| median(&times)))
    }

    /// Milliseconds to rasterise the same maps without a hierarchy: visibility only, without light.
    fn brute_force(&self, gpu: &Arc<Gpu>, maps: ReflectionProbeSet) -> Result<f64> {
        let scene = &self.bench.scene;
        let (pose, root) = (scene.at(0.0), RootCube::around(&scene.bounds()));
        let centers = scene.reflectors(maps.settings.most).into_iter();
        let views: Vec<ViewPoint> = centers
            .filter_map(|index| scene.reflector(index, &pose.instances[index as usize]))
            .map(|reflector| ViewPoint::everywhere(reflector.center))
            .collect();
        let list = ViewList::new(gpu, &root, &views)?;
        let settings = Settings { side: maps.settings.side, ..Settings::default() };
        let mut raster = RasterViews::new(gpu, root, stream::triangles(scene, &pose), settings)?;
        let mut times = Vec::new();
        for round in 0..=self.rounds {
            let stats = raster.render(&list)?;
            if round > 0 {
                times.push(stats.frame_ms);
            }
        }
        Ok(median(&times))
    }

    /// Milliseconds per view (median of the rounds), and the frames.
    fn time_views(&mut self, jobs: &[ViewJob]) -> Result<(f64, Vec<Frame>)> {
        let (mut times, mut frames) = (Vec::new(), Vec::new());
        for round in 0..=self.rounds {
            let (ms, found) = self.bench.time(jobs)?;
            if round > 0 {
                times.push(ms / jobs.len() as f64);
            }
            frames = found;
        }
        Ok((median(&times), frames))
    }
}

/// A plot of error against the time of the probes.
fn plot(scene: &str, rows: &[Map<String, Value>]) -> Plot {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut series: Vec<Series> = Vec::new();
    for row in rows.iter().filter(|row| number(row, "maps_ms") > 0.0) {
        let name = row.get("differs").and_then(Value::as_str).unwrap_or_default().to_owned();
        if series.last().is_none_or(|last| last.name != name) {
            series.push(Series { name, points: Vec::new(), line: true });
        }
        if let Some(last) = series.last_mut() {
            last.points.push((number(row, "maps_ms") + number(row, "ready_ms"), number(row, "direct_flip")));
        }
    }
    Plot {
        name: "flip".to_owned(),
        title: format!("{scene}: reflection probes"),
        x: Axis::log("milliseconds of all probes at a moment, octree and light included"),
        y: Axis::linear("mean FLIP of direct views against rays"),
        series,
        ..Plot::default()
    }
}
