//! Direct light by rays: what each effect costs, and its error against the reference.
//!
//! Every row renders the same views and one sample with other effects or another number of rays, and is judged against the
//! reference with the same effects. The row without effects is the price that the others are to be compared with.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus::args;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::{GpuSampler, LightSettings, LightTracer, SamplerSettings};
use argus_scene::effects::{EffectKind, SHARED_STAGE};
use argus_scene::reference::{DirectLight, Tracer};
use argus_scene::{
    Camera, Cancel, Frame, LightEffects, Outputs, Plan, RigKind, RigSettings, SampleJob, Sampler as _, Scene,
    Stage, Visibility,
};
use glam::DVec3;
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, is_quick, or_quick, size};
use crate::bench::{Bench, compare, image_of};
use crate::median::{mean, median};
use crate::papers::eye_points::{ShadowScene, ShadowedView};
use crate::{Machine, Report, report};

/// Measures direct light by rays: what shadows, the blocked sky and emitters cost a view and a sample, and their error
/// against the reference
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:5000"))]
    pub scene: String,
    /// Viewpoint x,y,z; without it the scene's own viewpoints
    #[arg(long, value_name = "X,Y,Z", requires = "target", value_parser = args::point, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// Point that the view looks at
    #[arg(long, value_name = "X,Y,Z", requires = "eye", value_parser = args::point, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "64x48"))]
    pub size: [u32; 2],
    /// Samples a pixel of views and reference
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = "4")]
    pub samples_per_pixel: u32,
    /// Numbers of rays of a texel to the sky and to emitters
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("1,2,4,8", "4"))]
    pub rays: Vec<u32>,
    /// Rays of the reference to each light; ten times as many go to the sky and to emitters
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("32", "8"))]
    pub truth_rays: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Folder for images of all views, rows and references
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

/// A row: its name, effects and rays.
type Row = (String, LightEffects, LightSettings);

/// The scene and what all rows share.
struct Subject<'a> {
    options: &'a Options,
    gpu: Arc<Gpu>,
    bench: Bench,
    views: Vec<Camera>,
}

/// Most views that are rendered.
const MOST_VIEWS: usize = 3;
/// Points of a light with an extent in the row of soft shadows by points.
const LIGHT_POINTS: u32 = 20;
/// Difference of a channel, of 255, beyond which a pixel counts as wrong.
const WRONG: u8 = 16;

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let face = is_quick().then_some(64);
    let rig = RigSettings { kind: Some(RigKind::Cell), face, ..RigSettings::default() };
    let bench = Bench::new(&gpu, &options.scene, &rig, SamplerSettings::default())?;
    let camera = options.eye.zip(options.target).map(|(eye, target)| Camera::look_at(eye, target));
    let mut views = camera.map_or_else(|| bench.suggested(), |camera| vec![camera]);
    views.truncate(MOST_VIEWS);
    if let Some(folder) = &options.images {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let subject = Subject { options, gpu, bench, views };
    let rows = rows_of(&subject.bench.scene, &options.rays);
    progress.set_length(rows.len() as u64);
    let mut truths: Vec<(LightEffects, Vec<RgbImage>)> = Vec::new();
    let mut found = Vec::new();
    for (name, effects, settings) in rows {
        progress.set_message(name.clone());
        if truths.iter().all(|(of, _)| *of != effects) {
            truths.push((effects, subject.truths(effects)?));
        }
        let truth = truths.iter().find(|(of, _)| *of == effects).map(|(_, truth)| truth);
        found.push(subject.row(&name, effects, settings, truth.context("a truth is missing")?)?);
        progress.inc(1);
    }
    let by_points = ShadowScene::new(&subject.bench.scene);
    for (effects, each) in by_points.as_ref().map(rows_by_points).unwrap_or_default() {
        let truth = truths.iter().find(|(of, _)| *of == effects).map(|(_, truth)| truth);
        let (scene, truth) = (by_points.as_ref().context("no scene")?, truth.context("a truth is missing")?);
        found.push(subject.row_by_points(scene, each, truth)?);
    }
    let [width, height] = options.size;
    let scene = &subject.bench.scene;
    let mut report = Report::new(&scene.name, Machine::here(subject.gpu.kind()), found);
    report.notes.push(format!(
        "{} views of {width}×{height} pixels with {} samples a pixel, and one sample of the rig. light_ms: casting rays, of \
        view_ms. wrong: pixels with a channel off by more than {WRONG} of 255. The reference has the row's effects, {} rays a \
        light and {} to the sky and to emitters.",
        subject.views.len(),
        options.samples_per_pixel,
        options.truth_rays,
        options.truth_rays * 10,
    ));
    report.notes.push(match by_points {
        Some(_) => {
            "shadows by points: maps of eye-based points around points of each light, on the CPU.".to_owned()
        }
        None => "There are no shadows by points: they need lights that have a place.".to_owned(),
    });
    report.plots = vec![plot(&scene.name, &report.rows)];
    Ok(report)
}

/// The rows: no effect, each by itself, all; and other numbers of rays, with and without the filter.
fn rows_of(scene: &Scene, rays: &[u32]) -> Vec<Row> {
    let (none, usual) = (LightEffects::NONE, LightSettings::default());
    let has_sky = scene.lighting.sky != argus_scene::Sky::BLACK;
    let emits = scene.materials.iter().any(|material| material.emissive.max_element() > 0.0);
    let mut rows = vec![("none".to_owned(), none, usual)];
    if !scene.lighting.lights.is_empty() {
        let hard = LightEffects { shadows: true, ..none };
        rows.push(("hard shadows".to_owned(), hard, usual));
        rows.push(("soft shadows".to_owned(), LightEffects { soft_shadows: true, ..hard }, usual));
    }
    let sky = LightEffects { sky_visibility: true, ..none };
    let emitters = LightEffects { emitters: true, ..none };
    for (effects, name, has) in [(sky, "sky visibility", has_sky), (emitters, "emitters", emits)] {
        for &rays in rays.iter().filter(|_| has) {
            let settings = LightSettings { sky_rays: rays, emitter_rays: rays, ..LightSettings::default() };
            rows.push((format!("{name}, {rays} rays"), effects, settings));
        }
        if has {
            let settings = LightSettings { filter: false, ..usual };
            rows.push((format!("{name}, {} rays unfiltered", usual.sky_rays), effects, settings));
        }
    }
    rows.push(("all".to_owned(), LightEffects::ALL, usual));
    for (name, tracer) in [("CPU", LightTracer::Cpu), ("device", LightTracer::Device)] {
        let settings = LightSettings { tracer, ..usual };
        rows.push((format!("all, traced by the {name}"), LightEffects::ALL, settings));
    }
    rows
}

/// The effects of rows with shadows by points, and the number of points of each light.
fn rows_by_points(scene: &ShadowScene) -> Vec<(LightEffects, u32)> {
    let hard = LightEffects { shadows: true, ..LightEffects::NONE };
    let soft = LightEffects { soft_shadows: true, ..hard };
    let soft = scene.has_extended_lights().then_some((soft, LIGHT_POINTS));
    [Some((hard, 1)), soft].into_iter().flatten().collect()
}

impl Subject<'_> {
    /// A row with shadows by maps of eye-based points.
    fn row_by_points(
        &self,
        scene: &ShadowScene,
        each: u32,
        truths: &[RgbImage],
    ) -> Result<Map<String, Value>> {
        let options = self.options;
        let go = |view: &Camera| scene.view(view, options.size, options.samples_per_pixel, each);
        let (mut view_ms, mut light_ms, mut views) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..options.rounds.max(1) {
            views = self.views.iter().map(go).collect::<Vec<ShadowedView>>();
            view_ms.push(mean(views.iter().map(|view| view.view_ms)));
            light_ms.push(mean(views.iter().map(|view| view.light_ms)));
        }
        let pairs = || views.iter().map(|view| &view.image).zip(truths);
        let judged = pairs().map(|(image, truth)| argus_scene::metrics::compare(truth, image));
        let judged = judged.collect::<Result<Vec<_>, _>>()?;
        let name = format!("shadows by points, {each} a light");
        if let Some(folder) = &options.images {
            for (view, (image, _)) in pairs().enumerate() {
                image.save(folder.join(format!("{}-{view}.png", name.replace([' ', ','], "-"))))?;
            }
        }
        Ok(report::row(json!({
            "effects": name,
            "view_ms": median(&view_ms),
            "light_ms": median(&light_ms),
            "sample_ms": null,
            "sample_light_ms": null,
            "flip": mean(judged.iter().map(|j| j.flip_mean)),
            "psnr_db": mean(judged.iter().map(|j| j.psnr_db)),
            "ssim": mean(judged.iter().map(|j| j.ssim)),
            "wrong_fraction": mean(pairs().map(|(image, truth)| wrong_share(image, truth))),
        })))
    }

    fn truths(&self, effects: LightEffects) -> Result<Vec<RgbImage>> {
        let light = DirectLight { effects, rays: self.options.truth_rays };
        let tracer = Tracer::new(Arc::clone(&self.bench.scene)).with_direct_light(light);
        let exposure = self.bench.scene.lighting.exposure;
        let [width, height] = self.options.size;
        let samples = self.options.samples_per_pixel;
        let render = |view: &Camera| tracer.render(view, width, height, samples, |_| ()).display(exposure);
        let truths: Vec<RgbImage> = self.views.iter().map(render).collect();
        if let Some(folder) = &self.options.images {
            for (number, truth) in truths.iter().enumerate() {
                truth.save(folder.join(format!("truth-{effects}-{number}.png")))?;
            }
        }
        Ok(truths)
    }

    fn row(
        &self,
        name: &str,
        effects: LightEffects,
        light: LightSettings,
        truths: &[RgbImage],
    ) -> Result<Map<String, Value>> {
        let settings = SamplerSettings { effects, light, ..SamplerSettings::default() };
        let mut sampler = GpuSampler::with_methods(
            Arc::clone(&self.gpu),
            Arc::clone(&self.bench.scene),
            settings,
            crate::methods::methods(),
        )?;
        let samples_per_pixel = self.options.samples_per_pixel;
        let jobs: Vec<_> = self
            .views
            .iter()
            .map(|camera| {
                let plan = Plan::direct(samples_per_pixel);
                let job = self.bench.job(*camera, self.options.size, Outputs::COLOR, plan);
                argus_scene::ViewJob { visibility: Visibility::Cpu, ..job }
            })
            .collect();
        let (mut view_ms, mut light_ms, mut frames) = (Vec::new(), Vec::new(), Vec::new());
        // The first round also builds trees and compiles pipelines.
        for round in 0..=self.options.rounds {
            let begin = Instant::now();
            let found = sampler.render_views(&jobs, &Cancel::new());
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            frames = found.into_iter().collect::<Result<Vec<Frame>, _>>()?;
            if round > 0 {
                view_ms.push(ms / jobs.len() as f64);
                light_ms.push(mean(frames.iter().map(|frame| of_light(&frame.stages))));
            }
        }
        let (sample_ms, sample_light_ms) = self.sample(&mut sampler, effects)?;
        let judged = frames.iter().zip(truths).map(|(frame, truth)| compare(frame, truth));
        let judged = judged.collect::<Result<Vec<_>>>()?;
        let mut wrong = Vec::new();
        for (view, (frame, truth)) in frames.iter().zip(truths).enumerate() {
            let image = image_of(frame)?;
            wrong.push(wrong_share(&image, truth));
            if let Some(folder) = &self.options.images {
                image.save(folder.join(format!("{}-{view}.png", name.replace([' ', ','], "-"))))?;
            }
        }
        Ok(report::row(json!({
            "effects": name,
            "view_ms": median(&view_ms),
            "light_ms": median(&light_ms),
            "sample_ms": sample_ms,
            "sample_light_ms": sample_light_ms,
            "flip": mean(judged.iter().map(|j| j.flip_mean)),
            "psnr_db": mean(judged.iter().map(|j| j.psnr_db)),
            "ssim": mean(judged.iter().map(|j| j.ssim)),
            "wrong_fraction": mean(wrong.iter().copied()),
        })))
    }

    /// Milliseconds of the sample nearest to the first view, and of its rays to lights.
    fn sample(&self, sampler: &mut GpuSampler, effects: LightEffects) -> Result<(f64, f64)> {
        let camera = self.views.first().context("there is no view")?;
        let ids = self.bench.sample_ids(camera, 1);
        let info =
            argus_scene::SampleSetInfo { effects, visibility: Visibility::Cpu, ..(*self.bench.info).clone() };
        let job = SampleJob::new(Arc::new(info), ids, false);
        let (mut times, mut light) = (Vec::new(), Vec::new());
        for round in 0..=self.options.rounds {
            let begin = Instant::now();
            let found = sampler.render_samples(&job, &Cancel::new());
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
            if round > 0 {
                times.push(ms);
                light.push(found.iter().map(|sample| of_light(&sample.stages)).sum());
            }
        }
        Ok((median(&times), median(&light)))
    }
}

/// Milliseconds of direct light by rays.
fn of_light(stages: &[Stage]) -> f64 {
    let effects =
        [EffectKind::Shadows, EffectKind::SoftShadows, EffectKind::SkyVisibility, EffectKind::Emitters];
    let own = effects.into_iter().filter_map(|effect| effect.ms_of(stages));
    let shared = stages.iter().filter(|stage| stage.name == SHARED_STAGE).map(|stage| stage.ms);
    // From 0.0, because the sum of no floats is -0.0.
    own.chain(shared).fold(0.0, |sum, ms| sum + ms)
}

/// Share of pixels that are wrong.
fn wrong_share(image: &RgbImage, truth: &RgbImage) -> f64 {
    let is_wrong =
        |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > WRONG);
    let wrong = image.pixels().zip(truth.pixels()).filter(is_wrong).count();
    wrong as f64 / (truth.width() * truth.height()).max(1) as f64
}

/// A plot of error against the time of light.
fn plot(scene: &str, rows: &[Map<String, Value>]) -> Plot {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let point = |row: &Map<String, Value>| Series {
        name: row.get("effects").and_then(Value::as_str).unwrap_or_default().to_owned(),
        points: vec![(number(row, "view_ms"), number(row, "flip"))],
        line: false,
    };
    Plot {
        name: "flip".to_owned(),
        title: format!("{scene}: direct light by rays"),
        x: Axis::log("milliseconds of a direct view"),
        y: Axis::linear("mean FLIP against the reference with the same effects"),
        series: rows.iter().map(point).collect(),
        ..Plot::default()
    }
}
