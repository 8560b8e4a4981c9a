//! Where a scene is looked at from when its light is metered: its cameras; else the inside of a room, if the default view is
//! from inside; else all around it.

use argus_scene::light_sampling::r2;
use argus_scene::{Bounds, Camera, Scene};
use glam::{DVec2, DVec3};

use crate::packets::{Hit, PacketTracer};

/// Rays of sight from inside or by cameras, about; from around a scene, where many miss it, twice as many.
const RAYS: u32 = 4096;
/// Cameras of the scene that look, at most.
const MOST_CAMERAS: usize = 16;
/// Viewers in a room, at most.
const MOST_INSIDE: usize = 8;
/// Share of the rays from inside of a shell of double-sided triangles that meet something behind it, if it is a room.
const FURNISHED: f64 = 0.35;

/// A ray of sight: an eye and a direction.
pub(super) type Sight = (DVec3, DVec3);

/// Rays of sight into a scene with this extent.
pub(super) fn sights(scene: &Scene, extent: &Bounds, tracer: &PacketTracer) -> Vec<Sight> {
    let cameras: Vec<Camera> = scene.cameras.iter().map(|named| named.camera).take(MOST_CAMERAS).collect();
    let by_cameras = of_cameras(&cameras);
    if by_cameras.iter().any(|(eye, way)| tracer.nearest(*eye, *way, f64::INFINITY).is_some()) {
        return by_cameras;
    }
    // What is seen first counts as much as the rest.
    let first = scene.default_camera();
    if extent.contains(first.eye)
        && let Some(rooms) = rooms(scene, extent, tracer)
    {
        let around = |eye: DVec3, rays: u32| (0..rays).map(move |ray| (eye, sphere(ray)));
        let each = RAYS / 2 / rooms.len().max(1) as u32;
        let rest = rooms.into_iter().flat_map(|eye| around(eye, each));
        return around(first.eye, RAYS / 2).chain(rest).collect();
    }
    let mut sights = from_around(extent);
    sights.extend(of_cameras(&[first]));
    sights
}

/// Evenly over the images of cameras.
fn of_cameras(cameras: &[Camera]) -> Vec<Sight> {
    let each = f64::from(RAYS) / cameras.len().max(1) as f64;
    let rows = (each / 1.5).sqrt().ceil().max(4.0) as u32;
    let columns = rows * 3 / 2;
    let pixels = |camera: &Camera| {
        let camera = *camera;
        (0..rows * columns).map(move |i| {
            let pixel = DVec2::new(f64::from(i % columns), f64::from(i / columns)) + 0.5;
            (camera.eye, camera.direction(pixel, columns, rows))
        })
    };
    cameras.iter().flat_map(pixels).collect()
}

/// Directions around, and rows of them from a low to a high sun's height, radians.
const AROUND: u32 = 8;
const HEIGHTS: [f64; 2] = [0.3, 0.75];

/// From all sides and from above: parallel rays over the sphere around a box.
fn from_around(extent: &Bounds) -> Vec<Sight> {
    let radius = 0.5 * extent.size().length();
    let each = RAYS / (AROUND * HEIGHTS.len() as u32);
    let views = HEIGHTS.iter().flat_map(|height| {
        (0..AROUND).map(move |turn| {
            let turn = (f64::from(turn) + 0.37 + height) / f64::from(AROUND) * std::f64::consts::TAU;
            DVec3::new(turn.cos() * height.cos(), height.sin(), turn.sin() * height.cos())
        })
    });
    let center = extent.center();
    let rays = (0u32..).zip(views).flat_map(|(view, outward)| {
        let (x, y) = outward.any_orthonormal_pair();
        (0..each).map(move |ray| {
            let disc = argus_scene::light_sampling::disc_point(r2(view * each + ray)) * radius;
            // No scene begins further out than this; other surfaces do not stand between.
            (center + outward * (1.01 * radius) + x * disc.x + y * disc.y, -outward)
        })
    });
    rays.collect()
}

/// A direction of an even sequence over the sphere.
fn sphere(index: u32) -> DVec3 {
    let square = r2(index + 1);
    let (y, turn) = (1.0 - 2.0 * square.x, square.y * std::f64::consts::TAU);
    let level = (1.0 - y * y).max(0.0).sqrt();
    DVec3::new(level * turn.cos(), y, level * turn.sin())
}

/// Places along each axis that may be in a room, and directions from each.
const GRID: [u32; 3] = [5, 3, 5];
const DIRECTIONS: u32 = 48;
/// Share of the directions in which a place in a room meets the front of something.
const ENCLOSED: f64 = 0.6;

/// Viewers in the widest places that fronts enclose; `None` if these are the inside of a solid.
fn rooms(scene: &Scene, extent: &Bounds, tracer: &PacketTracer) -> Option<Vec<DVec3>> {
    let [columns, rows, layers] = GRID;
    let places = (0..columns * rows * layers).map(|i| {
        let cell = DVec3::new(
            f64::from(i % columns),
            f64::from(i / columns % rows),
            f64::from(i / (columns * rows)),
        );
        extent.min + extent.size() * (cell + 0.5) / DVec3::new(columns.into(), rows.into(), layers.into())
    });
    // A sky dome is no wall.
    let nearest = |eye: DVec3, way: DVec3| {
        tracer.nearest(eye, way, f64::INFINITY).filter(|hit| !is_backdrop(scene, hit))
    };
    let (mut found, mut behind, mut shell) = (Vec::new(), 0u32, 0u32);
    for place in places {
        let mut distances = Vec::new();
        for way in (0..DIRECTIONS).map(sphere) {
            let Some(hit) = nearest(place, way) else { continue };
            if hit.front {
                distances.push(hit.t);
            }
            let beyond = place + way * (hit.t * (1.0 + 1e-6));
            shell += 1;
            behind += u32::from(nearest(beyond, way).is_some());
        }
        if distances.len() as f64 >= ENCLOSED * f64::from(DIRECTIONS) {
            distances.sort_by(f64::total_cmp);
            found.push((distances[distances.len() / 2], place));
        }
    }
    let is_one_sided =
        tracer.hierarchy().triangles.iter().any(|t| t.flags & crate::bvh::flags::ONE_SIDED != 0);
    if !is_one_sided && f64::from(behind) < FURNISHED * f64::from(shell) {
        return None;
    }
    found.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    found.truncate(MOST_INSIDE);
    Some(found.into_iter().map(|(_, place)| place).collect())
}

fn is_backdrop(scene: &Scene, hit: &Hit) -> bool {
    let mesh = &scene.meshes[scene.instances[hit.instance as usize].mesh as usize];
    scene.materials[mesh.material as usize].backdrop
}
