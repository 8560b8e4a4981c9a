//! Where a scene is looked at from when its light is metered: its cameras; else the inside of a room, if the default view is
//! from inside; else all around it.

use argus_scene::light_sampling::r2;
use argus_scene::{Bounds, Camera, Scene};
use glam::{DVec2, DVec3};

use crate::packets::PacketTracer;
use crate::radiosity::surfaces::Surfaces;

/// Rays of sight from inside or by cameras, about; from around a scene, where many miss it, twice as many.
const RAYS: u32 = 4096;
/// Cameras of the scene that look, at most.
const MOST_CAMERAS: usize = 16;
/// Viewers in a room, at most.
const MOST_INSIDE: usize = 8;
/// Points by which the extent of a scene is found: so many by area, and so many by number of triangles.
const POINTS: u32 = 2048;
/// Share of those points that a scene loses at most where they lie far from the rest, and how far: in extents of the rest.
const STRAY: f64 = 0.1;
const FAR: f64 = 3.0;
/// Share of the rays from inside of a shell of double-sided triangles that meet something behind it, if it is a room.
const FURNISHED: f64 = 0.35;

/// A ray of sight: an eye and a direction.
pub(super) type Sight = (DVec3, DVec3);

/// The box around a scene's surfaces, but for stray ones far away from all others. Backdrops do not count.
pub(super) fn extent(surfaces: &Surfaces) -> Bounds {
    let scene = surfaces.scene();
    let triangles = || {
        let seen = surfaces.placements().filter(|placement| {
            !scene.materials[scene.meshes[placement.mesh as usize].material as usize].backdrop
        });
        let corners = seen.flat_map(|placement| placement.triangles(&scene.meshes[placement.mesh as usize]));
        corners.filter(|corners| corners.iter().all(|corner| corner.is_finite()))
    };
    let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length() * 0.5;
    let (count, whole) = triangles().fold((0u64, 0.0), |(n, sum), corners| (n + 1, sum + area(corners)));
    let mut points: Vec<DVec3> = Vec::with_capacity(2 * POINTS as usize);
    let (mut by_area, mut by_number) = (0, 0);
    let place = |of: u32| (f64::from(of) + 0.5) / f64::from(POINTS);
    let mut area_so_far = 0.0;
    for (number, corners) in (1u64..).zip(triangles()) {
        let [a, b, c] = corners;
        let mut take = |index: u32| {
            let square = r2(index + 1);
            let root = square.x.sqrt();
            points.push(a + (b - a) * (root * (1.0 - square.y)) + (c - a) * (root * square.y));
        };
        area_so_far += area(corners);
        while by_area < POINTS && place(by_area) * whole <= area_so_far {
            take(by_area);
            by_area += 1;
        }
        while by_number < POINTS && place(by_number) * count as f64 <= number as f64 {
            take(by_number);
            by_number += 1;
        }
    }
    let least = (points.len() as f64 * (1.0 - STRAY)) as usize;
    while let Some([axis, low, high]) = stray_side(&points, least) {
        let (low, high) = (points[low][axis], points[high][axis]);
        points.retain(|point| (low..=high).contains(&point[axis]));
    }
    let mut bounds = Bounds::EMPTY;
    points.into_iter().for_each(|point| bounds.extend(point));
    bounds
}

/// An axis along which some points lie far from the rest, and the first and last point of the rest along it.
fn stray_side(points: &[DVec3], least: usize) -> Option<[usize; 3]> {
    (0..3).find_map(|axis| {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a][axis].total_cmp(&points[b][axis]));
        let at = |place: usize| points[order[place]][axis];
        (1..order.len()).find_map(|place| {
            let gap = at(place) - at(place - 1);
            let last = order.len() - 1;
            let is_far = |from: usize, to: usize| to - from + 1 >= least && gap > FAR * (at(to) - at(from));
            let rest = match (is_far(0, place - 1), is_far(place, last)) {
                (true, _) => Some((0, place - 1)),
                (_, true) => Some((place, last)),
                _ => None,
            };
            // A point alone has no extent.
            rest.filter(|(from, to)| at(*to) > at(*from)).map(|(from, to)| [axis, order[from], order[to]])
        })
    })
}

/// Rays of sight into a scene with this extent.
pub(super) fn sights(scene: &Scene, extent: &Bounds, tracer: &PacketTracer) -> Vec<Sight> {
    let cameras: Vec<Camera> = scene.cameras.iter().map(|named| named.camera).take(MOST_CAMERAS).collect();
    let by_cameras = of_cameras(&cameras);
    if by_cameras.iter().any(|(eye, way)| tracer.nearest(*eye, *way, f64::INFINITY).is_some()) {
        return by_cameras;
    }
    // What is seen first counts as much as the rest.
    let first = scene.default_camera();
    if scene.bounds().contains(first.eye)
        && let Some(rooms) = rooms(extent, tracer)
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
fn rooms(extent: &Bounds, tracer: &PacketTracer) -> Option<Vec<DVec3>> {
    let [columns, rows, layers] = GRID;
    let places = (0..columns * rows * layers).map(|i| {
        let cell = DVec3::new(
            f64::from(i % columns),
            f64::from(i / columns % rows),
            f64::from(i / (columns * rows)),
        );
        extent.min + extent.size() * (cell + 0.5) / DVec3::new(columns.into(), rows.into(), layers.into())
    });
    let (mut found, mut behind, mut shell) = (Vec::new(), 0u32, 0u32);
    for place in places {
        let mut distances = Vec::new();
        for way in (0..DIRECTIONS).map(sphere) {
            let Some(hit) = tracer.nearest(place, way, f64::INFINITY) else { continue };
            if hit.front {
                distances.push(hit.t);
            }
            let beyond = place + way * (hit.t * (1.0 + 1e-6));
            shell += 1;
            behind += u32::from(tracer.nearest(beyond, way, f64::INFINITY).is_some());
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stray_points_are_left_out_and_halves_far_apart_are_not() {
        let mut points: Vec<DVec3> =
            (0..1000).map(|i| r2(i).extend(f64::from(i % 7)) * DVec3::new(4.0, 2.0, 0.5)).collect();
        assert_eq!(stray_side(&points, 900), None);
        points.extend((0..20).map(|i| DVec3::new(1000.0, f64::from(i), 0.0)));
        let [axis, low, high] = stray_side(&points, 900).unwrap();
        assert_eq!(axis, 0);
        assert!(points[low].x >= 0.0 && points[high].x <= 4.0);
        points.extend((0..1000).map(|i| DVec3::new(1000.0, f64::from(i) * 0.1, 0.0)));
        assert_eq!(stray_side(&points, 1800), None);
    }
}
