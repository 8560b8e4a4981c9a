//! Scenes of the study: those of [`argus_scene::open`], and two that call for few effects.

use std::sync::Arc;

use anyhow::Result;
use argus_scene::procedural::{cuboid, quad};
use argus_scene::scene::{Instance, NamedCamera};
use argus_scene::{Camera, Light, Lighting, Material, Mesh, Scene, SceneHash, Sky};
use glam::{DAffine3, DVec3, Vec3};

/// `matt`, `room`, or a scene as [`argus_scene::open`] takes it.
///
/// # Errors
/// The errors of [`argus_scene::open`].
pub(super) fn open(spec: &str) -> Result<Arc<Scene>> {
    Ok(Arc::new(match spec {
        "matt" => matt(),
        "room" => room(),
        _ => argus_scene::open(spec)?,
    }))
}

/// A matt ball under sun and sky: nothing blocks any light.
pub(super) fn matt() -> Scene {
    let ball = convex_ball(24);
    let camera = |name: &str, eye: DVec3| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg: 50.0, ..Camera::look_at(eye, DVec3::ZERO) },
    };
    let cameras = vec![
        camera("bright", DVec3::new(0.9, 1.4, 1.2)),
        camera("evening", DVec3::new(-1.8, 0.4, 0.6)),
        camera("dark", DVec3::new(-0.8, -1.5, -1.2)),
    ];
    scene("matt", vec![ball], vec![matt_material("white", 0.7)], Lighting::default(), cameras)
}

/// A closed room at night, with a lamp and two boxes. Moon and sky shine outside, too weakly to be seen.
pub(super) fn room() -> Scene {
    let white = matt_material("white", 0.75);
    let red = Material { base_color: Vec3::new(0.6, 0.1, 0.1).extend(1.0), ..matt_material("red", 0.5) };
    let lamp = Material { emissive: Vec3::new(9.0, 8.0, 6.5), ..matt_material("lamp", 0.5) };
    let mut walls = Mesh { name: "walls".to_owned(), material: 0, ..Mesh::default() };
    // Seen from inside.
    cuboid(&mut walls, DVec3::new(2.0, 2.6, 2.0), DVec3::new(-2.0, 0.0, -2.0));
    let mut boxes = Mesh { name: "boxes".to_owned(), material: 1, ..Mesh::default() };
    cuboid(&mut boxes, DVec3::new(-1.1, 0.05, -1.0), DVec3::new(-0.3, 0.85, -0.2));
    cuboid(&mut boxes, DVec3::new(0.5, 0.05, -1.4), DVec3::new(1.1, 1.45, -0.4));
    let mut panel = Mesh { name: "lamp".to_owned(), material: 2, ..Mesh::default() };
    quad(&mut panel, DVec3::new(0.0, 2.5, 0.0), DVec3::X * 0.4, DVec3::Z * 0.4);
    let moon = Light::Directional {
        direction: DVec3::new(-0.3, -0.9, 0.2).normalize(),
        irradiance: Vec3::splat(1e-4),
        angular_radius: Light::SUN_RADIUS,
    };
    let night = Sky {
        zenith: Vec3::new(1e-5, 1.5e-5, 3e-5),
        horizon: Vec3::splat(3e-5),
        ground: Vec3::splat(1e-5),
        map: None,
        reach: None,
    };
    let lighting = Lighting { lights: vec![moon], sky: night, exposure: 1.0 };
    let camera = |name: &str, eye: DVec3, target: DVec3| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg: 70.0, ..Camera::look_at(eye, target) },
    };
    let cameras = vec![
        camera("corner", DVec3::new(1.7, 1.6, 1.7), DVec3::new(-0.3, 0.7, -0.5)),
        camera("low", DVec3::new(-1.7, 0.4, 1.5), DVec3::new(0.4, 0.8, -0.8)),
    ];
    scene("room", vec![walls, boxes, panel], vec![white, red, lamp], lighting, cameras)
}

fn scene(
    name: &str,
    meshes: Vec<Mesh>,
    materials: Vec<Material>,
    lighting: Lighting,
    cameras: Vec<NamedCamera>,
) -> Scene {
    let mut hash = [0; 32];
    hash[..name.len()].copy_from_slice(name.as_bytes());
    let place = |mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY };
    Scene {
        name: name.to_owned(),
        hash: SceneHash(hash),
        instances: (0..meshes.len() as u32).map(place).collect(),
        meshes,
        materials,
        lighting,
        cameras,
        ..Scene::default()
    }
}

/// Seen from its front alone.
fn matt_material(name: &str, grey: f32) -> Material {
    Material {
        name: name.to_owned(),
        base_color: Vec3::splat(grey).extend(1.0),
        double_sided: false,
        ..Material::default()
    }
}

/// A ball of radius one, seen from outside, in rings: [`argus_scene::procedural::ball`] bends inwards along its diagonals, so
/// that the effect plan may not assume that nothing shades it.
fn convex_ball(rings: u32) -> Mesh {
    let mut mesh = Mesh { name: "ball".to_owned(), ..Mesh::default() };
    let around = 2 * rings;
    for i in 0..=rings {
        for j in 0..=around {
            let (polar, turn) = (
                f64::from(i) / f64::from(rings) * std::f64::consts::PI,
                f64::from(j) / f64::from(around) * std::f64::consts::TAU,
            );
            let normal = DVec3::new(polar.sin() * turn.cos(), polar.cos(), -polar.sin() * turn.sin());
            mesh.positions.push(normal.as_vec3());
            mesh.normals.push(normal.as_vec3());
        }
    }
    let row = around + 1;
    for (i, j) in (0..rings).flat_map(|i| (0..around).map(move |j| (i, j))) {
        let (a, b) = (i * row + j, (i + 1) * row + j);
        mesh.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use argus_scene::effects::EffectKind;
    use argus_scene::{EffectPlan, EffectRequest, Effects, Indirect, LightEffects};

    use super::*;

    fn auto(scene: &Scene) -> EffectPlan {
        let request = EffectRequest {
            effects: Effects::Auto,
            indirect: Some(Indirect::Off),
            ..EffectRequest::default()
        };
        EffectPlan::of(scene, &request, None)
    }

    #[test]
    fn the_ball_calls_for_no_effect_and_the_room_for_its_lamp_alone() {
        assert_eq!(auto(&matt()).light_effects(), LightEffects::NONE);
        let room = auto(&room());
        assert_eq!(room.light_effects(), LightEffects { emitters: true, ..LightEffects::NONE });
        let bound = |effect| room.row(effect).unwrap().bound;
        assert!(bound(EffectKind::SkyVisibility) > 0.0 && bound(EffectKind::Shadows) > 0.0);
    }

    #[test]
    fn fronts_are_seen_from_the_cameras() {
        for scene in [matt(), room()] {
            for mesh in &scene.meshes {
                for corners in mesh.indices.as_chunks::<3>().0 {
                    let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                    let normals: Vec3 = corners.iter().map(|i| mesh.normals[*i as usize]).sum();
                    let front = (b - a).cross(c - a);
                    // Triangles at a pole are lines.
                    assert!(
                        front.length() < 1e-6 || front.dot(normals) > 0.0,
                        "{}: {}",
                        scene.name,
                        mesh.name
                    );
                }
            }
        }
        let (ball, room) = (matt(), room());
        let first = |mesh: &Mesh| (mesh.positions[0], mesh.normals[0]);
        let (at, normal) = first(&ball.meshes[0]);
        assert!(at.dot(normal) > 0.0);
        let (at, normal) = first(&room.meshes[0]);
        assert!((at - Vec3::Y * 1.3).dot(normal) < 0.0, "walls face inwards");
        assert_eq!(first(&room.meshes[2]).1, Vec3::NEG_Y, "the lamp shines down");
    }
}
