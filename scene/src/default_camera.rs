//! The viewpoint of a scene whose file recommends none: from within where the scene surrounds its middle, as a room does, else
//! from outside.
//!
//! Hollow objects surround their middle, too: the shell of a machine, a closed box with thick walls. From within they show bare
//! walls, while a furnished room shows more from within than from outside. So both viewpoints are looked at in a small image, and
//! the one with more edges is taken. Walls of a single layer, whose outside is mostly backs, are always a room.

use glam::{DVec2, DVec3, UVec2};

use crate::{Camera, Scene};

/// Size of the image by which two viewpoints are compared, pixels.
const SIZE: UVec2 = UVec2::new(64, 48);

/// Cosine of the angle from which neighbouring surfaces form an edge: 25°.
const ALIKE: f64 = 0.906;

impl Scene {
    /// A viewpoint that shows the scene. The first recommended one that has an image; else, if the scene surrounds its middle and
    /// shows more from there, one from within, along its longer side; else one from outside its extent. Without a recommended one it
    /// tests every triangle.
    pub fn default_camera(&self) -> Camera {
        if let Some(named) = self.cameras.iter().find(|named| named.camera.validate().is_ok()) {
            return named.camera;
        }
        let extent = self.extent();
        let (center, size) = (extent.center(), extent.size());
        let radius = (size.length() * 0.5).max(1e-3);
        let outside = Camera::look_at(center + DVec3::new(0.9, 0.6, 1.6).normalize() * radius * 2.7, center);
        if !self.surrounds(center) {
            return outside;
        }
        let along = if size.x >= size.z { DVec3::X * size.x } else { DVec3::Z * size.z };
        let within = Camera { fov_deg: 60.0, ..Camera::look_at(center - along * 0.3, center) };
        let from_outside = self.seen_by(&outside);
        let has_outside = 2 * from_outside.fronts > from_outside.surfaces;
        if has_outside && from_outside.edges > self.seen_by(&within).edges { outside } else { within }
    }

    /// Whether a surface that shows its front lies in each of eight level directions and below a point, as in a room or a
    /// courtyard; within a closed solid or below a terrain it would be a back.
    fn surrounds(&self, point: DVec3) -> bool {
        let turn = |i: u32| f64::from(i) * std::f64::consts::FRAC_PI_4 + 0.1;
        let level = (0..8).map(|i| DVec3::new(turn(i).cos(), 0.0, turn(i).sin()));
        let ways: Vec<DVec3> = level.chain([DVec3::new(0.01, -1.0, 0.02)]).collect();
        // Distance of the nearest surface, and whether it shows its front.
        let mut nearest = vec![(f64::INFINITY, false); ways.len()];
        self.each_about(point, |surface| {
            for (way, nearest) in ways.iter().zip(&mut nearest) {
                let Some((distance, is_front)) = surface.met(*way) else { continue };
                if (is_front || surface.shows_backs) && distance < nearest.0 {
                    *nearest = (distance, is_front);
                }
            }
        });
        nearest.into_iter().all(|(_, is_front)| is_front)
    }

    /// What a small image shows, backs included.
    fn seen_by(&self, camera: &Camera) -> Seen {
        let nothing = Pixel { distance: f64::INFINITY, normal: DVec3::ZERO, is_front: false, material: None };
        let mut image = vec![nothing; (SIZE.x * SIZE.y) as usize];
        let (view_from_world, half) = (camera.view_from_world(), camera.tan_half_fov(SIZE.x, SIZE.y));
        let world_from_view = view_from_world.transpose();
        let scale = DVec2::new(1.0, -1.0) * 2.0 * half / SIZE.as_dvec2();
        self.each_about(camera.eye, |surface| {
            let [low, high] = surface.pixels(|corner| {
                let seen = view_from_world * corner;
                (seen.z < 0.0).then(|| seen.truncate() / -seen.z / scale + 0.5 * SIZE.as_dvec2())
            });
            for (x, y) in (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (x, y))) {
                let at = (UVec2::new(x, y).as_dvec2() + 0.5 - 0.5 * SIZE.as_dvec2()) * scale;
                let Some((distance, is_front)) = surface.met(world_from_view * at.extend(-1.0)) else {
                    continue;
                };
                let pixel = &mut image[(y * SIZE.x + x) as usize];
                if distance < pixel.distance {
                    let normal = surface.normal * if is_front { 1.0 } else { -1.0 };
                    *pixel = Pixel { distance, normal, is_front, material: Some(surface.material) };
                }
            }
        });
        let width = SIZE.x as usize;
        let beside = (0..image.len()).filter(|at| (at + 1) % width > 0).map(|at| (at, at + 1));
        let below = (width..image.len()).map(|at| (at - width, at));
        Seen {
            edges: beside.chain(below).filter(|&(a, b)| image[a].has_edge_to(&image[b])).count(),
            surfaces: image.iter().filter(|pixel| pixel.material.is_some()).count(),
            fronts: image.iter().filter(|pixel| pixel.is_front).count(),
        }
    }

    /// Calls for each triangle, about a point. Backdrops, such as sky domes, are left out.
    fn each_about(&self, point: DVec3, mut call: impl FnMut(&Surface)) {
        for instance in &self.instances {
            let mesh = &self.meshes[instance.mesh as usize];
            let material = self.materials.get(mesh.material as usize);
            if material.is_some_and(|material| material.backdrop) {
                continue;
            }
            let is_mirrored = instance.world_from_mesh.matrix3.determinant() < 0.0;
            let at = |i: u32| {
                instance.world_from_mesh.transform_point3(mesh.origin + mesh.positions[i as usize].as_dvec3())
            };
            for triangle in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [at(triangle[0]) - point, at(triangle[1]) - point, at(triangle[2]) - point];
                let (b, c) = if is_mirrored { (c, b) } else { (b, c) };
                call(&Surface {
                    corners: [a, b, c],
                    normal: (b - a).cross(c - a).normalize_or_zero(),
                    material: mesh.material,
                    shows_backs: material.is_none_or(|material| material.double_sided),
                });
            }
        }
    }
}

/// What a pixel shows.
#[derive(Clone, Copy)]
struct Pixel {
    distance: f64,
    /// Unit normal towards the camera.
    normal: DVec3,
    is_front: bool,
    /// `None` where there is no surface.
    material: Option<u32>,
}

impl Pixel {
    /// Whether it shows a surface of another material or direction than a neighbour, or only one of them shows a surface.
    fn has_edge_to(&self, other: &Self) -> bool {
        self.material != other.material || self.material.is_some() && self.normal.dot(other.normal) < ALIKE
    }
}

/// What an image shows.
struct Seen {
    /// Pairs of neighbouring pixels with an edge between them.
    edges: usize,
    /// Pixels with a surface.
    surfaces: usize,
    /// Pixels with the front of one.
    fronts: usize,
}

/// A triangle about a point that it is seen from.
struct Surface {
    corners: [DVec3; 3],
    /// Unit normal of its front, or zero.
    normal: DVec3,
    material: u32,
    /// Whether its back is seen.
    shows_backs: bool,
}

impl Surface {
    /// Where a ray from the point meets it, in units of the ray's direction, and whether at its front: then the signed
    /// volumes of its edges with the direction are positive.
    fn met(&self, direction: DVec3) -> Option<(f64, bool)> {
        let [a, b, c] = self.corners;
        let [u, v, w] = [direction.dot(b.cross(a)), direction.dot(c.cross(b)), direction.dot(a.cross(c))];
        let is_front = u >= 0.0 && v >= 0.0 && w >= 0.0;
        if !(is_front || u <= 0.0 && v <= 0.0 && w <= 0.0) {
            return None;
        }
        let volume = u + v + w;
        let distance = direction.dot(a * v + b * w + c * u) / (volume * direction.length_squared());
        (distance > 0.0).then_some((distance, is_front))
    }

    /// The pixels that it may cover, from the first to before the second: all of them if only some of its corners lie ahead of the
    /// camera, and none if none does.
    fn pixels(&self, pixel: impl Fn(DVec3) -> Option<DVec2>) -> [UVec2; 2] {
        let corners = self.corners.map(pixel);
        let [Some(a), Some(b), Some(c)] = corners else {
            let is_ahead = corners.iter().any(Option::is_some);
            return [UVec2::ZERO, if is_ahead { SIZE } else { UVec2::ZERO }];
        };
        // The conversion to unsigned numbers takes what is left of the image or above it to its border.
        [a.min(b).min(c).floor().as_uvec2().min(SIZE), a.max(b).max(c).ceil().as_uvec2().min(SIZE)]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, Vec3};

    use super::*;
    use crate::{Instance, Mesh};

    /// A box seen from within, its top open, scaled to `size`.
    fn courtyard(size: DVec3) -> Scene {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
        let quads = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1]];
        let mesh = Mesh {
            positions: (0..8).map(corner).collect(),
            normals: vec![Vec3::Y; 8],
            indices: quads.iter().flat_map(|q| [q[0], q[1], q[2], q[0], q[2], q[3]]).collect(),
            ..Mesh::default()
        };
        Scene {
            meshes: vec![mesh],
            instances: vec![Instance { mesh: 0, node: None, world_from_mesh: DAffine3::from_scale(size) }],
            ..Scene::default()
        }
    }

    #[test]
    fn a_courtyards_default_view_is_from_within_along_its_longer_side() {
        let camera = courtyard(DVec3::new(4.0, 3.0, 20.0)).default_camera();
        camera.validate().unwrap();
        assert_eq!(camera.eye, DVec3::new(2.0, 1.5, 4.0));
        assert_eq!(camera.target, DVec3::new(2.0, 1.5, 10.0));
    }

    #[test]
    fn the_default_view_of_a_closed_solid_is_from_outside() {
        let mut scene = courtyard(DVec3::ONE);
        for triangle in scene.meshes[0].indices.chunks_exact_mut(3) {
            triangle.swap(1, 2);
        }
        let mut within = courtyard(DVec3::ONE);
        // A mirroring transform leaves fronts where they are.
        for scale in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0)] {
            for scene in [&mut scene, &mut within] {
                scene.instances[0].world_from_mesh = DAffine3::from_scale(scale);
            }
            assert!(!scene.bounds().contains(scene.default_camera().eye), "{scale}");
            assert!(within.bounds().contains(within.default_camera().eye), "{scale}");
        }
    }

    #[test]
    fn the_default_view_of_a_scene_with_an_open_side_is_from_outside() {
        let mut scene = courtyard(DVec3::ONE);
        scene.meshes[0].indices.drain(..6);
        let camera = scene.default_camera();
        assert!(!scene.bounds().contains(camera.eye));
        scene.meshes[0].indices.clear();
        scene.default_camera().validate().unwrap();
    }

    #[test]
    fn a_hollow_object_is_shown_from_outside_and_a_furnished_room_from_within() {
        // A wall with a thickness, and small boxes on its outside or within.
        let mut shell = courtyard(DVec3::ONE);
        let mut solid = shell.meshes[0].clone();
        solid.indices.chunks_exact_mut(3).for_each(|triangle| triangle.swap(1, 2));
        shell.meshes.push(solid);
        let solid_at = |low: DVec3, size: f64| Instance {
            mesh: 1,
            node: None,
            world_from_mesh: DAffine3::from_translation(low) * DAffine3::from_scale(DVec3::splat(size)),
        };
        shell.instances.push(solid_at(DVec3::splat(-0.05), 1.1));
        let boxes = |front: f64| {
            (0..49).map(move |i| {
                solid_at(DVec3::new(f64::from(i % 7), f64::from(i / 7), front) / 7.0 + 0.03, 0.07)
            })
        };
        for (front, is_within) in [(7.3, false), (6.3, true)] {
            let mut scene = shell.clone();
            scene.instances.extend(boxes(front));
            assert!(scene.surrounds(scene.extent().center()));
            let camera = scene.default_camera();
            assert_eq!(scene.bounds().contains(camera.eye), is_within, "boxes at {front} of 7");
        }
    }
}
