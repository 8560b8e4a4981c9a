//! A scene with balls, an eye, and what its pixels see.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_eye_points::{Eye, LARGEST_SIDE, ReflectivePixel, curved_reflector, planar_reflector};
use argus_sampler::plug::{MappedReflector, Side, SurfacePoint};
use argus_scene::reference::{Hit, Tracer};
use argus_scene::shading::{Surface, diffuse_radiance, reflected_around};
use argus_scene::{Camera, Instance, Scene};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Where the eye is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Pose {
    /// At the scene's first viewpoint, looking at the balls' middle.
    Distant,
    /// Three radii from the middle of the nearest ball that the distant eye sees.
    Close,
}

impl fmt::Display for Pose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Distant => "distant",
            Self::Close => "close",
        })
    }
}

/// A scene with its reflectors.
pub(super) struct Stage {
    pub(super) scene: Arc<Scene>,
    pub(super) tracer: Tracer,
    /// Seconds of scene time.
    pub(super) time_secs: f64,
    /// Instances at that time.
    placed: Vec<Instance>,
    /// Indices of instances, ascending: the added balls, or the scene's own reflectors where none are added.
    pub(super) instances: Vec<u32>,
}

/// What an eye sees of a stage.
pub(super) struct Seen {
    pub(super) eye: Eye,
    pub(super) size: [u32; 2],
    /// The reflectors of which a pixel is seen.
    pub(super) reflectors: Vec<MappedReflector>,
    /// The pixels in which one is seen.
    pub(super) pixels: Vec<ReflectivePixel>,
    /// Index in the image, surface and direction towards the eye of each of [`Self::pixels`].
    pub(super) surfaces: Vec<(usize, Surface, Vec3)>,
    /// Radiance of all pixels, black where reflectors are.
    pub(super) background: Vec<Vec3>,
}

/// Smallest distance that counts, metres.
pub(super) const NEAR: f64 = 1e-3;
/// A change from pixel to pixel is at most as large as that of a surface seen at this cosine.
const LEAST_COSINE: f64 = 0.05;

impl Stage {
    /// Opens a scene with so many balls in it.
    pub(super) fn open(spec: &str, balls: u32) -> Result<Self> {
        let scene = Arc::new(argus_scene::open(&format!("{spec}+balls:{balls}"))?);
        let own = scene.instances.len() - balls as usize;
        let mut instances = scene.reflectors(u32::MAX);
        if balls > 0 {
            instances.retain(|&instance| instance as usize >= own);
        }
        anyhow::ensure!(!instances.is_empty(), "{spec} has no reflective object: add balls by --reflectors");
        Ok(Self::of(scene, instances))
    }

    /// Opens a scene as it is, of which nothing reflects.
    pub(super) fn without_reflectors(spec: &str) -> Result<Self> {
        Ok(Self::of(Arc::new(argus_scene::open(spec)?), Vec::new()))
    }

    /// Unit normal of the plane of what a ray meets, on the side that is seen.
    pub(super) fn plane_normal(&self, hit: &Hit, direction: DVec3) -> DVec3 {
        let instance = &self.placed[hit.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let first = 3 * hit.triangle as usize;
        let corners =
            [0, 1, 2].map(|corner| mesh.positions[mesh.indices[first + corner] as usize].as_dvec3());
        let [a, b, c] = corners.map(|corner| instance.world_from_mesh.transform_vector3(corner));
        let normal = (b - a).cross(c - a).normalize_or(-direction);
        if normal.dot(direction) > 0.0 { -normal } else { normal }
    }

    /// A scene at time zero with its reflectors, ascending.
    pub(super) fn of(scene: Arc<Scene>, instances: Vec<u32>) -> Self {
        let tracer = Tracer::new(Arc::clone(&scene));
        let placed = scene.at(0.0).instances;
        Self { scene, tracer, time_secs: 0.0, placed, instances }
    }

    /// The stage at another time in seconds.
    pub(super) fn at(&self, time_secs: f64) -> Self {
        Self {
            scene: Arc::clone(&self.scene),
            tracer: self.tracer.at(time_secs),
            time_secs,
            placed: self.scene.at(time_secs).instances,
            instances: self.instances.clone(),
        }
    }

    /// The camera of a pose.
    pub(super) fn camera(&self, pose: Pose) -> Result<Camera> {
        let first = self.scene.default_camera();
        let balls = self.balls();
        let middle = balls.iter().map(|ball| ball.1).sum::<DVec3>() / balls.len().max(1) as f64;
        let distant = Camera { target: middle, fov_deg: 60.0, up: DVec3::Y, ..first };
        let distant = if distant.validate().is_ok() { distant } else { first };
        if pose == Pose::Distant {
            return Ok(distant);
        }
        let (_, center, radius) = self.nearest(&distant).context("there is no reflector")?;
        let back = (distant.eye - center).normalize_or(DVec3::Z);
        let close = Camera { eye: center + back * 3.0 * radius, target: center, ..distant };
        close.validate().map_err(anyhow::Error::from)?;
        Ok(close)
    }

    /// Instance, middle and radius of each reflector, metres; the radius is that of a ball within its box.
    pub(super) fn balls(&self) -> Vec<(u32, DVec3, f64)> {
        let of_instance = |&index: &u32| {
            let found = self.scene.reflector(index, &self.placed[index as usize])?;
            Some((index, found.center, found.radius / 3f64.sqrt()))
        };
        self.instances.iter().filter_map(of_instance).collect()
    }

    /// The reflector nearest to a camera whose middle it sees, or the nearest of all if it sees none: instance, middle and
    /// radius, metres.
    pub(super) fn nearest(&self, camera: &Camera) -> Option<(u32, DVec3, f64)> {
        let (balls, eye) = (self.balls(), camera.eye);
        let seen = |ball: &&(u32, DVec3, f64)| {
            self.tracer.trace(eye, ball.1 - eye).is_some_and(|hit| hit.instance == ball.0)
        };
        let nearer = |a: &&(u32, DVec3, f64), b: &&(u32, DVec3, f64)| {
            (a.1 - eye).length().total_cmp(&(b.1 - eye).length())
        };
        balls.iter().filter(seen).min_by(nearer).or_else(|| balls.iter().min_by(nearer)).copied()
    }

    /// What a camera sees, one ray a pixel.
    pub(super) fn see(&self, camera: &Camera, [width, height]: [u32; 2]) -> Seen {
        let eye = Eye::of(camera, width, height, NEAR);
        let of_pixel = |index: usize| {
            let middle =
                DVec2::new((index % width as usize) as f64 + 0.5, (index / width as usize) as f64 + 0.5);
            let along = |offset: DVec2| camera.direction(middle + offset, width, height);
            let [direction, right, down] = [DVec2::ZERO, DVec2::X, DVec2::Y].map(along);
            let hit = self.tracer.trace(camera.eye, direction);
            let (dx, dy) = (right - direction, down - direction);
            let reflects = hit.filter(|hit| self.instances.binary_search(&hit.instance).is_ok());
            let Some(hit) = reflects else {
                return (self.tracer.radiance_of(hit.as_ref(), direction, dx, dy), None);
            };
            let surface = self.tracer.surface(&hit, direction, dx, dy);
            let pixel = self.pixel(eye.position, &hit, &surface, [direction, right, down]);
            (Vec3::ZERO, Some((hit.instance, index, surface, -direction.as_vec3(), pixel)))
        };
        let count = width as usize * height as usize;
        let all: Vec<_> = (0..count).into_par_iter().with_min_len(256).map(of_pixel).collect();
        let mut numbers = BTreeMap::new();
        for (instance, ..) in all.iter().filter_map(|(_, found)| found.as_ref()) {
            numbers.insert(*instance, 0u32);
        }
        let mut reflectors = Vec::new();
        numbers.retain(|&instance, number| {
            *number = reflectors.len() as u32;
            let placed = &self.placed[instance as usize];
            let found = planar_reflector(&self.scene, instance, placed, &eye)
                .or_else(|| curved_reflector(&self.scene, instance, placed, &eye, LARGEST_SIDE));
            reflectors.extend(found);
            found.is_some()
        });
        let (mut pixels, mut surfaces) = (Vec::new(), Vec::new());
        for (instance, index, surface, to_eye, pixel) in all.iter().filter_map(|(_, found)| *found) {
            if let Some(&reflector) = numbers.get(&instance) {
                pixels.push(ReflectivePixel { reflector, ..pixel });
                surfaces.push((index, surface, to_eye));
            }
        }
        let background = all.into_iter().map(|(radiance, _)| radiance).collect();
        Seen { eye, size: [width, height], reflectors, pixels, surfaces, background }
    }

    /// A pixel of a reflector that is seen from a place in three directions: its own and those of its neighbours on the right
    /// and below. Positions and normals there are those of the plane of its triangle.
    pub(super) fn pixel(
        &self,
        eye: DVec3,
        hit: &Hit,
        surface: &Surface,
        [direction, right, down]: [DVec3; 3],
    ) -> ReflectivePixel {
        let instance = &self.placed[hit.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let first = 3 * hit.triangle as usize;
        let corners = [0, 1, 2].map(|corner| mesh.indices[first + corner] as usize);
        let at = |corner: usize| {
            instance.world_from_mesh.transform_point3(mesh.origin + mesh.positions[corner].as_dvec3())
        };
        let [a, b, c] = corners.map(at);
        let plane = (b - a).cross(c - a).normalize_or(-direction);
        let normals_from_mesh = instance.world_from_mesh.matrix3.inverse().transpose();
        let side = if hit.front { 1.0 } else { -1.0 };
        let normals = corners.map(|corner| {
            mesh.normals.get(corner).map_or(plane, |n| normals_from_mesh * n.as_dvec3()) * side
        });
        let normal_at = |point: DVec3| {
            let area = (b - a).cross(c - a);
            let second = (point - a).cross(c - a).dot(area) / area.length_squared();
            let third = (b - a).cross(point - a).dot(area) / area.length_squared();
            let blended = normals[0] * (1.0 - second - third) + normals[1] * second + normals[2] * third;
            blended.normalize_or(plane)
        };
        let normal = surface.normal.as_dvec3();
        let here = normal_at(hit.position);
        let steps = [right, down].map(|neighbour| {
            let t = (hit.position - eye).dot(plane) / neighbour.dot(plane);
            let step = eye + neighbour * t - hit.position;
            let most = hit.range * (neighbour - direction).length() / LEAST_COSINE;
            let step = if step.is_finite() { step.clamp_length_max(most) } else { DVec3::ZERO };
            (step, normal_at(hit.position + step) - here)
        });
        ReflectivePixel {
            reflector: 0,
            position: hit.position,
            normal,
            position_steps: steps.map(|(position, _)| position),
            normal_steps: steps.map(|(_, normal)| normal),
        }
    }

    /// Radiance of a surface in a reflection: what does not depend on the viewer.
    pub(super) fn shade(&self, at: &SurfacePoint) -> Vec3 {
        let [right, up] = at.footprint;
        let hit = Hit {
            instance: at.instance,
            triangle: at.primitive,
            barycentric: DVec2::from_array(at.weights),
            range: 1.0,
            position: at.position,
            front: at.side == Side::Front,
        };
        let direction = right.cross(up).normalize_or(DVec3::Y);
        let surface = self.tracer.surface(&hit, direction, right, up);
        diffuse_radiance(&surface, &self.scene.lighting)
    }
}

impl Seen {
    /// The image, with the radiance that arrives at each reflective pixel along its reflected rays.
    pub(super) fn image(&self, arriving: &[Vec3], exposure: f32) -> image::RgbImage {
        let mut radiance = self.background.clone();
        for ((index, surface, to_eye), arriving) in self.surfaces.iter().zip(arriving) {
            radiance[*index] = reflected_around(surface, *to_eye, *arriving);
        }
        let [width, height] = self.size;
        let bytes = radiance.iter().flat_map(|&r| argus_scene::tone::display_from_radiance(r, exposure));
        image::RgbImage::from_raw(width, height, bytes.collect())
            .unwrap_or_else(|| image::RgbImage::new(width, height))
    }

    /// Mean diameter of the seen reflectors, pixels; the height of the view for those that the eye is in.
    pub(super) fn mean_diameter(&self) -> f64 {
        let diameter = |reflector: &MappedReflector| {
            self.eye.diameter(reflector.center, reflector.radius).min(f64::from(self.eye.height))
        };
        crate::median::mean(self.reflectors.iter().map(diameter))
    }

    /// Mean side of the seen reflectors' maps, texels.
    pub(super) fn mean_side(&self) -> f64 {
        crate::median::mean(self.reflectors.iter().map(|reflector| f64::from(reflector.side)))
    }
}
