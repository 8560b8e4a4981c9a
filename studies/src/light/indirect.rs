//! Light: the cost and the error of each method of indirect light, against the path-traced reference.
//!
//! Some views, with all effects of direct light and metered exposure, are rendered by each method. A row has the seconds
//! before the first view (leaf sides, VPLs or octrees), those of a view, and the error against the reference. Views have
//! one ray a pixel, so that only light differs. FLIP includes the reference's noise; errors of radiance do not.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus::args;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{
    CellSettings, GpuSampler, Indirect, LightSettings, LightTracer, PathSettings, PointSettings,
    SamplerSettings, VplSettings,
};
use argus_scene::metrics::flip_mean;
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::{Camera, LightEffects, Plan, Sampler as _, Scene, SurfaceLight, ViewJob};
use glam::DVec3;
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::arguments::{count, is_quick, or_quick, size};
use crate::light::cells::CellsFound;
use crate::light::radiance::{RadianceError, Reference};
use crate::light::timed::timed;
use crate::median::{mean, median};
use crate::metered::open_metered;
use crate::{Machine, Report, report};

/// Measures indirect light by paths, virtual point lights and points: seconds and error against the path-traced reference
///
/// The reference takes minutes.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study light indirect --scene sponza.glb --eye=-11,3,0 --target 0,4,0 --out figures --images pictures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("rooms", "terrain:2000"))]
    pub scene: String,
    /// Position of the viewer in metres [default: the scene's first three cameras]
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "target")]
    pub eye: Option<DVec3>,
    /// Point that the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = args::point, allow_hyphen_values = true, requires = "eye")]
    pub target: Option<DVec3>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("160x120", "32x24"))]
    pub size: [u32; 2],
    /// Paths a pixel of the reference; its noise falls with their root, and its time is proportional
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("128", "4"))]
    pub paths: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Only methods of these names, with commas between: off, paths, cells, vpl, points [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

/// Most views that are rendered.
const MOST_VIEWS: usize = 3;

/// A method's times and errors.
struct Found {
    method: Indirect,
    /// Seconds before the first view, and of a view.
    before_s: f64,
    view_s: f64,
    flip: f64,
    row: Map<String, Value>,
}

/// The scene, its views, and their references.
struct Subject {
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    views: Vec<ViewJob>,
    references: Vec<Reference>,
}

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let each = |method| tracers(method).map(move |tracer| (method, tracer));
    let methods: Vec<(Indirect, LightTracer)> = options.methods().into_iter().flat_map(each).collect();
    progress.set_length(methods.len() as u64);
    progress.set_message("tracing the reference");
    let subject = Subject::new(options, gpu)?;
    let truths: Vec<RgbImage> = subject.references.iter().map(Reference::display).collect();
    options.save("reference", &truths)?;
    let mut found = Vec::new();
    for (number, &(method, tracer)) in methods.iter().enumerate() {
        progress.set_message(method.to_string());
        found.push(subject.found(options, number, method, tracer, &truths)?);
        progress.inc(1);
    }
    let rows = found.iter().map(|found| found.row.clone()).collect();
    let mut report = Report::new(options.scene.clone(), Machine::here(subject.gpu.kind()), rows);
    report.notes = vec![
        format!(
            "{} views. Reference: {} paths a pixel, {} bounces; FLIP between its halves: {:.3}, and its noise adds about half of \
             that to every row. error: root mean squared error of radiance over the root mean square, free of the reference's \
             noise; bias: the same of blocks of 8×8 pixels; energy: mean radiance over the reference's. White pixels are left \
             out.",
            subject.views.len(),
            options.paths,
            PathSettings::default().bounces,
            mean(subject.references.iter().map(Reference::noise)),
        ),
        "Light cells: first_view_s is a view that fills its cells; beside and aside are views of a second viewer, 5 cm and 1 m to the \
         right; walk are views of one who goes on by 17 cm a frame. filled: cells that such a view fills, as a share of those of a first \
         view. bypass: pixels that rays light, since cells do not describe them."
            .to_owned(),
        "tracer: what traces the rays of views and looks cells up; auto measures it, and never takes a software driver. Two rows of one \
         method differ in nothing else."
            .to_owned(),
        "before_s: the first view, compilation of programs included, less a later one. VPLs and points do not reflect the \
         sky's light, which paths and the reference do."
            .to_owned(),
    ];
    report.notes.extend(at_equal_time(&found));
    report.note_longest_pass(&subject.gpu);
    Ok(report)
}

/// For each row of paths, the best other method that has a first view no later.
fn at_equal_time(found: &[Found]) -> Vec<String> {
    let first = |found: &Found| found.before_s + found.view_s;
    let of_paths = found.iter().filter(|found| matches!(found.method, Indirect::Paths(_)));
    let note = |paths: &Found| {
        let rivals =
            found.iter().filter(|rival| matches!(rival.method, Indirect::Vpl(_) | Indirect::Points(_)));
        let best =
            rivals.filter(|rival| first(rival) <= first(paths)).min_by(|a, b| a.flip.total_cmp(&b.flip));
        let best = best.map_or("no other method has one".to_owned(), |best| {
            format!("the best other method has {:.3} ({})", best.flip, best.method)
        });
        format!(
            "First view within {:.1} s: FLIP {:.3} by {}; {best}.",
            first(paths),
            paths.flip,
            paths.method
        )
    };
    of_paths.map(note).collect()
}

/// What traces the rays of a method's views: both, for the usual settings of methods that a device finds.
fn tracers(method: Indirect) -> impl Iterator<Item = LightTracer> {
    let is_usual = match method {
        Indirect::Paths(settings) => is_quick() || settings == PathSettings::default(),
        Indirect::Cells(settings) => is_quick() || settings == usual_cells(),
        _ => false,
    };
    let all: &[LightTracer] =
        if is_usual { &[LightTracer::Cpu, LightTracer::Device] } else { &[LightTracer::Auto] };
    all.iter().copied()
}

/// Cells as viewers have them in the first half minute.
fn usual_cells() -> CellSettings {
    CellSettings { rays: 64, ..CellSettings::default() }
}

/// All methods of the usual or of the short form, with their settings.
fn methods(quick: bool) -> Vec<Indirect> {
    let (paths, vpl) = (PathSettings::default(), VplSettings::default());
    if quick {
        return vec![
            Indirect::Off,
            Indirect::Paths(PathSettings { level: 5, ..paths }),
            Indirect::Cells(CellSettings { rays: 16, ..CellSettings::default() }),
            Indirect::Vpl(VplSettings { vpls: 256, ..vpl }),
            Indirect::Points(PointSettings { levels: 5, ..PointSettings::default() }),
        ];
    }
    let cells = usual_cells();
    vec![
        Indirect::Off,
        Indirect::Paths(PathSettings { level: 6, ..paths }),
        Indirect::Paths(PathSettings { level: 7, ..paths }),
        Indirect::Paths(PathSettings { level: 8, ..paths }),
        Indirect::Paths(PathSettings { level: 7, gather: 16, ..paths }),
        Indirect::Paths(PathSettings { level: 8, rays: 16, gather: 64, ..paths }),
        Indirect::Cells(CellSettings { rays: 16, ..cells }),
        Indirect::Cells(cells),
        Indirect::Cells(CellSettings::default()),
        Indirect::Cells(CellSettings { pixels: 2, rays: 16, ..cells }),
        Indirect::Cells(CellSettings { pixels: 2, ..cells }),
        Indirect::Cells(CellSettings { pixels: 3, rays: 16, ..cells }),
        Indirect::Cells(CellSettings { pixels: 8, ..cells }),
        Indirect::Cells(CellSettings { pixels: 16, ..cells }),
        Indirect::Vpl(vpl),
        Indirect::Vpl(VplSettings { bounces: 4, ..vpl }),
        Indirect::Vpl(VplSettings { bounces: 4, samples: 64, ..vpl }),
        Indirect::Points(PointSettings::default()),
    ]
}

impl Options {
    /// The methods that are asked for.
    fn methods(&self) -> Vec<Indirect> {
        let is_named = |method: &Indirect| {
            self.methods.is_empty()
                || self.methods.iter().any(|name| method.to_string().starts_with(name.as_str()))
        };
        methods(is_quick()).into_iter().filter(is_named).collect()
    }

    fn save(&self, name: &str, images: &[RgbImage]) -> Result<()> {
        let Some(folder) = &self.images else { return Ok(()) };
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for (view, image) in images.iter().enumerate() {
            image.save(folder.join(format!("{name}-{view}.png")))?;
        }
        Ok(())
    }
}

impl Subject {
    fn new(options: &Options, gpu: Arc<Gpu>) -> Result<Self> {
        let scene = open_metered(&options.scene)?;
        let own = scene.cameras.iter().map(|named| named.camera);
        let look = |(eye, target)| Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) };
        let camera = options.eye.zip(options.target).map(look);
        let mut cameras: Vec<Camera> = camera.map_or_else(|| own.collect(), |camera| vec![camera]);
        if cameras.is_empty() {
            cameras.push(scene.default_camera());
        }
        cameras.truncate(MOST_VIEWS);
        let light = DirectLight { effects: LightEffects::ALL, rays: 16 };
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(light);
        // The halves share the paths.
        let paths = Paths { paths: (options.paths / 2).max(1), bounces: PathSettings::default().bounces };
        let reference = |camera: &Camera| {
            Reference::render(&tracer, &scene.lighting, camera, options.size, 1, Some(paths))
        };
        let references = cameras.iter().map(reference).collect();
        let views =
            cameras.iter().map(|camera| ViewJob::new(*camera, options.size, Plan::direct(1))).collect();
        Ok(Self { gpu, scene, views, references })
    }

    /// Renders the views by one method.
    fn found(
        &self,
        options: &Options,
        number: usize,
        method: Indirect,
        tracer: LightTracer,
        truths: &[RgbImage],
    ) -> Result<Found> {
        let effects = method.effects_with(LightEffects::ALL);
        let light = LightSettings { tracer, ..LightSettings::default() };
        let settings = SamplerSettings { effects, light, indirect: method, ..SamplerSettings::default() };
        let mut sampler = GpuSampler::with_methods(
            Arc::clone(&self.gpu),
            Arc::clone(&self.scene),
            settings,
            crate::methods::methods(),
        )?;
        let views = self.views.iter().map(|job| lit_by(job, method)).collect::<Vec<_>>();
        let (first, _) = timed(&mut sampler, &self.views[0])?;
        // First views fill their cells; those of other viewers find most of them.
        let found = match method {
            Indirect::Cells(_) => Some(CellsFound::measure(&mut sampler, &views)?),
            _ => None,
        };
        let (mut times, mut images) = (Vec::new(), Vec::new());
        for round in 0..options.rounds.max(1) {
            for job in &views {
                let (time, image) = timed(&mut sampler, job)?;
                times.push(time);
                images.extend((round == 0).then_some(image));
            }
        }
        options.save(&format!("{number:02}"), &images)?;
        let flips = truths.iter().zip(&images).map(|(truth, image)| flip_mean(truth, image));
        let flip = mean(flips.collect::<Result<Vec<_>, _>>()?);
        let errors: Vec<RadianceError> =
            self.references.iter().zip(&images).map(|(reference, image)| reference.errors(image)).collect();
        // A view without light has no relative error.
        let of = |field: fn(&RadianceError) -> f64| mean(errors.iter().map(field).filter(|e| e.is_finite()));
        let (before_s, view_s) = ((first - median(&times)).max(0.0), median(&times));
        let leaves = sampler.paths().unwrap_or_default();
        let cells = sampler.light_cells();
        let of_leaves = |ms: f64| (leaves.sides > 0).then_some(ms);
        let mut row = report::row(json!({
            "method": method.to_string(),
            "tracer": match tracer {
                LightTracer::Auto => "auto",
                LightTracer::Cpu => "cpu",
                LightTracer::Device => "device",
            },
            "before_s": before_s,
            "view_s": view_s,
            "cells": cells.map(|cells| cells.cells),
            "cells_mib": cells.map(|cells| cells.bytes as f64 / f64::from(1 << 20)),
            "flip": flip,
            "error": of(|errors| errors.error),
            "bias": of(|errors| errors.bias),
            "energy": of(|errors| errors.energy),
            "leaf_sides": (leaves.sides > 0).then_some(leaves.sides),
            "build_ms": of_leaves(leaves.build_ms),
            "links_ms": of_leaves(leaves.links_ms),
            "direct_ms": of_leaves(leaves.direct_ms),
            "bounces_ms": of_leaves(leaves.gather_ms),
        }));
        row.extend(found.iter().flat_map(CellsFound::columns).map(|(name, value)| (name.to_owned(), value)));
        Ok(Found { method, before_s, view_s, flip, row })
    }
}

/// A view by the best light of a method.
fn lit_by(job: &ViewJob, method: Indirect) -> ViewJob {
    let light = match method {
        Indirect::Cells(settings) => Some(SurfaceLight::Cells { rays: settings.rays, reflected: true }),
        _ => None,
    };
    ViewJob { plan: job.plan.clone().with_light(light), ..job.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_methods_have_settings_in_range_and_differ() {
        for methods in [methods(false), methods(true)] {
            for (index, method) in methods.iter().enumerate() {
                assert_eq!(method.validate(), Ok(()));
                assert!(!methods[..index].contains(method));
            }
        }
    }

    #[test]
    fn paths_are_compared_with_the_best_method_that_is_no_slower() {
        let found = |method, before_s, flip| Found { method, before_s, view_s: 0.5, flip, row: Map::new() };
        let vpl = |bounces| Indirect::Vpl(VplSettings { bounces, ..VplSettings::default() });
        let all = [
            found(Indirect::Paths(PathSettings::default()), 2.0, 0.1),
            found(vpl(1), 1.0, 0.4),
            found(vpl(2), 1.5, 0.3),
            found(vpl(3), 2.5, 0.05),
            found(Indirect::Off, 0.0, 0.01),
        ];
        let notes = at_equal_time(&all);
        assert!(notes.len() == 1 && notes[0].contains("2.5 s: FLIP 0.100"), "{notes:?}");
        assert!(notes[0].contains("0.300") && notes[0].contains("of 2 bounces"), "{notes:?}");
        assert!(at_equal_time(&all[..1])[0].contains("no other method"));
    }
}
