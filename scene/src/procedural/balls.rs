//! Mirroring balls that are added to any scene, for reflections of it (`FILE+balls:N`).
//!
//! # Where they are
//!
//! All balls of a scene have one radius. Places are tried in the order of a low-discrepancy sequence (Roberts, "The
//! Unreasonable Effectiveness of Quasirandom Sequences", 2018) that fills the scene's bounds evenly. A ball is placed where
//! - it lies within the bounds;
//! - no triangle, posed at time zero, is nearer to its middle than 1.25 radii;
//! - other balls' middles are at least 3 radii away, and the scene's viewpoints at least 4;
//! - a viewpoint of the scene sees its middle past the triangles: a ball is neither inside of a wall nor below the ground.
//!
//! If the sequence ends before all balls are placed, all start again with three quarters of the radius.

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3, Vec4};

use super::clearance::Clearance;
use super::shapes::ball;
use crate::animation::{Node, Parts, Rest};
use crate::scene::{Instance, NamedCamera};
use crate::{Bounds, Material, Scene, SceneHash};

/// Allowed numbers of balls of [`with_balls`].
pub const BALLS: RangeInclusive<u32> = 0..=2048;
/// Part of the scene's hash; raise it with every change of geometry, placement or material.
const BALLS_VERSION: u32 = 1;

/// Squares on the edge of a ball's six faces: 3072 triangles, about as many as those of the paper's balls (EPR, table 2).
const FACE_CELLS: u32 = 16;
/// The first radius, as a share of the distance between balls if they stood on a lattice.
const RADIUS: f64 = 0.09;
/// Smaller radii that are tried.
const SHRINKS: u32 = 24;

/// Adds `balls` mirroring balls, clamped to [`BALLS`], to a scene, and appends them to its name and hash. Each has a node
/// of its own, which a client can move. `None` if there is no room for them. The same scene and number give the same
/// balls on every machine.
pub fn with_balls(mut scene: Scene, balls: u32) -> Option<Scene> {
    let balls = balls.clamp(*BALLS.start(), *BALLS.end());
    let (radius, middles) = if balls == 0 { (0.0, Vec::new()) } else { places(&scene, balls)? };
    if scene.cameras.is_empty() && balls > 0 {
        // The default viewpoint depends on the triangles; balls leave it as it is.
        scene.cameras.push(NamedCamera { name: String::new(), camera: scene.default_camera() });
    }
    if balls > 0 {
        let material = scene.materials.len() as u32;
        let mesh = scene.meshes.len() as u32;
        scene.materials.push(mirror());
        scene.meshes.push(ball("ball", material, FACE_CELLS));
        for (number, middle) in middles.into_iter().enumerate() {
            let parts = Parts { translation: middle, scale: DVec3::splat(radius), ..Parts::default() };
            scene.instances.push(Instance {
                mesh,
                node: Some(scene.nodes.len() as u32),
                world_from_mesh: DAffine3::from_translation(middle)
                    * DAffine3::from_scale(DVec3::splat(radius)),
            });
            let name = format!("ball {number}");
            scene.nodes.push(Node { name, parent: None, rest: Rest::Parts(parts), lights: Vec::new() });
        }
    }
    scene.name = format!("{}+balls:{balls}", scene.name);
    let added = format!("{} balls:{balls} version {BALLS_VERSION}", scene.hash);
    scene.hash = SceneHash(*blake3::hash(added.as_bytes()).as_bytes());
    Some(scene)
}

/// A perfect mirror of nearly no colour.
fn mirror() -> Material {
    Material {
        name: "mirror".to_owned(),
        base_color: Vec4::new(0.95, 0.95, 0.95, 1.0),
        metallic: 1.0,
        roughness: 0.0,
        ..Material::default()
    }
}

/// The radius and the middles of all balls, metres; `None` if there is no room.
fn places(scene: &Scene, balls: u32) -> Option<(f64, Vec<DVec3>)> {
    let room = room(&scene.bounds());
    let pose = scene.at(0.0);
    let clearance = Clearance::new(scene, &pose.instances, room.center());
    let eyes: Vec<DVec3> = match scene.cameras.as_slice() {
        [] => vec![scene.default_camera().eye],
        cameras => cameras.iter().map(|named| named.camera.eye).collect(),
    };
    // At least a lattice of eight, so that few balls are not larger than the rooms of a building.
    let side = (2u32..).find(|side| side.pow(3) >= balls)?;
    let mut radius = RADIUS * room.size().element_sum() / 3.0 / f64::from(side);
    for _ in 0..=SHRINKS {
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let mut placed: Vec<DVec3> = Vec::new();
        for index in 1..=64 * balls + 512 {
            let middle = room.min + radius + (room.size() - 2.0 * radius) * in_sequence(index);
            let apart = |from: &[DVec3], radii: f64| {
                from.iter().all(|point| (*point - middle).length_squared() >= (radii * radius).powi(2))
            };
            let inside = room.contains(middle - radius) && room.contains(middle + radius);
            if inside
                && apart(&eyes, 4.0)
                && apart(&placed, 3.0)
                && !clearance.is_near(middle, 1.25 * radius)
                && eyes.iter().any(|&eye| !clearance.is_blocked(eye, middle))
            {
                placed.push(middle);
                if placed.len() == balls as usize {
                    return Some((radius, placed));
                }
            }
        }
        radius *= 0.75;
    }
    None
}

/// Where balls may be: the bounds of a scene, and above a flat scene a quarter of its mean edge.
fn room(bounds: &Bounds) -> Bounds {
    let least = bounds.size().element_sum() / 3.0 / 4.0;
    let top = bounds.max.y.max(bounds.min.y + least);
    Bounds { max: DVec3 { y: top, ..bounds.max }, ..*bounds }
}

/// Element `index` of a sequence that fills the unit cube evenly.
fn in_sequence(index: u32) -> DVec3 {
    // Powers of the inverse of the root of x⁴ = x + 1.
    const STEPS: DVec3 =
        DVec3::new(0.819_172_513_396_164_5, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3);
    (STEPS * f64::from(index) + 0.5).fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closest::closest_on_triangle;
    use crate::procedural::{mirrors, rooms, terrain};

    #[test]
    fn balls_are_the_same_each_time_and_every_one_is_a_reflector() {
        for balls in [1, 10, 60] {
            let [one, other] = [(); 2].map(|()| with_balls(rooms(20), balls).unwrap());
            assert_eq!(one, other);
            assert_eq!(one.reflectors(4096).len(), balls as usize);
            assert_eq!(one.name, format!("rooms:20+balls:{balls}"));
            assert_eq!(one.triangles(), rooms(20).triangles() + balls as usize * 3072);
        }
        let hashes = [0, 1, 2].map(|balls| with_balls(rooms(20), balls).unwrap().hash);
        assert!(hashes[0] != hashes[1] && hashes[1] != hashes[2] && hashes[0] != rooms(20).hash);
        assert_ne!(hashes[1], with_balls(rooms(21), 1).unwrap().hash);
    }

    #[test]
    fn no_ball_is_the_scene_under_another_name() {
        let (plain, none) = (rooms(20), with_balls(rooms(20), 0).unwrap());
        let named = Scene { name: plain.name.clone(), hash: plain.hash, ..none };
        assert_eq!(named, plain);
    }

    #[test]
    fn balls_are_clear_of_triangles_of_one_another_and_of_viewpoints() {
        for scene in [rooms(20), terrain(20_000), mirrors(7)] {
            let count = scene.instances.len();
            let found = with_balls(scene, 40).unwrap();
            let pose = found.at(0.0);
            let balls: Vec<(DVec3, f64)> = pose.instances[count..]
                .iter()
                .map(|ball| (ball.world_from_mesh.translation, ball.world_from_mesh.matrix3.x_axis.x))
                .collect();
            assert_eq!(balls.len(), 40);
            let bounds = found.bounds();
            for (number, &(middle, radius)) in balls.iter().enumerate() {
                assert!(radius > 0.0 && bounds.contains(middle), "{middle} {radius}");
                let apart = |point: DVec3| (point - middle).length() / radius;
                assert!(balls[..number].iter().all(|(other, _)| apart(*other) > 2.99));
                assert!(found.cameras.iter().all(|named| apart(named.camera.eye) > 3.99));
                for instance in &pose.instances[..count] {
                    let mesh = &found.meshes[instance.mesh as usize];
                    for corners in mesh.indices.as_chunks::<3>().0 {
                        let corners = corners.map(|i| {
                            let position = mesh.positions[i as usize].as_dvec3();
                            instance.world_from_mesh.transform_point3(mesh.origin + position)
                        });
                        assert!(apart(closest_on_triangle(middle, corners)) > 1.249, "{}", found.name);
                    }
                }
            }
        }
    }

    #[test]
    fn the_default_viewpoint_stays_where_it_was() {
        let mut scene = rooms(20);
        scene.cameras.clear();
        let before = scene.default_camera();
        assert_eq!(with_balls(scene, 30).unwrap().default_camera(), before);
    }

    #[test]
    fn a_scene_without_triangles_has_no_room() {
        let empty = Scene { instances: Vec::new(), cameras: Vec::new(), ..rooms(20) };
        assert!(with_balls(empty.clone(), 0).is_some());
        assert_eq!(with_balls(empty, 1), None);
    }
}
