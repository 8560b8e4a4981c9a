//! Figure 6: error against time, for reflectors of several sizes, densities of points, and rules for the number of taps.

use anyhow::{Context as _, Result};
use argus_eye_points::{Eye, PointScene};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::plug::{ReflectionRays, taps};
use argus_scene::Camera;
use glam::{DVec2, DVec3};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use super::options::Options;
use super::sheets::save;
use super::stage::{NEAR, Pose, Stage};
use super::ways::{TapRule, Way, Ways};
use crate::report;

/// Rows of the paper's views, which its sizes of reflectors are for.
const PAPER_HEIGHT: f64 = 1080.0;
/// Distances that are tried, from near to far.
const TRIED: u32 = 96;
/// The nearest distance, in radii of the ball, and the farthest, as a share of the free line.
const NEAREST: f64 = 1.5;
const FARTHEST: f64 = 0.95;

pub(super) fn rows(options: &Options, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
    let each = variants(options);
    progress.set_length((options.reflectors.len() * options.reflector_pixels.len() * each.len()) as u64);
    let mut rows = Vec::new();
    for &balls in &options.reflectors {
        let stage = Stage::open(&options.scene, balls)?;
        let points = PointScene::new(&stage.scene, 0.0);
        let rays = ReflectionRays::new(&stage.scene, 0.0)?;
        let taps = taps(options.taps);
        for &pixels in &options.reflector_pixels {
            let wanted = pixels * f64::from(options.size[1]) / PAPER_HEIGHT;
            let seen = stage.see(&stage.camera_for(wanted, options.size)?, options.size);
            let mut truth = stage.truth(&seen, &taps);
            let mut ways = Ways {
                stage: &stage,
                points: &points,
                rays: &rays,
                seen: &seen,
                taps: &taps,
                tap_rule: TapRule::Fixed,
                budget: options.budget,
                device: None,
            };
            truth.set_fine(ways.fine_multi_view());
            for &(way, rule) in &each {
                ways.tap_rule = rule;
                let outcome = ways.go(way)?;
                let image = seen.image(&outcome.arriving, stage.scene.lighting.exposure);
                let name = name_of(way, rule);
                save(options, &format!("accuracy-{balls}-{pixels}-{name}"), &image)?;
                let errors = truth.errors(&seen, &image, &outcome.met)?;
                rows.push(report::row(json!({
                    "reflectors": balls,
                    "reflector_pixels": pixels,
                    "mean_pixels": seen.mean_diameter(),
                    "in_sight": seen.reflectors.len(),
                    "way": name,
                    "lookups": outcome.lookups,
                    "points": outcome.points,
                    "shades": outcome.shades,
                    "total_ms": outcome.stages.iter().map(|stage| stage.ms).sum::<f64>(),
                    "right": errors.right,
                    "flip_reflective": errors.flip_reflective,
                    "rmse": errors.rmse,
                    "rmse_fine": errors.rmse_fine,
                })));
                progress.inc(1);
            }
        }
    }
    Ok(rows)
}

/// Points of each density with each rule, multi-view rendering, and rays.
fn variants(options: &Options) -> Vec<(Way, TapRule)> {
    let of_density = |&density: &f64| options.tap_rules.iter().map(move |&rule| (Way::Points(density), rule));
    let others = [(Way::MultiView(None), TapRule::Fixed), (Way::Rays, TapRule::Fixed)];
    options.densities.iter().flat_map(of_density).chain(others).collect()
}

fn name_of(way: Way, rule: TapRule) -> String {
    match way.density() {
        Some(density) => format!("{way} {density}, {rule} taps"),
        None => way.to_string(),
    }
}

/// Plots of three errors against time, with a line for each variant. Rays have no error but the last, and are left out.
pub(super) fn plots(options: &Options, rows: &[Map<String, Value>]) -> Vec<Plot> {
    let errors = [
        ("rmse", "rmse_fine", "RMSE of 255, against MVR at four times the resolution"),
        ("flip", "flip_reflective", "mean FLIP of reflective pixels against rays"),
        ("right", "right", "share of lookups within 1° and 5% of the range"),
    ];
    let number =
        |row: &Map<String, Value>, key: &str| row.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let plot = |(name, key, label): (&str, &str, &str)| {
        let series = variants(options).into_iter().filter(|(way, _)| *way != Way::Rays).map(|(way, rule)| {
            let name = name_of(way, rule);
            let own = rows.iter().filter(|row| row.get("way").and_then(Value::as_str) == Some(&name));
            let points = own.map(|row| (number(row, "total_ms"), number(row, key))).collect();
            Series { name, points, line: options.reflectors.len() == 1 }
        });
        Plot {
            name: format!("accuracy-{name}"),
            title: format!("{}: reflectors of several sizes", options.scene),
            x: Axis::log("milliseconds of all reflections of a view"),
            y: Axis::linear(label),
            series: series.collect(),
            ..Plot::default()
        }
    };
    errors.map(plot).into()
}

impl Stage {
    /// The camera whose reflectors have a mean diameter nearest to so many pixels, of those that look at the distant eye's
    /// nearest ball from its side.
    fn camera_for(&self, pixels: f64, size: [u32; 2]) -> Result<Camera> {
        let distant = self.camera(Pose::Distant)?;
        let (own, center, radius) = self.nearest(&distant).context("there is no reflector")?;
        let back = (distant.eye - center).normalize_or(DVec3::Z);
        let free = self.past(center, back, own).map_or(f64::INFINITY, |hit| (hit.position - center).length());
        let nearest = NEAREST * radius;
        let farthest = (FARTHEST * free).min(4.0 * (distant.eye - center).length()).max(nearest);
        let camera = |tried: u32| {
            let distance = nearest * (farthest / nearest).powf(f64::from(tried) / f64::from(TRIED));
            Camera { eye: center + back * distance, target: center, ..distant }
        };
        let off = |camera: &Camera| (self.mean_diameter(camera, size) / pixels).ln().abs();
        let usable = (0..=TRIED).map(camera).filter(|camera| camera.validate().is_ok());
        let best = usable.min_by(|a, b| off(a).total_cmp(&off(b)));
        best.context("there is no place from which a reflector is seen")
    }

    /// Mean diameter of the balls whose middles are in sight, pixels.
    fn mean_diameter(&self, camera: &Camera, [width, height]: [u32; 2]) -> f64 {
        let eye = Eye::of(camera, width, height, NEAR);
        let half = camera.tan_half_fov(width, height);
        let forward = (camera.target - camera.eye).normalize_or(DVec3::NEG_Z);
        let right = forward.cross(camera.up).normalize_or(DVec3::X);
        let in_sight = |(own, center, _): &(u32, DVec3, f64)| {
            let towards = *center - camera.eye;
            let ahead = towards.dot(forward);
            let place = DVec2::new(towards.dot(right), towards.dot(right.cross(forward)));
            place.abs().cmplt(half * ahead).all()
                && self.tracer.trace(camera.eye, towards).is_some_and(|hit| hit.instance == *own)
        };
        let seen = self.balls().into_iter().filter(in_sight);
        crate::median::mean(seen.map(|(_, center, radius)| eye.diameter(center, radius)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::options;

    fn small() -> Options {
        Options {
            scene: "rooms:20".to_owned(),
            reflectors: vec![3],
            reflector_pixels: vec![100.0, 400.0],
            densities: vec![0.5],
            size: [120, 90],
            taps: 9,
            ..options(false)
        }
    }

    #[test]
    fn larger_reflectors_have_more_pixels_and_adaptive_taps_make_fewer_lookups() {
        let options = small();
        let rows = rows(&options, &ProgressBar::hidden()).unwrap();
        assert_eq!(rows.len(), 8);
        let number = |row: usize, key: &str| rows[row][key].as_f64().unwrap();
        assert!(number(4, "mean_pixels") > 1.5 * number(0, "mean_pixels"), "{rows:?}");
        for first in [0, 4] {
            assert!(
                number(first + 1, "lookups") < number(first, "lookups"),
                "adaptive after fixed: {rows:?}"
            );
            assert!(number(first + 1, "shades") <= number(first, "shades"));
            assert!(number(first + 3, "rmse") < number(first, "rmse"), "rays have none");
        }
        let plots = plots(&options, &rows);
        assert_eq!(plots.len(), 3);
        assert!(plots.iter().all(|plot| plot.series.len() == 3));
        assert!(plots.iter().flat_map(|plot| &plot.series).all(|series| series.points.len() == 2));
    }

    #[test]
    fn the_camera_moves_until_reflectors_are_as_large_as_is_asked_for() {
        let stage = Stage::open("rooms:20", 1).unwrap();
        for pixels in [60.0, 100.0, 200.0] {
            let camera = stage.camera_for(pixels, [640, 480]).unwrap();
            let found = stage.mean_diameter(&camera, [640, 480]);
            assert!((found / pixels).ln().abs() < 0.1, "{found} for {pixels}");
        }
    }
}
