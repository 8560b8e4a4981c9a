//! Figure 5: two cylinders that face each other, with one to three bounces.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_eye_points::{
    Bounces, EyePointSettings, EyePoints, Lookups, Mirror, PointScene, ReflectivePixel, STEPS, Sight,
    Surfaces,
};
use argus_sampler::plug::{Side, taps};
use argus_scene::reference::Hit;
use argus_scene::shading::{diffuse_radiance, reflected_around, sky_radiance};
use argus_scene::{Camera, Instance, Mesh, Scene};
use glam::{DAffine3, DVec2, DVec3, Vec3};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::judge;
use super::options::Options;
use super::sheets::save;
use super::stage::{Seen, Stage};
use crate::report;

/// Taps of the second bounce and all after it (section 4.1.4).
pub(super) const LATER_TAPS: u32 = 4;
/// The most bounces of a row.
const BOUNCES: u32 = 3;
/// Milliseconds of the paper's deferred shading with one to three bounces (figure 5).
const PAPER_MS: [f64; 3] = [1.64, 2.92, 3.80];
/// Balls among which a place for the cylinders is looked for.
const PLACES: u32 = 10;
/// Size of the cylinders in radii of the ball whose place they take: radius, half the height, distance from the middle.
const CYLINDER: [f64; 3] = [0.4, 0.75, 0.6];
/// Distance of the eye in radii of that ball.
const EYE: f64 = 2.8;
/// Quads around a cylinder.
const AROUND: u32 = 96;

pub(super) fn rows(options: &Options, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
    progress.set_length(u64::from(BOUNCES));
    let (stage, camera) = two_cylinders(&options.scene)?;
    let points = PointScene::new(&stage.scene, 0.0);
    let seen = stage.see(&camera, options.size);
    anyhow::ensure!(!seen.pixels.is_empty(), "the cylinders are not in sight");
    let (taps, later_taps) = (taps(options.taps), taps(LATER_TAPS));
    let settings = EyePointSettings { budget: options.budget, ..EyePointSettings::default() };
    let mut rows = Vec::new();
    for bounces in 1..=BOUNCES {
        let found = points.points(&seen.eye, &seen.reflectors, &settings);
        let lookups = Lookups {
            maps: &found.maps,
            reflectors: &seen.reflectors,
            eye: seen.eye.position,
            pixels: &seen.pixels,
            taps: &taps,
            steps: STEPS,
        };
        let surfaces = PointSurfaces::new(&stage, &points, &found, &seen);
        let bounced = Bounces { lookups, later_taps: &later_taps, bounces, surfaces: &surfaces };
        let reflected = bounced.reflect(&stage.scene.lighting.sky, found.points.len(), |_, id| id);
        let exposure = stage.scene.lighting.exposure;
        let image = seen.image(&reflected.radiance, exposure);
        let truth = seen.image(&stage.arriving(&seen, &taps, bounces), exposure);
        save(options, &format!("cylinders-{bounces}-points"), &image)?;
        save(options, &format!("cylinders-{bounces}-rays"), &truth)?;
        let errors = judge::of_images(&seen, &truth, &image)?;
        let ms = |name: &str| {
            let all = found.stages.iter().chain(&reflected.stages);
            all.filter(|stage| stage.name == name).map(|stage| stage.ms).sum::<f64>()
        };
        rows.push(report::row(json!({
            "bounces": bounces,
            "taps": (1..=bounces).map(|b| if b == 1 { options.taps } else { LATER_TAPS }.to_string())
                .collect::<Vec<_>>().join("/"),
            "reflective_pixels": seen.pixels.len(),
            "points": found.points.len(),
            "shades": reflected.shades,
            "maps_ms": ms("density") + ms("points") + ms("splat"),
            "request_ms": ms("request"),
            "shade_ms": ms("shade"),
            "mirror_ms": ms("mirror"),
            "flip_reflective": errors.flip_reflective,
            "rmse": errors.rmse,
            "paper_deferred_ms": PAPER_MS[bounces as usize - 1],
        })));
        progress.inc(1);
    }
    Ok(rows)
}

/// A scene with two mirroring cylinders side by side, where a ball would stand, and a camera in front of both.
fn two_cylinders(spec: &str) -> Result<(Stage, Camera)> {
    let balls = Stage::open(spec, PLACES)?;
    let distant = balls.camera(super::stage::Pose::Distant)?;
    let (index, center, radius) = balls.nearest(&distant).context("there is no place for cylinders")?;
    let mut scene = Scene::clone(&balls.scene);
    let material = scene.meshes[scene.instances[index as usize].mesh as usize].material;
    let own = scene.instances.len() - PLACES as usize;
    scene.instances.truncate(own);
    let mesh = scene.meshes.len() as u32;
    let [around, half, aside] = CYLINDER.map(|share| share * radius);
    scene.meshes.push(cylinder(material, around, half));
    let mut back = distant.eye - center;
    back.y = 0.0;
    let back = back.normalize_or(DVec3::Z);
    let right = DVec3::Y.cross(back);
    for side in [-aside, aside] {
        let world_from_mesh = DAffine3::from_translation(center + right * side);
        scene.instances.push(Instance { mesh, node: None, world_from_mesh });
    }
    let scene = Arc::new(scene);
    let camera = Camera { eye: center + back * EYE * radius, target: center, ..distant };
    camera.validate().map_err(anyhow::Error::from)?;
    let instances = vec![own as u32, own as u32 + 1];
    Ok((Stage::of(scene, instances), camera))
}

/// An upright cylinder with caps about the origin; radius and half the height in metres.
fn cylinder(material: u32, radius: f64, half: f64) -> Mesh {
    let mut mesh = Mesh { name: "cylinder".to_owned(), material, ..Mesh::default() };
    let direction = |i: u32| {
        let turn = f64::from(i % AROUND) / f64::from(AROUND) * std::f64::consts::TAU;
        DVec3::new(turn.cos(), 0.0, -turn.sin())
    };
    let mut push = |at: DVec3, normal: DVec3| {
        mesh.positions.push(at.as_vec3());
        mesh.normals.push(normal.as_vec3());
    };
    for i in 0..AROUND {
        let (a, b) = (direction(i), direction(i + 1));
        let y = DVec3::Y * half;
        for (normal, end) in [(a, -y), (b, -y), (b, y), (a, y)] {
            push(normal * radius + end, normal);
        }
        for sign in [1.0, -1.0] {
            push(y * sign, DVec3::Y * sign);
            let ends = if sign > 0.0 { [a, b] } else { [b, a] };
            ends.iter().for_each(|end| push(*end * radius + y * sign, DVec3::Y * sign));
        }
    }
    for i in 0..AROUND {
        let first = 10 * i;
        mesh.indices.extend([0, 1, 2, 0, 2, 3, 4, 5, 6, 7, 8, 9].map(|corner| first + corner));
    }
    mesh
}

/// The points of a scene as surfaces that reflect.
pub(super) struct PointSurfaces<'a> {
    stage: &'a Stage,
    points: &'a PointScene,
    found: &'a EyePoints,
    /// Number of the reflector of an instance.
    reflectors: BTreeMap<u32, u32>,
}

impl<'a> PointSurfaces<'a> {
    pub(super) fn new(stage: &'a Stage, points: &'a PointScene, found: &'a EyePoints, seen: &Seen) -> Self {
        let numbers = (0u32..).zip(&seen.reflectors).map(|(number, reflector)| (reflector.instance, number));
        Self { stage, points, found, reflectors: numbers.collect() }
    }
}

impl Surfaces for PointSurfaces<'_> {
    fn diffuse(&self, id: u32) -> Vec3 {
        self.stage.shade(&self.points.shading_of_point(self.found, id))
    }

    fn mirror(&self, id: u32, sight: &Sight) -> Option<Mirror> {
        let piece = &self.found.pieces.all[self.found.point(id).piece() as usize];
        let facet = &self.points.facets()[piece.facet as usize];
        let reflector = *self.reflectors.get(&facet.instance)?;
        let directions = sight.directions.map(DVec3::normalize);
        let normal = facet.area_vector();
        let range = (facet.corners[0] - sight.from).dot(normal) / directions[0].dot(normal);
        let position = sight.from + directions[0] * range;
        let hit = Hit {
            instance: facet.instance,
            triangle: facet.primitive,
            barycentric: DVec2::from_array(facet.weights(position)),
            range,
            position,
            front: piece.side == Side::Front,
        };
        if !(range > 0.0 && range.is_finite()) {
            return None;
        }
        let [direction, right, up] = directions;
        let surface = self.stage.tracer.surface(&hit, direction, right - direction, up - direction);
        let pixel = self.stage.pixel(sight.from, &hit, &surface, directions);
        let reflectance = reflected_around(&surface, -direction.as_vec3(), Vec3::ONE);
        Some(Mirror { pixel: ReflectivePixel { reflector, ..pixel }, reflectance })
    }
}

impl Stage {
    /// Mean radiance that arrives along the reflected rays of each pixel's taps, by rays of the reference. Later bounces have
    /// one ray each.
    pub(super) fn arriving(&self, seen: &Seen, taps: &[DVec2], bounces: u32) -> Vec<Vec3> {
        let of_pixel = |pixel: &ReflectivePixel| {
            let own = seen.reflectors[pixel.reflector as usize].instance;
            let along = |&tap: &DVec2| {
                let (origin, direction) = pixel.ray(seen.eye.position, tap);
                let origin = self.off_surface(origin, pixel.normal, seen.eye.position);
                self.along(origin, direction, own, bounces)
            };
            taps.iter().map(along).sum::<Vec3>() / taps.len().max(1) as f32
        };
        seen.pixels.par_iter().map(of_pixel).collect()
    }

    fn along(&self, origin: DVec3, direction: DVec3, own: u32, bounces: u32) -> Vec3 {
        let Some(hit) = self.past(origin, direction, own) else {
            return sky_radiance(&self.scene.lighting.sky, direction.as_vec3());
        };
        let surface = self.tracer.surface(&hit, direction, DVec3::ZERO, DVec3::ZERO);
        let diffuse = diffuse_radiance(&surface, &self.scene.lighting);
        if bounces <= 1 || self.instances.binary_search(&hit.instance).is_err() {
            return diffuse;
        }
        let normal = surface.normal.as_dvec3();
        let onward = direction - 2.0 * direction.dot(normal) * normal;
        let from = self.off_surface(hit.position, normal, origin);
        let arriving = self.along(from, onward, hit.instance, bounces - 1);
        diffuse + reflected_around(&surface, -direction.as_vec3(), arriving)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::options;

    #[test]
    fn a_cylinder_is_closed_and_its_normals_point_outwards() {
        let mesh = cylinder(0, 2.0, 3.0);
        let mut sum = DVec3::ZERO;
        for corners in mesh.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
            let area = (b - a).cross(c - a);
            sum += area;
            assert!(area.dot(mesh.normals[corners[0] as usize].as_dvec3()) > 0.0);
            assert!(area.dot((a + b + c) / 3.0) > 0.0);
        }
        assert!(sum.length() < 1e-4, "{sum}");
    }

    #[test]
    fn more_bounces_show_more_and_points_follow_rays() {
        let options = Options { scene: "rooms:20".to_owned(), size: [96, 64], taps: 4, ..options(false) };
        let rows = rows(&options, &ProgressBar::hidden()).unwrap();
        let number = |row: usize, key: &str| rows[row][key].as_f64().unwrap();
        assert_eq!(rows.len(), 3);
        assert!(number(0, "shades") < number(1, "shades"));
        assert!((0..3).all(|row| number(row, "flip_reflective") < 0.3), "{rows:?}");
    }
}
