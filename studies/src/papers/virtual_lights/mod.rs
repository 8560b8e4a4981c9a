//! Radiosity: the cost and the error of each approximation of instant radiosity.
//!
//! One view under indirect light is compared with two references: a path-traced one, and one that gathers all of as
//! many VPLs, with maps as large, as fit the device. Each row changes one setting of the first row. All use one ray per
//! pixel, so that only light differs. Times are wall times: tracing VPLs and rendering their maps, once per pose, and
//! a view with indirect light minus one without.
//!
//! Rows of *points* compute the same light without VPLs, from small images of a scene octree seen from blocks of pixels.

mod light;
mod options;

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::{GpuSampler, Indirect, MapSource, PointSettings, SamplerSettings, VplSettings};
use argus_scene::metrics::{Comparison, compare};
use argus_scene::reference::{Indirect as Paths, Tracer, cache};
use argus_scene::tone::linear_from_srgb;
use argus_scene::{
    Cancel, Frame, Output, Outputs, Plan, RenderError, Sampler as _, SceneState, ViewJob, Visibility,
};
use argus_virtual_lights::point_based::PointReport;
use argus_virtual_lights::vpl::VplReport;
use argus_virtual_lights::{point_report, vpl_report};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::json;

pub use self::options::Options;
use crate::median::median;
use crate::{Machine, Report, report};

/// A scene with indirect light, and the references of its view.
struct Stage {
    sampler: GpuSampler,
    without: GpuSampler,
    job: ViewJob,
    path_traced: RgbImage,
    by_vpls: RgbImage,
    unlit: RgbImage,
}

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let rows = options.rows();
    progress.set_length(rows.len() as u64);
    let mut stage = Stage::new(&gpu, options, progress)?;
    if let Some(folder) = &options.images {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        stage.path_traced.save(folder.join("path-traced.png"))?;
        stage.by_vpls.save(folder.join("by-all-vpls.png"))?;
        stage.unlit.save(folder.join("without.png"))?;
    }
    let mut found = Vec::new();
    let mut points: Vec<(&'static str, f64, f64)> = Vec::new();
    for (number, (differs, settings)) in rows.into_iter().enumerate() {
        progress.set_message(differs);
        stage.sampler.set_indirect(settings)?;
        let (image, view_ms, unlit_ms) = stage.measure(options.rounds)?;
        // On a busy machine the difference of small times may be negative.
        let gather_ms = (view_ms - unlit_ms).max(0.0);
        let traced = compare(&stage.path_traced, &image)?;
        let by_vpls = compare(&stage.by_vpls, &image)?;
        if let Some(folder) = &options.images {
            image.save(folder.join(format!("{number:02}-{}.png", differs.replace(' ', "-"))))?;
        }
        let (mut row, before_ms) = match settings {
            Indirect::Vpl(settings) => {
                let lit = vpl_report(&stage.sampler)?.context("nothing was lit")?;
                (vpl_row(&settings, &lit), lit.trace_ms + lit.maps_ms)
            }
            Indirect::Points(settings) => {
                let lit = point_report(&stage.sampler).context("nothing was lit")?;
                (point_row(&settings, &lit), lit.light_ms)
            }
            Indirect::Off | Indirect::Paths(_) | Indirect::Cells(_) => {
                unreachable!("every row is of VPLs or points")
            }
        };
        points.push((differs, gather_ms + before_ms, traced.flip_mean));
        row.extend(common_row(differs, [unlit_ms, gather_ms], [traced, by_vpls], stage.energy(&image)));
        found.push(row);
        progress.inc(1);
    }
    let machine = Machine::here(gpu.kind());
    let mut report = Report::new(options.scene.clone(), machine, found);
    let floor = compare(&stage.path_traced, &stage.by_vpls)?;
    let off = compare(&stage.path_traced, &stage.unlit)?;
    let (vpls, side) = options.most;
    report.notes.push(format!(
        "The reference by VPLs ({vpls}, with exact maps of {side}², all gathered) has a FLIP of {:.4}, {:.1} dB and an SSIM \
        of {:.4} against the path-traced one ({} paths per pixel); without indirect light: {:.4}, {:.1} dB, {:.4}.",
        floor.flip_mean, floor.psnr_db, floor.ssim, options.paths, off.flip_mean, off.psnr_db, off.ssim,
    ));
    report.notes.push(
        "view_ms: a view without indirect light. gather_ms: the further time with indirect light.".to_owned(),
    );
    report.note_longest_pass(&gpu);
    report.plots.push(plot(options, &points));
    Ok(report)
}

type Row = serde_json::Map<String, serde_json::Value>;

fn vpl_row(settings: &VplSettings, lit: &VplReport) -> Row {
    let from_octree = matches!(settings.maps, MapSource::MegaViews | MapSource::ManyLods);
    report::row(json!({
        "way": "vpl",
        "vpls": lit.vpls,
        "resolution": settings.map_side,
        "maps": settings.maps.name(),
        "levels": from_octree.then_some(settings.levels),
        "samples": settings.samples,
        "filter": settings.filter,
        "cull": settings.cull,
        "weigh": settings.weigh,
        "groups": settings.groups,
        "cutoff": settings.cutoff,
        "clamp": settings.clamp,
        "bias": settings.bias,
        "points": (settings.maps == MapSource::Imperfect).then_some(settings.points),
        "trace_ms": lit.trace_ms,
        "octree_ms": lit.octree_ms,
        "maps_ms": lit.maps_ms,
        "map_bytes": lit.map_bytes,
        "culled_fraction": if lit.culled.is_nan() { None } else { Some(lit.culled) },
    }))
}

fn point_row(settings: &PointSettings, lit: &PointReport) -> Row {
    report::row(json!({
        "way": "points",
        "resolution": settings.map_side,
        "maps": if settings.sharing { "megaviews" } else { "manylods" },
        "levels": settings.levels,
        "block": settings.block,
        "receivers": lit.receivers,
        "octree_ms": lit.octree_ms,
        "light_ms": lit.light_ms,
        "map_bytes": lit.map_bytes,
    }))
}

/// Columns of both kinds of rows.
fn common_row(
    differs: &str,
    [unlit_ms, gather_ms]: [f64; 2],
    [traced, by_vpls]: [Comparison; 2],
    energy: f64,
) -> Row {
    report::row(json!({
        "differs": differs,
        "view_ms": unlit_ms,
        "gather_ms": gather_ms,
        "energy": energy,
        "flip": traced.flip_mean,
        "psnr_db": finite(traced.psnr_db),
        "ssim": traced.ssim,
        "flip_by_vpls": by_vpls.flip_mean,
        "psnr_by_vpls_db": finite(by_vpls.psnr_db),
        "ssim_by_vpls": by_vpls.ssim,
    }))
}

/// Drops infinities, which JSON does not have.
fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

fn plot(options: &Options, points: &[(&'static str, f64, f64)]) -> Plot {
    let mut series: Vec<Series> = Vec::new();
    for &(differs, ms, flip) in points {
        // All rows of points are one series.
        let differs = if differs.starts_with("points,") { "points" } else { differs };
        match series.iter_mut().find(|series| series.name == differs) {
            Some(series) => series.points.push((ms, flip)),
            None => series.push(Series { name: differs.to_owned(), points: vec![(ms, flip)], line: false }),
        }
    }
    // Rows that smooth less or lose energy are left out. Shapes distinguish seven series.
    const SHOWN: [&str; 7] =
        ["as given", "VPLs", "resolution", "source", "octree levels", "samples", "points"];
    series.retain(|series| SHOWN.contains(&series.name.as_str()));
    let [width, height] = options.size;
    Plot {
        name: "pareto".to_owned(),
        title: format!("Indirect light of {width}×{height} pixels: error against time"),
        x: Axis::log("milliseconds: VPLs, maps and gathering"),
        y: Axis::linear("mean FLIP against the path-traced view"),
        series,
        ..Plot::default()
    }
}

impl Stage {
    fn new(gpu: &Arc<Gpu>, options: &Options, progress: &ProgressBar) -> Result<Self> {
        let mut scene = argus_scene::open(&options.scene)?;
        if let Some(emitter) = &options.light {
            light::replace(&mut scene, emitter);
        }
        let camera = options.viewer.camera(&scene)?;
        progress.set_message("tracing the reference");
        let tracer = Tracer::new(Arc::new(scene.clone()));
        let paths = Paths { paths: options.paths, bounces: options.bounces };
        let folder = cache::directory();
        let truth =
            cache::render_with(folder.as_deref(), &tracer, &camera, options.size, 1, Some(paths), |_| ());
        // The exposure makes the geometric mean of the indirect light a dark grey.
        let luminance = |c: &glam::Vec3| f64::from(c.element_sum()) / 3.0;
        let lit = truth.radiance.iter().map(luminance).filter(|l| *l > 1e-6);
        let logs: Vec<f64> = lit.map(f64::ln).collect();
        let mean = (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp();
        if options.light.is_some() {
            scene.lighting.exposure = (0.1 / mean) as f32;
        }
        let exposure = scene.lighting.exposure;
        let scene = Arc::new(scene);
        let [width, height] = options.size;
        let job = ViewJob {
            camera,
            width,
            height,
            outputs: Outputs::COLOR,
            band_rows: 0,
            plan: Plan::direct(1),
            state: SceneState::default(),
            time_secs: 0.0,
            visibility: Visibility::default(),
            reflections: None,
            history: None,
            rays: None,
        };
        let sampler = |indirect| {
            let settings = SamplerSettings { indirect, ..SamplerSettings::default() };
            GpuSampler::with_methods(Arc::clone(gpu), Arc::clone(&scene), settings, crate::methods::methods())
        };
        progress.set_message("without indirect light");
        let mut without = sampler(Indirect::Off)?;
        let unlit = image_of(&render(&mut without, &job)?)?;
        progress.set_message("all VPLs");
        let (vpls, map_side) = options.most;
        let all = VplSettings {
            vpls,
            map_side,
            maps: MapSource::Exact,
            samples: 1 << 16,
            filter: 0,
            ..options.base()
        };
        let mut sampler = sampler(Indirect::Vpl(all))?;
        let by_vpls = image_of(&render(&mut sampler, &job)?)?;
        Ok(Self { sampler, without, job, path_traced: truth.display(exposure), by_vpls, unlit })
    }

    /// Returns the image, the milliseconds of the view, and those of the view without indirect light: medians of
    /// alternating rounds.
    fn measure(&mut self, rounds: usize) -> Result<(RgbImage, f64, f64)> {
        // The first render traces VPLs, renders their maps (reported separately) and compiles the pipelines.
        let image = image_of(&render(&mut self.sampler, &self.job)?)?;
        let (mut lit, mut unlit) = (Vec::new(), Vec::new());
        for _ in 0..rounds.max(1) {
            for (sampler, times) in [(&mut self.sampler, &mut lit), (&mut self.without, &mut unlit)] {
                let begin = Instant::now();
                render(sampler, &self.job)?;
                times.push(begin.elapsed().as_secs_f64() * 1e3);
            }
        }
        Ok((image, median(&lit), median(&unlit)))
    }

    /// Indirect light of an image as a share of the reference by VPLs. Measured on displayed values, so values
    /// brighter than white count as white.
    fn energy(&self, image: &RgbImage) -> f64 {
        let sum = |image: &RgbImage| {
            image.iter().map(|&b| f64::from(linear_from_srgb(f32::from(b) / 255.0))).sum::<f64>()
        };
        let unlit = sum(&self.unlit);
        (sum(image) - unlit) / (sum(&self.by_vpls) - unlit)
    }
}

fn render(sampler: &mut GpuSampler, job: &ViewJob) -> Result<Frame, RenderError> {
    sampler.render_views(std::slice::from_ref(job), &Cancel::new()).remove(0)
}

fn image_of(frame: &Frame) -> Result<RgbImage> {
    let pixels = frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
    RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")
}
