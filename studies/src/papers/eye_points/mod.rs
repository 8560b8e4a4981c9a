//! Eye-based point rendering, beside its alternatives: points, shades, memory, time and error of reflections.
//!
//! The definition on the CPU is measured ([`argus_eye_points`]), with the f64 reference's shading. All ways share the
//! eye's pixels, the taps, the lookup and the shading; they differ in how maps around the reflectors come to show the
//! scene. The truth is reflected rays of the f64 reference.

mod accuracy;
mod fine;
mod judge;
mod motion;
mod options;
mod paper;
mod recursion;
mod shadowed_view;
mod sheets;
mod soft_shadows;
mod stage;
mod ways;

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use argus_eye_points::{PointDevice, PointScene};
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::plug::{ReflectionRays, taps};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::median::median;
use crate::processes::{peak_bytes, reset_peak};
use crate::{Machine, Report, report};
use judge::Truth;
pub use options::{Options, Part};
use paper::{Published, memory, published};
pub(crate) use shadowed_view::{ShadowScene, ShadowedView};
use sheets::{Pictures, save, slug};
pub use stage::Pose;
use stage::{Seen, Stage};
pub use ways::TapRule;
use ways::{Outcome, USUAL_DENSITY, Way, Ways};

/// The paper's fixed side of maps.
const FIXED_SIDE: u32 = 512;
/// Most reflectors for which maps of the fixed side are filled: each takes 30 MiB.
const MOST_FIXED: usize = 12;
/// Most resident memory of this process in a row of eye-based points, MiB.
const MOST_MIB: f64 = 2048.0;

/// Runs a part of the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened or has no reflector, or a folder that cannot be written to.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    if let Some(folder) = &options.images {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let (rows, note) = match options.part {
        Part::Reflections => return reflections(options, progress),
        Part::Accuracy => (
            accuracy::rows(options, progress)?,
            "Error against time (figure 6), with adaptive maps. reflector_pixels: wanted mean diameter of reflectors, for 1080 rows; \
             mean_pixels: that of the reflectors in sight. adaptive taps: four more until the variance of their colour declines \
             no more. rmse: against rays; rmse_fine: against multi-view rendering with maps of four times the side, or as fine as \
             memory allows, and four times the taps, as in the paper.",
        ),
        Part::Recursion => (
            recursion::rows(options, progress)?,
            "Two cylinders that face each other (figure 5). maps_ms: points and their maps, once for any number of bounces. \
             flip_reflective, rmse: against rays of the f64 reference with as many bounces. paper_deferred_ms: request, shading \
             and lookups in the paper.",
        ),
        Part::Motion => (
            motion::rows(options, progress)?,
            "The eye turns by a quarter of a degree a frame, and reflectors rise and sink. Changes are from frame to frame, of \
             255, on pixels that show the same reflector twice. beyond: change beyond that of the reflected rays of the f64 \
             reference; change_of_error: of the difference from them. resized_maps: whose side changed.",
        ),
        Part::Shadows => (
            soft_shadows::rows(options, progress)?,
            "Shadows of a ball of light (section 5), by maps around its points. wrong: pairs of a pixel and a point of the light \
             that differ from a ray; visibility_error: mean difference of the share of the light that a pixel sees. paper_…: the \
             breakfast scene on a GTX 1080 Ti at 1920×1080 (table 3).",
        ),
    };
    let [width, height] = options.size;
    let mut report = Report::new(&options.scene, Machine::here("not used"), rows);
    report.notes.push(format!(
        "{width}×{height} pixels, {} taps a reflective pixel; all on the CPU. {note}",
        options.taps
    ));
    if options.part == Part::Accuracy {
        report.plots = accuracy::plots(options, &report.rows);
    }
    Ok(report)
}

/// Points and their rivals.
fn reflections(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let ways = ways_of(options)?;
    progress.set_length((options.reflectors.len() * options.poses.len() * ways.len()) as u64);
    let mut rows = Vec::new();
    let mut notes = Vec::new();
    let gpu = Gpu::new(&GpuOptions::default());
    for &balls in &options.reflectors {
        progress.set_message(format!("{balls} reflectors"));
        let stage = Stage::open(&options.scene, balls)?;
        let points = PointScene::new(&stage.scene, 0.0);
        let device = match &gpu {
            Ok(gpu) => anyhow::Ok(PointDevice::new(gpu, &points)),
            Err(error) => Err(anyhow::Error::new(error.clone())),
        };
        if let Err(error) = &device {
            let ways = format!("{} and {}", Way::ComputePoints, Way::DevicePoints);
            notes.push(format!("{balls} reflectors: {ways} are left out: {error}"));
        }
        let rays = ReflectionRays::new(&stage.scene, 0.0)?;
        let mut pictures = Pictures::new(options, balls);
        for &pose in &options.poses {
            let seen = stage.see(&stage.camera(pose)?, options.size);
            if seen.pixels.is_empty() {
                notes.push(format!("{balls} reflectors, {pose}: none is in sight"));
                continue;
            }
            let taps = taps(options.taps);
            let mut subject = Subject {
                options,
                balls,
                pose,
                truth: stage.truth(&seen, &taps),
                ways: Ways {
                    stage: &stage,
                    points: &points,
                    device: device.as_ref().ok(),
                    rays: &rays,
                    seen: &seen,
                    taps: &taps,
                    tap_rule: TapRule::Fixed,
                    budget: options.budget,
                },
            };
            subject.truth.set_fine(subject.ways.fine_multi_view());
            subject.save("truth", subject.truth.image())?;
            for &way in &ways {
                let too_large = matches!(way, Way::MultiView(Some(_))) && seen.reflectors.len() > MOST_FIXED;
                if matches!(way, Way::ComputePoints | Way::DevicePoints) && device.is_err() {
                    progress.inc(1);
                    continue;
                }
                if too_large {
                    notes.push(format!(
                        "{balls} reflectors, {pose}: {way} is left out: its maps take too much memory"
                    ));
                } else {
                    let row = subject.row(way, &mut pictures)?;
                    if row.get("wanted_points").is_some_and(|wanted| !wanted.is_null()) {
                        notes.push(format!(
                            "{balls} reflectors, {pose}, {way}: the budget has lowered the density"
                        ));
                    }
                    rows.push(row);
                }
                progress.inc(1);
            }
            let truth = &subject.truth;
            let references = [Some(truth.image()), truth.fine()].into_iter().flatten();
            pictures.figure_8(pose, &seen, &references.collect::<Vec<_>>())?;
        }
        pictures.figure_7()?;
    }
    let [width, height] = options.size;
    let mut report =
        Report::new(&options.scene, Machine::here(gpu.as_ref().map_or("not used", |gpu| gpu.kind())), rows);
    report.notes.push(format!(
        "{width}×{height} pixels, {} taps a reflective pixel; all on the CPU but for the points and splats of compute and for all but the shading of device, whose times include uploads and \
         readback; shaded by the f64 reference's definition. in_sight: \
         reflectors of which a pixel is seen; only those have maps. splat_ms: points into maps, or rasterising, or rays to fill \
         maps. right: reflective pixels whose central lookup is within 1° and 5% of the range of the reflected ray; right_plain: \
         without impostor steps. flip, flip_reflective, rmse: against reflected rays of the f64 reference, whole image, \
         reflective pixels, and of 255. rmse_fine: against multi-view rendering with maps of four times the side, or as fine as \
         memory allows, and four times the taps, as in the paper. maps_mib, points_mib: texels and stored points; pieces_mib: \
         pieces of triangles; deferred_mib: looked-up texels and shaded radiance; peak_mib: largest resident memory of this \
         process in the row. passed: whether that of eye-based points is within {MOST_MIB} MiB. holes, other_triangle: shares of \
         texels, by rays. paper_…: on a GTX 1080 Ti at 1920×1080, for Sponza.",
        options.taps,
    ));
    report.notes.extend(notes);
    report.plots = vec![plot(options, &report.rows)];
    Ok(report)
}

/// The ways that are asked for, in the order of rows.
fn ways_of(options: &Options) -> Result<Vec<Way>> {
    let points = options.densities.iter().map(|&density| Way::Points(density));
    let others = [
        Way::PlanarPoints,
        Way::CulledPoints,
        Way::BufferlessPoints,
        Way::HybridPoints,
        Way::ComputePoints,
        Way::DevicePoints,
        Way::MapPoints,
        Way::MultiView(None),
        Way::MultiView(Some(FIXED_SIDE)),
        Way::TracedMaps,
        Way::Rays,
    ];
    let mut all: Vec<Way> = points.chain(others).collect();
    let names: Vec<String> = all.iter().map(|way| slug(&way.to_string())).collect();
    let unknown = options.ways.iter().find(|name| !names.contains(name));
    anyhow::ensure!(unknown.is_none(), "ways must be of {}", names.join(", "));
    all.retain(|way| options.ways.is_empty() || options.ways.contains(&slug(&way.to_string())));
    Ok(all)
}

/// A number of reflectors and a pose.
struct Subject<'a> {
    options: &'a Options,
    balls: u32,
    pose: Pose,
    truth: Truth,
    ways: Ways<'a>,
}

impl Subject<'_> {
    fn row(&self, way: Way, pictures: &mut Pictures<'_>) -> Result<Map<String, Value>> {
        reset_peak();
        let mut outcome = self.ways.go(way)?;
        let mut times: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for round in 0..self.options.rounds.max(1) {
            if round > 0 {
                outcome = self.ways.go(way)?;
            }
            for stage in &outcome.stages {
                times.entry(stage.name.clone()).or_default().push(stage.ms);
            }
        }
        let peak_mib = peak_bytes().map(|bytes| mib(bytes as usize));
        let ms = |stage: &str| times.get(stage).map(|times| median(times));
        let total: f64 = times.values().map(|times| median(times)).sum();
        let seen: &Seen = self.ways.seen;
        let scene = &self.ways.stage.scene;
        let image = seen.image(&outcome.arriving, scene.lighting.exposure);
        let name = match way.density() {
            Some(density) => format!("{way} {density}"),
            None => way.to_string(),
        };
        self.save(&name, &image)?;
        if way.density().is_none_or(|density| density == USUAL_DENSITY) {
            pictures.keep(self.pose, &way.to_string(), &image);
        }
        let errors = self.truth.errors(seen, &image, &outcome.met)?;
        let plain = outcome.met_plain.as_ref().map(|met| self.truth.right(seen, met));
        let paper = way
            .method()
            .map_or(Published::default(), |method| published(&self.options.scene, self.balls, method));
        let paper_bytes = way.method().filter(|_| paper != Published::default());
        let paper_bytes = paper_bytes.map_or([None; 2], |method| memory(method, self.balls, paper.points));
        let [paper_maps_mib, paper_points_mib] =
            paper_bytes.map(|bytes| bytes.map(|bytes| mib(bytes as usize)));
        let Outcome { points, wanted, shades, memory, holes, lookups, .. } = outcome;
        Ok(report::row(json!({
            "reflectors": self.balls,
            "pose": self.pose.to_string(),
            "way": way.to_string(),
            "density": way.density(),
            "in_sight": seen.reflectors.len(),
            "mean_side": seen.mean_side(),
            "reflective_pixels": seen.pixels.len(),
            "lookups": lookups,
            "points": points,
            "wanted_points": wanted,
            "shades": shades,
            "mib": mib(memory.sum()),
            "maps_mib": mib(memory.maps),
            "points_mib": mib(memory.points),
            "pieces_mib": mib(memory.pieces),
            "deferred_mib": mib(memory.deferred),
            "peak_mib": peak_mib,
            "passed": passed(way, peak_mib),
            "density_ms": ms("density"),
            "points_ms": ms("points"),
            "splat_ms": ms("splat"),
            "request_ms": ms("request"),
            "shade_ms": ms("shade"),
            "mirror_ms": ms("mirror"),
            "total_ms": total,
            "holes": holes.map(|holes| holes[0]),
            "other_triangle": holes.map(|holes| holes[1]),
            "right": errors.right,
            "right_plain": plain,
            "flip": errors.flip,
            "flip_reflective": errors.flip_reflective,
            "rmse": errors.rmse,
            "rmse_fine": errors.rmse_fine,
            "paper_points": paper.points,
            "paper_shades": paper.shades,
            "paper_ms": paper.ms,
            "paper_maps_mib": paper_maps_mib,
            "paper_points_mib": paper_points_mib,
        })))
    }

    /// Writes an image of a row, if images are wanted.
    fn save(&self, name: &str, image: &image::RgbImage) -> Result<()> {
        save(self.options, &format!("{}-{}-{name}", self.balls, self.pose), image)
    }
}

/// Whether a way keeps to the memory that eye-based points may take; `None` for all others, or if that is not known.
fn passed(way: Way, peak_mib: Option<f64>) -> Option<bool> {
    peak_mib.filter(|_| way.is_eye_based()).map(|mib| mib <= MOST_MIB)
}

fn mib(bytes: usize) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

/// A plot of error against time, a series for each way.
fn plot(options: &Options, rows: &[Map<String, Value>]) -> Plot {
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let usual = row.get("density").and_then(Value::as_f64).is_none_or(|density| density == USUAL_DENSITY);
        let way = row.get("way").and_then(Value::as_str).unwrap_or_default();
        if !usual {
            continue;
        }
        let point = (number(row, "total_ms"), number(row, "flip_reflective"));
        match series.iter_mut().find(|series| series.name == way) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name: way.to_owned(), points: vec![point], line: false }),
        }
    }
    Plot {
        name: "flip".to_owned(),
        title: format!("{}: reflections", options.scene),
        x: Axis::log("milliseconds of all reflections of a view"),
        y: Axis::linear("mean FLIP of reflective pixels against rays"),
        series,
        ..Plot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::options;

    #[test]
    fn more_than_two_gib_fails_eye_based_points_alone() {
        assert_eq!(passed(Way::Points(0.5), Some(2047.0)), Some(true));
        assert_eq!(passed(Way::HybridPoints, Some(2049.0)), Some(false));
        assert_eq!(passed(Way::Rays, Some(5000.0)), None);
        assert_eq!(passed(Way::Points(0.5), None), None);
    }

    #[test]
    fn ways_are_chosen_by_name_and_an_unknown_name_is_refused() {
        let of = |names: &[&str]| {
            let ways = names.iter().map(|name| (*name).to_owned()).collect();
            ways_of(&Options { ways, densities: vec![0.25, 0.5], ..options(false) })
        };
        assert_eq!(of(&["mvr-512", "points"]).unwrap().len(), 3, "a row for each density");
        assert!(of(&[]).unwrap().len() > 8);
        assert!(of(&["points", "splats"]).unwrap_err().to_string().contains("points-hybrid"));
    }

    #[test]
    fn three_hundred_reflectors_of_a_large_view_take_less_than_two_gib_and_a_budget_leaves_no_hole() {
        let stage = Stage::open("rooms:20", 300).unwrap();
        let points = PointScene::new(&stage.scene, 0.0);
        let rays = ReflectionRays::new(&stage.scene, 0.0).unwrap();
        for pose in [Pose::Distant, Pose::Close] {
            let seen = stage.see(&stage.camera(pose).unwrap(), [1920, 1080]);
            let taps = taps(25);
            let mut ways = Ways {
                stage: &stage,
                points: &points,
                rays: &rays,
                seen: &seen,
                taps: &taps,
                tap_rule: TapRule::Fixed,
                device: None,
                budget: 1 << 25,
            };
            let full = ways.go(Way::Points(0.5)).unwrap();
            assert!(mib(full.memory.sum()) < MOST_MIB, "{pose}: {:?}", full.memory);
            assert_eq!(full.wanted, None);
            if pose == Pose::Close {
                continue;
            }
            ways.budget = (full.points.unwrap() * 99 / 100) as u32;
            let fewer = ways.go(Way::Points(0.5)).unwrap();
            assert_eq!(fewer.wanted, full.points, "{pose}: the report says what was wanted");
            assert!(fewer.points.unwrap() <= u64::from(ways.budget));
            assert_eq!(fewer.holes.map(|holes| holes[0]), full.holes.map(|holes| holes[0]));
        }
    }
}
