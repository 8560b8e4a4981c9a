//! Table 3 and figure 10: shadows of a spherical light, by maps around its points.

use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_eye_points::{
    Density, DensityRule, Eye, EyePointSettings, LARGEST_SHADOW_SIDE, PointScene, Splatting, is_lit,
    light_map, light_points, shadow_side,
};
use argus_sampler::plug::{IndexMaps, MappedReflector};
use argus_scene::Camera;
use argus_scene::reference::Hit;
use glam::{DVec2, DVec3, Vec3};
use image::RgbImage;
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::options::Options;
use super::paper::shadows as published;
use super::sheets::{grid, save};
use super::stage::{NEAR, Pose, Stage};
use super::ways::USUAL_DENSITY;
use crate::report;

/// Balls among which a place for the light is looked for, and the light's radius in radii of that ball.
const PLACES: u32 = 10;
const LIGHT: f64 = 0.5;
/// Distances from a ray's end that do not count, as a share of its length.
const END: f64 = 1e-6;
/// Mean brightness of lit places in pictures.
const BRIGHTNESS: f64 = 0.6;

/// How the maps around a light's points come to hold depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    Points(Splatting),
    /// Points as dense as texels.
    MapPoints,
    /// Whole triangles into every map.
    MultiView,
}

const METHODS: [(Method, &str); 5] = [
    (Method::Points(Splatting::Buffered), "points"),
    (Method::Points(Splatting::Bufferless), "points, bufferless"),
    (Method::Points(Splatting::Hybrid), "points, hybrid"),
    (Method::MapPoints, "iVIR"),
    (Method::MultiView, "MVR"),
];

/// Places that the eye sees.
struct Places {
    eye: Eye,
    /// Index in the image, and what is seen there.
    all: Vec<(usize, Hit, DVec3, Vec3)>,
}

pub(super) fn rows(options: &Options, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
    progress.set_length((options.light_samples.len() * METHODS.len()) as u64);
    let balls = Stage::open(&options.scene, PLACES)?;
    let camera = balls.camera(Pose::Distant)?;
    let (_, middle, radius) = balls.nearest(&camera).context("there is no place for a light")?;
    let stage = Stage::without_reflectors(&options.scene)?;
    let points = PointScene::new(&stage.scene, stage.time_secs);
    let places = stage.places(&camera, options.size);
    let mut rows = Vec::new();
    for &samples in &options.light_samples {
        let lights = light_points(middle, LIGHT * radius, samples);
        let seen: Vec<DVec3> = places.all.iter().map(|(_, hit, ..)| hit.position).collect();
        let maps: Vec<MappedReflector> = lights
            .par_iter()
            .map(|&light| light_map(light, shadow_side(&places.eye, light, &seen, LARGEST_SHADOW_SIDE)))
            .collect();
        let truth = places.lit(&lights, |_, light, hit, _| stage.sees(light, hit.position));
        save(options, &format!("shadows-{samples}-rays"), &places.image(options.size, &lights, &truth))?;
        let mut pictures = Vec::new();
        for (method, name) in METHODS {
            let begin = Instant::now();
            let (filled, [count, stored], bytes) = fill(&points, &places.eye, &maps, method, options.budget);
            let fill_ms = begin.elapsed().as_secs_f64() * 1e3;
            let begin = Instant::now();
            let found = places
                .lit(&lights, |map, light, hit, normal| is_lit(&filled, map, light, hit.position, normal));
            let lookup_ms = begin.elapsed().as_secs_f64() * 1e3;
            let image = places.image(options.size, &lights, &found);
            save(options, &format!("shadows-{samples}-{name}"), &image)?;
            pictures.push((name, image));
            let paper = published(samples, name);
            rows.push(report::row(json!({
                "light_samples": samples,
                "way": name,
                "side": maps[0].side,
                "points": count,
                "stored_points": stored,
                "mib": bytes as f64 / f64::from(1 << 20),
                "maps_ms": fill_ms,
                "lookup_ms": lookup_ms,
                "wrong": share_wrong(&truth, &found),
                "visibility_error": mean_error(&truth, &found, lights.len()),
                "paper_points": paper.points,
                "paper_ms": paper.ms,
            })));
            progress.inc(1);
        }
        let shown = ["MVR", "iVIR", "points"]
            .map(|name| pictures.iter().find(|picture| picture.0 == name).map(|picture| &picture.1));
        if let Some(sheet) = grid(&[shown.into_iter().flatten().collect()]) {
            save(options, &format!("figure-10-{samples}"), &sheet)?;
        }
    }
    Ok(rows)
}

/// The maps that a method fills, its points and those that it stores, and its bytes.
fn fill(
    points: &PointScene,
    eye: &Eye,
    maps: &[MappedReflector],
    method: Method,
    budget: u32,
) -> (IndexMaps, [Option<usize>; 2], usize) {
    let (rule, scale, splatting) = match method {
        Method::Points(splatting) => (DensityRule::Shadow, USUAL_DENSITY, splatting),
        Method::MapPoints => (DensityRule::Map, 1.0, Splatting::Buffered),
        Method::MultiView => {
            let filled = points.rasterise(maps);
            let bytes = filled.bytes();
            return (filled, [None; 2], bytes);
        }
    };
    let density = Density { rule, scale, ..Density::default() };
    let settings = EyePointSettings { density, budget, ..EyePointSettings::default() };
    let found = points.points_by(eye, maps, &settings, splatting);
    let (count, stored, bytes) = (found.count(), found.points.len(), found.bytes());
    (found.maps, [Some(count), Some(stored)], bytes)
}

/// Share of all pairs of a place and a point of the light that differ from the truth.
fn share_wrong(truth: &[bool], found: &[bool]) -> f64 {
    truth.iter().zip(found).filter(|(a, b)| a != b).count() as f64 / truth.len().max(1) as f64
}

/// Mean difference of the share of the light that places see.
fn mean_error(truth: &[bool], found: &[bool], lights: usize) -> f64 {
    let share = |lit: &[bool]| lit.iter().filter(|lit| **lit).count() as f64 / lights as f64;
    let places = truth.chunks(lights).zip(found.chunks(lights));
    let count = (truth.len() / lights.max(1)).max(1) as f64;
    places.map(|(a, b)| (share(a) - share(b)).abs()).sum::<f64>() / count
}

impl Stage {
    /// Whether a place is seen from a point of a light.
    fn sees(&self, light: DVec3, place: DVec3) -> bool {
        let towards = place - light;
        self.tracer.trace(light, towards).is_none_or(|hit| hit.range >= towards.length() * (1.0 - END))
    }

    fn places(&self, camera: &Camera, [width, height]: [u32; 2]) -> Places {
        let of_pixel = |index: usize| {
            let at = DVec2::new((index % width as usize) as f64 + 0.5, (index / width as usize) as f64 + 0.5);
            let along = |offset: DVec2| camera.direction(at + offset, width, height);
            let [direction, right, down] = [DVec2::ZERO, DVec2::X, DVec2::Y].map(along);
            let hit = self.tracer.trace(camera.eye, direction)?;
            let surface = self.tracer.surface(&hit, direction, right - direction, down - direction);
            let normal = self.plane_normal(&hit, direction);
            Some((index, hit, normal, surface.albedo))
        };
        let count = width as usize * height as usize;
        let all = (0..count).into_par_iter().with_min_len(256).filter_map(of_pixel).collect();
        Places { eye: Eye::of(camera, width, height, NEAR), all }
    }
}

impl Places {
    /// For each place and each point of the light whether it is lit. A surface that faces away is not.
    fn lit(&self, lights: &[DVec3], is_lit: impl Fn(usize, DVec3, &Hit, DVec3) -> bool + Sync) -> Vec<bool> {
        let of_place = |(_, hit, normal, _): &(usize, Hit, DVec3, Vec3)| {
            let of_light = |(map, light): (usize, &DVec3)| {
                (hit.position - *light).dot(*normal) < 0.0 && is_lit(map, *light, hit, *normal)
            };
            lights.iter().enumerate().map(of_light).collect::<Vec<_>>()
        };
        let each: Vec<Vec<bool>> = self.all.par_iter().with_min_len(256).map(of_place).collect();
        each.concat()
    }

    /// A picture with this light alone.
    fn image(&self, [width, height]: [u32; 2], lights: &[DVec3], lit: &[bool]) -> RgbImage {
        let irradiance = |(hit, normal): (&Hit, &DVec3), light: &DVec3| {
            let towards = *light - hit.position;
            normal.dot(towards).max(0.0) / towards.length().max(NEAR).powi(3)
        };
        let each: Vec<f64> = self
            .all
            .iter()
            .zip(lit.chunks(lights.len()))
            .map(|((_, hit, normal, _), lit)| {
                let lights = lights.iter().zip(lit).filter(|(_, lit)| **lit);
                lights.map(|(light, _)| irradiance((hit, normal), light)).sum()
            })
            .collect();
        let bright = each.iter().filter(|e| **e > 0.0);
        let mean = bright.clone().sum::<f64>() / bright.count().max(1) as f64;
        let scale = BRIGHTNESS / mean.max(f64::MIN_POSITIVE);
        let mut image = RgbImage::new(width, height);
        for ((index, _, _, albedo), e) in self.all.iter().zip(each) {
            let bytes = argus_scene::tone::display_from_radiance(*albedo * (e * scale) as f32, 1.0);
            let (x, y) = ((*index % width as usize) as u32, (*index / width as usize) as u32);
            image.put_pixel(x, y, image::Rgb(bytes));
        }
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::options;

    #[test]
    fn all_maps_shadow_nearly_what_rays_shadow_and_points_need_fewer_cells_than_texels_do() {
        let options = Options {
            scene: "rooms:20".to_owned(),
            light_samples: vec![1, 4],
            size: [96, 64],
            ..options(false)
        };
        let rows = rows(&options, &ProgressBar::hidden()).unwrap();
        assert_eq!(rows.len(), 10);
        for row in &rows {
            assert!(row["wrong"].as_f64().unwrap() < 0.04, "{row:?}");
        }
        let points = |row: usize| rows[row]["points"].as_u64().unwrap();
        assert!(points(0) == points(1) && points(0) == points(2) && points(0) < points(3));
    }

    #[test]
    fn errors_count_lights_and_the_share_of_them() {
        let (truth, found) = ([true, true, false, false], [true, false, true, false]);
        assert_eq!(share_wrong(&truth, &found), 0.5);
        assert_eq!(mean_error(&truth, &found, 2), 0.5);
        assert_eq!(mean_error(&truth, &found, 4), 0.0);
    }
}
