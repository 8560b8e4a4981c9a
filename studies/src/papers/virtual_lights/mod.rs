//! Radiosity: the cost and the error of each approximation of instant radiosity.
//!
//! One view under indirect light is compared with two references: a path-traced one, and one that gathers all of as
//! many VPLs, with maps as large, as fit the device. Each row changes one setting of the first row. All use one ray per
//! pixel, so that only light differs. Times are wall times: tracing VPLs and rendering their maps, once per pose, and
//! a view with indirect light minus one without.
//!
//! Rows of *points* compute the same light without VPLs, from small images of a scene octree seen from blocks of pixels.

mod light;

use std::path::PathBuf;
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
    Camera, Cancel, Frame, Outputs, Plan, RenderError, Sampler as _, SceneState, ViewJob, Visibility,
};
use argus_virtual_lights::point_based::PointReport;
use argus_virtual_lights::vpl::VplReport;
use argus_virtual_lights::{point_report, vpl_report};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::json;

use crate::median::median;
use crate::papers::megaviews::Emitter;
use crate::{Effort, Machine, Report, report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// A light that replaces the scene's lights and sky.
    pub light: Option<Emitter>,
    /// Camera of the view; `None`: the scene's first camera.
    pub camera: Option<Camera>,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Settings of the first row; each other row changes one of them.
    pub base: VplSettings,
    /// Numbers of VPLs.
    pub vpls: Vec<u32>,
    /// Sides of VPL maps in texels.
    pub sides: Vec<u32>,
    /// Sources of VPL maps.
    pub sources: Vec<MapSource>,
    /// Levels of the scene octree.
    pub levels: Vec<u32>,
    /// VPLs from which a pixel gathers.
    pub samples: Vec<u32>,
    /// Radii of the filter in pixels.
    pub filters: Vec<u32>,
    /// Groups of VPLs that a block keeps.
    pub groups: Vec<u32>,
    /// Cut-off distances, as shares of the scene's diagonal.
    pub cutoffs: Vec<f64>,
    /// Distances below which a VPL's light does not increase, as shares of the scene's diagonal.
    pub clamps: Vec<f64>,
    /// Depth biases of map lookups, in texel widths.
    pub biases: Vec<f64>,
    /// Points splatted into each imperfect map.
    pub points: Vec<u32>,
    /// Settings of the first row of points.
    pub points_base: PointSettings,
    /// Levels of the points' octree.
    pub point_levels: Vec<u32>,
    /// Sides of receivers' maps in texels.
    pub point_sides: Vec<u32>,
    /// Sides of pixel blocks in pixels.
    pub blocks: Vec<u32>,
    /// Number of VPLs and side of maps of the reference by VPLs.
    pub most: (u32, u32),
    /// Paths per pixel of the path-traced reference.
    pub paths: u32,
    /// Measured rounds; each time is their median.
    pub rounds: usize,
    /// Folder for the images of all rows.
    pub images: Option<PathBuf>,
}

impl Default for Options {
    /// Takes some minutes on two cores.
    fn default() -> Self {
        Self {
            scene: "terrain:50000".to_owned(),
            light: None,
            camera: None,
            size: [192, 144],
            base: VplSettings::default(),
            vpls: vec![256, 1024, 4096, 16384],
            sides: vec![8, 16, 32, 64],
            sources: MapSource::ALL.to_vec(),
            levels: vec![7, 8, 9],
            samples: vec![4, 16, 64, 256],
            filters: vec![0, 4, 8],
            groups: vec![16, 32, 64],
            cutoffs: vec![0.1, 0.2, 0.4],
            clamps: vec![0.0, 0.01, 0.05],
            biases: vec![0.0, 0.25, 1.0],
            points: vec![256, 4096],
            points_base: PointSettings::default(),
            point_levels: vec![6, 8, 9],
            point_sides: vec![8, 32],
            blocks: vec![4, 16],
            most: (4096, 64),
            paths: 1024,
            rounds: 3,
            images: None,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:2000".to_owned(),
            size: [48, 36],
            base: VplSettings { vpls: 256, ..VplSettings::default() },
            vpls: vec![64],
            sides: vec![8],
            levels: vec![4],
            samples: vec![64],
            filters: vec![0],
            groups: vec![32],
            cutoffs: vec![0.2],
            clamps: vec![0.05],
            biases: vec![1.0],
            points: vec![64],
            points_base: PointSettings { levels: 5, ..PointSettings::default() },
            point_levels: vec![4],
            point_sides: vec![8],
            blocks: vec![4],
            most: (512, 32),
            paths: 16,
            rounds: 1,
            ..Self::default()
        }
    }
}

impl Options {
    /// The first row, and a row for each changed setting.
    fn rows(&self) -> Vec<(&'static str, Indirect)> {
        let base = self.base;
        let mut rows = vec![("as given", base)];
        rows.extend(self.vpls.iter().map(|&vpls| ("VPLs", VplSettings { vpls, ..base })));
        rows.extend(self.sides.iter().map(|&map_side| ("resolution", VplSettings { map_side, ..base })));
        rows.extend(self.sources.iter().map(|&maps| ("source", VplSettings { maps, ..base })));
        rows.extend(self.samples.iter().map(|&samples| ("samples", VplSettings { samples, ..base })));
        rows.extend(self.filters.iter().map(|&filter| ("filter", VplSettings { filter, ..base })));
        rows.extend(self.clamps.iter().map(|&clamp| ("clamp", VplSettings { clamp, ..base })));
        rows.extend(
            self.levels
                .iter()
                .map(|&levels| ("octree levels", VplSettings { maps: MapSource::MegaViews, levels, ..base })),
        );
        // Culling and weighting are compared without the filter, which would hide their effect.
        let bare = VplSettings { filter: 0, ..base };
        for (cull, weigh) in [(false, false), (true, false), (false, true), (true, true)] {
            rows.push(("culling", VplSettings { cull, weigh, ..bare }));
        }
        for filter in [0, base.filter] {
            rows.extend(self.groups.iter().map(|&groups| ("groups", VplSettings { filter, groups, ..base })));
        }
        rows.extend(
            self.cutoffs.iter().map(|&cutoff| ("cut-off", VplSettings { cutoff, weigh: false, ..bare })),
        );
        // As many texels as the first row, in a few large maps.
        let few = (base.vpls * base.map_side * base.map_side / (128 * 128)).max(1);
        let large = VplSettings { vpls: few, map_side: 128, samples: base.samples.min(few), ..base };
        rows.push(("few large maps", large));
        let mut rows: Vec<_> =
            rows.into_iter().map(|(differs, settings)| (differs, Indirect::Vpl(settings))).collect();
        rows.extend(self.point_rows().map(|(differs, settings)| (differs, Indirect::Points(settings))));
        let mut unique: Vec<(&'static str, Indirect)> = Vec::new();
        for row in rows {
            if unique.iter().all(|(_, settings)| *settings != row.1) {
                unique.push(row);
            }
        }
        unique
    }

    /// The rows of light by points.
    fn point_rows(&self) -> impl Iterator<Item = (&'static str, PointSettings)> {
        let base = PointSettings { bounces: self.base.bounces, ..self.points_base };
        let levels = self.point_levels.iter().map(move |&levels| PointSettings { levels, ..base });
        let sides = self.point_sides.iter().map(move |&map_side| PointSettings { map_side, ..base });
        let blocks = self.blocks.iter().map(move |&block| PointSettings { block, ..base });
        let alone = PointSettings { sharing: false, ..base };
        std::iter::once(("points", base))
            .chain(levels.map(|settings| ("points, levels", settings)))
            .chain(sides.map(|settings| ("points, resolution", settings)))
            .chain(blocks.map(|settings| ("points, block", settings)))
            .chain(std::iter::once(("points, own maps", alone)))
    }
}

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
        let camera = options.camera.unwrap_or_else(|| scene.default_camera());
        progress.set_message("tracing the reference");
        let tracer = Tracer::new(Arc::new(scene.clone()));
        let paths = Paths { paths: options.paths, bounces: options.base.bounces };
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
            plan: Plan::direct(1),
            state: SceneState::default(),
            time_secs: 0.0,
            visibility: Visibility::default(),
            reflections: None,
            history: None,
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
            ..options.base
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
    let pixels = frame.color.as_ref().context("the frame has no colour")?.to_vec();
    RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_differs_from_all_rows_before_it() {
        let options = Options::default();
        let rows = options.rows();
        assert_eq!(rows[0].1, Indirect::Vpl(options.base));
        for (index, (_, settings)) in rows.iter().enumerate() {
            SamplerSettings { indirect: *settings, ..SamplerSettings::default() }.validate().unwrap();
            assert!(rows[..index].iter().all(|(_, other)| other != settings));
        }
        assert!(rows.len() > 15);
    }
}
