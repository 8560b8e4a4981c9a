//! A room of mirroring objects, after ManyLoDs' figure 3: chrome, brushed metal and glass balls that rise and sink
//! between coloured walls.

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3, Vec3, Vec4};

use super::noise::Random;
use super::shapes::{ball, quad};
use crate::animation::{Animation, Channel, Interpolation, Node, Parts, Rest, Track};
use crate::scene::{Instance, NamedCamera};
use crate::{Camera, Light, Lighting, Material, Mesh, Scene, SceneHash, Sky};

/// Allowed numbers of balls of [`mirrors`].
pub const MIRRORS: RangeInclusive<u32> = 1..=1000;
/// Default number of balls.
pub const DEFAULT_MIRRORS: u32 = 60;
/// Part of the scene's hash; raise it with every change of geometry, colour, lighting or cameras.
const MIRRORS_VERSION: u32 = 1;

/// Size of the room, metres, from the middle of its floor.
const ROOM: DVec3 = DVec3::new(8.0, 5.0, 8.0);
/// Squares on the edge of a ball's six faces.
const FACE_CELLS: u32 = 8;
/// Seconds from a ball's lowest place to its highest and back.
const PERIOD_SECS: f32 = 6.0;
/// Height of a ball's rise, in radii.
const RISE: f64 = 0.8;

/// Indices of the reflecting materials; the walls' come first.
const CHROME: u32 = 5;
const BRUSHED: u32 = 6;
const GLASS: u32 = 7;

/// A room with `balls` balls, clamped to [`MIRRORS`]. Uses no operation that differs between machines.
pub fn mirrors(balls: u32) -> Scene {
    let balls = balls.clamp(*MIRRORS.start(), *MIRRORS.end());
    let name = format!("mirrors:{balls}");
    let mut meshes: Vec<Mesh> = walls().into_iter().chain(pillars()).collect();
    let mut instances: Vec<Instance> = (0..meshes.len() as u32)
        .map(|mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY })
        .collect();
    let first_ball = meshes.len() as u32;
    meshes.extend(
        [("chrome", CHROME), ("brushed", BRUSHED), ("glass", GLASS)]
            .map(|(name, m)| ball(name, m, FACE_CELLS)),
    );

    // A lattice with at least as many cells as balls, in the middle of the room.
    let side = (1u32..).find(|side| side.pow(3) >= balls).unwrap_or(10);
    let spacing = DVec3::new(6.0, 3.4, 6.0) / f64::from(side);
    let radius = 0.34 * spacing.min_element();
    let mut random = Random::new(u64::from(balls));
    let mut nodes = Vec::new();
    let mut channels = Vec::new();
    for number in 0..balls {
        // Cells at even steps, so that any number of balls fills the room.
        let cell = number * side.pow(3) / balls;
        let at =
            DVec3::new(f64::from(cell % side), f64::from(cell / side % side), f64::from(cell / side.pow(2)));
        let jitter = DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
        let middle = (at + 0.5 + 0.25 * jitter) * spacing - DVec3::new(3.0, -0.7, 3.0);
        let parts = Parts { translation: middle, scale: DVec3::splat(radius), ..Parts::default() };
        nodes.push(Node { name: String::new(), parent: None, rest: Rest::Parts(parts), lights: Vec::new() });
        let rise = (DVec3::Y * (RISE * radius)).as_vec3();
        let (low, high) = (middle.as_vec3(), middle.as_vec3() + rise);
        // Half of the balls sink while the rest rise.
        let [from, to] = if number % 2 == 0 { [low, high] } else { [high, low] };
        channels.push(Channel {
            node: number,
            times_secs: vec![0.0, 0.5 * PERIOD_SECS, PERIOD_SECS],
            track: Track::Translation(vec![from, to, from]),
            interpolation: Interpolation::Linear,
        });
        instances.push(Instance {
            mesh: first_ball + number % 3,
            node: Some(number),
            world_from_mesh: DAffine3::from_translation(from.as_dvec3())
                * DAffine3::from_scale(DVec3::splat(radius)),
        });
    }
    Scene {
        hash: SceneHash(*blake3::hash(format!("{name} version {MIRRORS_VERSION}").as_bytes()).as_bytes()),
        name,
        meshes,
        instances,
        materials: materials(),
        nodes,
        animations: vec![Animation { name: "rise and sink".to_owned(), channels }],
        lighting: lighting(),
        cameras: cameras(),
        ..Scene::default()
    }
}

fn materials() -> Vec<Material> {
    let matt = |name: &str, color: Vec3| Material {
        name: name.to_owned(),
        base_color: color.extend(1.0),
        ..Material::default()
    };
    let metal =
        |name: &str, color: Vec3, roughness| Material { metallic: 1.0, roughness, ..matt(name, color) };
    vec![
        matt("white", Vec3::splat(0.75)),
        matt("red", Vec3::new(0.65, 0.08, 0.06)),
        matt("green", Vec3::new(0.12, 0.5, 0.12)),
        matt("blue", Vec3::new(0.1, 0.18, 0.6)),
        matt("yellow", Vec3::new(0.7, 0.55, 0.08)),
        metal("chrome", Vec3::splat(0.9), 0.03),
        metal("brushed", Vec3::new(0.9, 0.7, 0.45), 0.3),
        Material {
            transmission: 0.95,
            roughness: 0.02,
            base_color: Vec4::new(0.9, 0.95, 0.95, 1.0),
            ..matt("glass", Vec3::ONE)
        },
    ]
}

fn lighting() -> Lighting {
    let lamp = |x: f64, z: f64| Light::Point {
        position: DVec3::new(x, ROOM.y - 0.4, z),
        intensity: Vec3::new(8.0, 7.6, 7.0),
        range: None,
        radius: 0.0,
    };
    let dim = Vec3::splat(0.25);
    Lighting {
        lights: vec![lamp(-2.0, -2.0), lamp(2.0, 2.0)],
        sky: Sky { zenith: dim, horizon: dim, ground: dim, map: None, reach: None },
        exposure: 1.0,
    }
}

fn cameras() -> Vec<NamedCamera> {
    let camera = |name: &str, eye: DVec3, target: DVec3| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) },
    };
    vec![
        camera("door", DVec3::new(0.0, 2.4, 3.8), DVec3::new(0.0, 2.2, 0.0)),
        camera("corner", DVec3::new(2.9, 4.2, 3.4), DVec3::new(0.0, 2.0, 0.0)),
        camera("floor", DVec3::new(-3.4, 0.5, 3.0), DVec3::new(0.5, 2.4, -0.5)),
    ]
}

/// The room's inside: floor, ceiling and back wall are white, the other walls coloured.
fn walls() -> Vec<Mesh> {
    let (half, middle) = (ROOM * 0.5, DVec3::Y * (ROOM.y * 0.5));
    let (x, y, z) = (DVec3::X * half.x, DVec3::Y * half.y, DVec3::Z * half.z);
    let wall = |name: &str, material, sides: &[[DVec3; 3]]| {
        let mut mesh = Mesh { name: name.to_owned(), material, ..Mesh::default() };
        sides.iter().for_each(|&[middle, right, up]| quad(&mut mesh, middle, right, up));
        mesh
    };
    vec![
        wall("floor, ceiling and back", 0, &[[middle - y, z, x], [middle + y, x, z], [middle - z, x, y]]),
        wall("left", 1, &[[middle - x, -z, y]]),
        wall("right", 2, &[[middle + x, z, y]]),
        wall("front", 3, &[[middle + z, -x, y]]),
    ]
}

/// Four pillars in the corners: something more for the balls to mirror.
fn pillars() -> Vec<Mesh> {
    let mut mesh = Mesh { name: "pillars".to_owned(), material: 4, ..Mesh::default() };
    let (half, up) = (0.25, DVec3::Y * (ROOM.y * 0.5));
    for (sign_x, sign_z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let middle = DVec3::new(sign_x * 3.5, ROOM.y * 0.5, sign_z * 3.5);
        for normal in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            quad(&mut mesh, middle + normal * half, DVec3::Y.cross(normal) * half, up);
        }
    }
    vec![mesh]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_balls_and_only_balls_are_reflectors_and_stay_within_the_room() {
        for balls in [1, 7, 60, 400] {
            let scene = mirrors(balls);
            assert_eq!(scene.reflectors(1024).len(), balls as usize);
            for pose in [scene.at(0.0), scene.at(2.0), scene.at(4.5)] {
                for index in scene.reflectors(1024) {
                    let found = scene.reflector(index, &pose.instances[index as usize]).unwrap();
                    let reach = found.radius / 3f64.sqrt();
                    let (least, most) = (found.center - reach, found.center + reach);
                    assert!(least.y > 0.0 && most.y < ROOM.y, "{found:?}");
                    assert!(most.x.abs().max(least.x.abs()) < 0.5 * ROOM.x, "{found:?}");
                }
            }
            assert!(scene.is_animated());
        }
        assert_ne!(mirrors(60).hash, mirrors(61).hash);
    }

    #[test]
    fn surfaces_face_the_room_and_balls_face_outwards() {
        let scene = mirrors(3);
        for mesh in &scene.meshes {
            for corners in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                let facing = (b - a).cross(c - a).normalize();
                let normal = mesh.normals[corners[0] as usize];
                assert!(facing.dot(normal) > 0.9, "{}", mesh.name);
            }
        }
        let walls = &scene.meshes[0..4];
        let middle = Vec3::new(0.0, 2.5, 0.0);
        let inward = |(p, n): (&Vec3, &Vec3)| (middle - *p).dot(*n) > 0.0;
        assert!(walls.iter().all(|wall| wall.positions.iter().zip(&wall.normals).all(inward)));
    }

    #[test]
    fn instances_lie_at_the_animations_first_pose() {
        let scene = mirrors(5);
        for (posed, placed) in scene.at(0.0).instances.iter().zip(&scene.instances) {
            assert!(posed.world_from_mesh.abs_diff_eq(placed.world_from_mesh, 1e-6));
        }
    }
}
