//! Three rooms with thin walls between them, where light that leaks shows.
//!
//! From left to right: a room that is lit by a lamp, a window and the sun in it; a sealed room that no light reaches; behind
//! both, a room that light reaches only through a door from the lit one.

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3, Vec3};

use super::shapes::{cuboid, quad};
use crate::scene::{Instance, NamedCamera};
use crate::{Camera, Material, Mesh, Scene, SceneHash};

/// Allowed thickness of the walls of [`rooms`], millimetres.
pub const ROOMS_WALL_MM: RangeInclusive<u32> = 1..=500;
/// Default thickness of the walls, millimetres.
pub const DEFAULT_ROOMS_WALL_MM: u32 = 20;
/// Part of the scene's hash; raise it with every change of geometry, colour, lighting or cameras.
const ROOMS_VERSION: u32 = 1;

/// Width (x) and depth (z) of each front room, metres; the back room is as wide as both.
const SIDE: f64 = 4.0;
/// Height of the rooms, metres.
const HEIGHT: f64 = 2.6;

const WHITE: u32 = 0;
const RED: u32 = 1;
const LAMP: u32 = 2;

/// Three rooms whose walls are `wall_mm` millimetres thick, clamped to [`ROOMS_WALL_MM`].
pub fn rooms(wall_mm: u32) -> Scene {
    let wall_mm = wall_mm.clamp(*ROOMS_WALL_MM.start(), *ROOMS_WALL_MM.end());
    let name = format!("rooms:{wall_mm}");
    let thickness = f64::from(wall_mm) / 1000.0;
    let meshes = vec![walls(thickness), furniture(), lamp()];
    let instances = (0..meshes.len() as u32)
        .map(|mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY })
        .collect();
    Scene {
        hash: SceneHash(*blake3::hash(format!("{name} version {ROOMS_VERSION}").as_bytes()).as_bytes()),
        name,
        meshes,
        instances,
        materials: materials(),
        cameras: cameras(),
        ..Scene::default()
    }
}

fn materials() -> Vec<Material> {
    let matt = |name: &str, color: Vec3| Material {
        name: name.to_owned(),
        base_color: color.extend(1.0),
        // Boxes are closed, and a lamp that shines upwards would only light the ceiling.
        double_sided: false,
        ..Material::default()
    };
    vec![
        matt("white", Vec3::splat(0.75)),
        matt("red", Vec3::new(0.65, 0.08, 0.06)),
        Material { emissive: Vec3::new(9.0, 8.0, 6.5), ..matt("lamp", Vec3::splat(0.5)) },
    ]
}

fn cameras() -> Vec<NamedCamera> {
    let camera = |name: &str, eye: DVec3, target: DVec3| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg: 65.0, ..Camera::look_at(eye, target) },
    };
    vec![
        camera("lit", DVec3::new(-3.6, 1.6, 3.6), DVec3::new(-1.0, 1.1, 0.6)),
        camera("dark", DVec3::new(3.6, 1.6, 3.6), DVec3::new(1.0, 1.1, 0.6)),
        camera("behind", DVec3::new(3.5, 1.6, -3.5), DVec3::new(-1.0, 1.1, -1.0)),
        camera("outside", DVec3::new(-9.0, 5.0, 10.0), DVec3::new(0.0, 1.0, 0.0)),
    ]
}

/// Walls, floor and roof. Parts meet without a gap and do not overlap, so that no surface is seen twice.
fn walls(t: f64) -> Mesh {
    let mut mesh = Mesh { name: "walls".to_owned(), material: WHITE, ..Mesh::default() };
    let (x, z, h) = (SIDE, SIDE, HEIGHT);
    let mut part = |min: [f64; 3], max: [f64; 3]| cuboid(&mut mesh, min.into(), max.into());
    part([-x - t, -t, -z - t], [x + t, 0.0, z + t]);
    part([-x - t, h, -z - t], [x + t, h + t, z + t]);
    // Left, with a window into the lit room, from 1.0 to 2.2 m above the floor.
    let (sill, lintel, near, far) = (1.0, 2.2, 3.2, 1.2);
    part([-x - t, 0.0, -z - t], [-x, h, far]);
    part([-x - t, 0.0, near], [-x, h, z + t]);
    part([-x - t, 0.0, far], [-x, sill, near]);
    part([-x - t, lintel, far], [-x, h, near]);
    part([x, 0.0, -z - t], [x + t, h, z + t]);
    part([-x, 0.0, z], [x, h, z + t]);
    part([-x, 0.0, -z - t], [x, h, -z]);
    // Between the two front rooms.
    let half = t * 0.5;
    part([-half, 0.0, half], [half, h, z]);
    // Between front and back, with a door from the lit room.
    let (left, right, top) = (-2.6, -1.7, 2.0);
    part([-x, 0.0, -half], [left, h, half]);
    part([right, 0.0, -half], [x, h, half]);
    part([left, top, -half], [right, h, half]);
    mesh
}

/// A box in each front room, which does not touch a wall.
fn furniture() -> Mesh {
    let mut mesh = Mesh { name: "boxes".to_owned(), material: RED, ..Mesh::default() };
    for x in [-1.0, 1.0] {
        let (min, max) = (DVec3::new(x - 0.4, 0.05, 0.8), DVec3::new(x + 0.4, 0.85, 1.6));
        cuboid(&mut mesh, min, max);
    }
    mesh
}

/// A panel below the lit room's ceiling that shines down.
fn lamp() -> Mesh {
    let mut mesh = Mesh { name: "lamp".to_owned(), material: LAMP, ..Mesh::default() };
    let middle = DVec3::new(-2.0, HEIGHT - 0.05, 2.0);
    quad(&mut mesh, middle, DVec3::X * 0.4, DVec3::Z * 0.4);
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a segment crosses a triangle of the walls.
    fn blocked(mesh: &Mesh, from: DVec3, to: DVec3) -> bool {
        mesh.indices.as_chunks::<3>().0.iter().any(|corners| {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3() - from);
            let d = to - from;
            let volumes = [d.dot(b.cross(a)), d.dot(c.cross(b)), d.dot(a.cross(c))];
            let one_side = volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0);
            let normal = (b - a).cross(c - a);
            let along = a.dot(normal) / d.dot(normal);
            one_side && (0.0..=1.0).contains(&along)
        })
    }

    #[test]
    fn the_dark_room_is_sealed_and_the_others_have_a_window_and_a_door() {
        for wall_mm in [1, DEFAULT_ROOMS_WALL_MM, 500] {
            let scene = rooms(wall_mm);
            let walls = &scene.meshes[0];
            let dark = DVec3::new(2.0, 1.3, 2.0);
            for i in 0..5000 {
                // Directions of a spiral over the sphere.
                let y = 1.0 - 2.0 * (f64::from(i) + 0.5) / 5000.0;
                let turn = f64::from(i) * 2.399_963;
                let around = (1.0 - y * y).sqrt();
                let direction = DVec3::new(around * turn.cos(), y, around * turn.sin());
                assert!(blocked(walls, dark, dark + direction * 30.0), "{wall_mm} mm: {direction}");
            }
            let lit = DVec3::new(-2.0, 1.5, 2.2);
            assert!(!blocked(walls, lit, lit - DVec3::X * 20.0), "a window");
            let door = DVec3::new(-2.1, 1.0, 1.0);
            assert!(!blocked(walls, door, door - DVec3::Z * 2.0), "a door");
            assert!(blocked(walls, lit, dark));
        }
    }

    #[test]
    fn faces_of_boxes_face_outwards_and_the_lamp_shines_down() {
        let mut mesh = Mesh::default();
        cuboid(&mut mesh, -DVec3::ONE, DVec3::ONE);
        for corners in mesh.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
        }
        assert_eq!(lamp().normals[0], Vec3::NEG_Y);
    }
}
