//! Cells: a view's error and unresolved pixels against its distance from the sample cameras, for several rig spacings.
//!
//! Each view of a walk is repeated on its way from the nearest sample camera that sees it. At 0 it is that camera's own
//! position. At 1 it stands where samples serve it worst: in the middle of a lattice cell, or at the walk's own position
//! under a `TileCorners` rig.

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::SamplerKnobs;
use argus_scene::{Camera, Outputs, Plan, Rig, RigKnobs, ViewJob, Warp};
use glam::DVec3;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::bench::{Bench, FrameErrors};
use crate::median::mean;
use crate::{Effort, Machine, Report, report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// A scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Views of the walk.
    pub views: usize,
    /// The rig at spacing factor 1.
    pub rig: RigKnobs,
    /// Rig spacings, as factors of the default spacing.
    pub spacings: Vec<f64>,
    /// Positions between a sample camera (0) and the worst-served position (1).
    pub positions: Vec<f64>,
    /// Samples used for each warped view.
    pub samples: usize,
    /// Reference samples per pixel: a square number.
    pub reference_samples: u32,
}

impl Default for Options {
    /// Takes some minutes on two cores.
    fn default() -> Self {
        Self {
            scene: "terrain:500000".to_owned(),
            size: [200, 150],
            views: 6,
            rig: RigKnobs::default(),
            spacings: vec![0.5, 1.0, 2.0],
            positions: vec![0.0, 0.125, 0.25, 0.5, 0.75, 1.0],
            samples: 4,
            reference_samples: 16,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:20000".to_owned(),
            size: [64, 48],
            views: 2,
            spacings: vec![1.0, 2.0],
            positions: vec![0.0, 1.0],
            ..Self::default()
        }
    }
}

/// A moved view, and its distance from its sample camera in metres.
struct Step {
    camera: Camera,
    distance: f64,
}

/// Runs the study; `progress` counts spacings × positions.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length((options.spacings.len() * options.positions.len()) as u64);
    progress.set_message(options.scene.clone());
    let mut bench = Bench::new(&gpu, &options.scene, &options.rig, SamplerKnobs::default())?;
    let base = bench.info.rig;
    let walk = bench.walk(options.views);
    let (mut rows, mut held) = (Vec::new(), Vec::new());
    let mut apart = 0;
    for &factor in &options.spacings {
        bench.replace_rig(&spaced(&base, factor), &held)?;
        let steps: Vec<Vec<Step>> =
            options.positions.iter().map(|&position| steps(&bench, &walk, position)).collect();
        apart += walk.len() - steps[0].len();
        let cameras: Vec<Camera> = steps.iter().flatten().map(|step| step.camera).collect();
        held = bench.all_ids(&cameras, options.samples);
        bench.hold(&held)?;
        for (&position, steps) in options.positions.iter().zip(&steps) {
            if !steps.is_empty() {
                rows.push(row(&mut bench, options, position, steps, held.len())?);
            }
            progress.inc(1);
        }
    }
    let mut report = Report::new(&bench.scene.name, Machine::here(gpu.kind()), rows);
    report.notes.push(format!(
        "Up to {} views of {}×{} pixels a row, {} samples a view; way: position between a sample camera (0) and \
         the position with the worst samples (1).",
        options.views, options.size[0], options.size[1], options.samples
    ));
    if apart > 0 {
        report.notes.push(format!("{apart} views have no sample camera in sight and are left out."));
    }
    let against = |key: &str, label: &str| plot(&bench, &report.rows, key, label);
    report.plots = vec![
        against("flip", "mean FLIP against the reference"),
        against("unresolved_fraction", "share of pixels that no sample saw"),
    ];
    Ok(report)
}

/// Knobs for the same rig with its cameras `factor` times as far apart. A rig of one tile starts from 2 × 2 tiles, so
/// that it can become wider.
fn spaced(rig: &Rig, factor: f64) -> RigKnobs {
    match *rig {
        Rig::TileCorners { tiles, size, .. } => {
            let tiles = tiles.map(|n| ((f64::from(n.max(2)) / factor).round() as u32).max(1));
            RigKnobs { tiles: Some(tiles), size: Some(size), ..RigKnobs::default() }
        }
        Rig::Cell { spacing, face, .. } => {
            RigKnobs { spacing: Some(spacing * factor), face: Some(face), ..RigKnobs::default() }
        }
    }
}

/// Metres between neighbouring sample cameras.
fn spacing(rig: &Rig) -> f64 {
    match *rig {
        Rig::TileCorners { bounds, tiles: [x, z], .. } => {
            let size = bounds.size();
            (size.x / f64::from(x)).max(size.z / f64::from(z))
        }
        Rig::Cell { spacing, .. } => spacing,
    }
}

/// The walk's views at position `position` (0–1) between their sample camera and the worst-served position.
fn steps(bench: &Bench, walk: &[Camera], position: f64) -> Vec<Step> {
    let step = |view: &Camera| {
        let centers = bench.info.rig.nearest(view, 8).into_iter();
        let mut centers = centers.filter_map(|index| Some(bench.info.rig.camera(index).ok()?.center()));
        // Cameras of a lattice may stand inside walls.
        let sees = |from: DVec3| {
            bench.tracer.trace(from, view.eye - from).is_none_or(|hit| hit.range > from.distance(view.eye))
        };
        let from = centers.find(|&center| sees(center))?;
        let goal = match bench.info.rig {
            Rig::Cell { spacing, .. } => {
                from + (view.eye - from).map(|d| 0.5 * spacing * if d < 0.0 { -1.0 } else { 1.0 })
            }
            Rig::TileCorners { .. } => view.eye,
        };
        let eye = from + (goal - from) * position;
        // The view turns as little as possible: indoors it keeps its direction, on a landscape its target.
        let target = match bench.info.rig {
            Rig::Cell { .. } => eye + (view.target - view.eye),
            Rig::TileCorners { .. } => view.target,
        };
        let camera = Camera { eye, target, ..*view };
        camera.validate().is_ok().then_some(Step { camera, distance: eye.distance(from) })
    };
    walk.iter().filter_map(step).collect()
}

fn row(
    bench: &mut Bench,
    options: &Options,
    position: f64,
    steps: &[Step],
    held: usize,
) -> Result<Map<String, Value>> {
    let outputs = Outputs { range: true, ..Outputs::COLOR };
    let jobs: Vec<ViewJob> = steps
        .iter()
        .map(|Step { camera, .. }| {
            let samples = bench.sample_ids(camera, options.samples);
            let plan = Plan::Warp(Warp { samples, ..Warp::default() });
            bench.job(*camera, options.size, outputs, plan)
        })
        .collect();
    let direct: Vec<ViewJob> =
        jobs.iter().map(|job| ViewJob { plan: Plan::direct(1), ..job.clone() }).collect();
    let truth = |step: &Step| bench.truth(&step.camera, options.size, options.reference_samples, &[1]);
    let truths: Vec<_> = steps.iter().map(truth).collect();
    let mut judged = |jobs: &[ViewJob]| -> Result<Vec<FrameErrors>> {
        let (_, frames) = bench.time(jobs)?;
        frames.iter().zip(&truths).map(|(frame, truth)| Bench::judge(frame, truth, 1)).collect()
    };
    let (warped, direct) = (judged(&jobs)?, judged(&direct)?);
    Ok(report::row(json!({
        "spacing_m": spacing(&bench.info.rig),
        "way": position,
        "distance_m": mean(steps.iter().map(|step| step.distance)),
        "views": steps.len(),
        "samples_held": held,
        "flip": mean(warped.iter().map(|j| j.image.flip_mean)),
        "direct_flip": mean(direct.iter().map(|j| j.image.flip_mean)),
        "unresolved_fraction": mean(warped.iter().map(|j| j.unresolved)),
        "wrong_surface_fraction": mean(warped.iter().map(|j| j.wrong_surface)),
    })))
}

/// A plot of one column against distance, with a line for each spacing.
fn plot(bench: &Bench, rows: &[Map<String, Value>], key: &str, label: &str) -> Plot {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let name = format!("cameras {:.3} m apart", number(row, "spacing_m"));
        if series.last().is_none_or(|last| last.name != name) {
            series.push(Series { name, points: Vec::new(), line: true });
        }
        if let Some(last) = series.last_mut() {
            last.points.push((number(row, "distance_m"), number(row, key)));
        }
    }
    Plot {
        name: key.split('_').next().unwrap_or(key).to_owned(),
        title: format!("{}: views and the cameras of their samples", bench.scene.name),
        x: Axis::linear("metres from the nearest sample camera"),
        y: Axis::linear(label),
        series,
        ..Plot::default()
    }
}
