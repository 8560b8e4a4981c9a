//! Generated scenes, the same triangles on every machine.
//!
//! [`terrain`], [`mirrors`] and [`rooms`] need no file. The first follows the cluster paper (section 5): one highly tessellated
//! tree over a height-field terrain, with a lake whose look depends on the viewer. [`with_balls`] adds mirroring balls to
//! any scene.

mod balls;
mod clearance;
mod ground;
mod lake;
mod mirrors;
mod noise;
mod rooms;
mod shapes;
mod textures;
mod tree;

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3, Vec4};

use crate::scene::{Instance, NamedCamera, RigKind};
use crate::{Camera, Material, Mesh, Scene, SceneHash, TextureRef};
pub use balls::{BALLS, with_balls};
pub use mirrors::{DEFAULT_MIRRORS, MIRRORS, mirrors};
use noise::Random;
pub use rooms::{DEFAULT_ROOMS_WALL_MM, ROOMS_WALL_MM, rooms};
pub use shapes::{ball, cuboid, quad};

/// Allowed numbers of triangles of [`terrain`].
pub const TERRAIN_TRIANGLES: RangeInclusive<u64> = 2_000..=20_000_000;
/// Default number of triangles: the cluster paper's.
pub const DEFAULT_TERRAIN_TRIANGLES: u64 = 500_000;
/// Part of the scene's hash; raise it with every change of geometry, colour, lighting or cameras.
const TERRAIN_VERSION: u32 = 4;

/// Height of the tree's trunk to its tip, metres.
const TREE_HEIGHT: f64 = 28.0;

/// A valley of 200 m × 200 m with a lake, mountains along its rim and one tree, in `triangles` triangles
/// (exactly, or one fewer), clamped to [`TERRAIN_TRIANGLES`].
///
/// About two fifths of them belong to the ground, an eighth to the bark, and the rest to leaves of two triangles each.
/// Uses no operation that differs between machines, so the same number gives the same scene everywhere.
pub fn terrain(triangles: u64) -> Scene {
    let triangles = triangles.clamp(*TERRAIN_TRIANGLES.start(), *TERRAIN_TRIANGLES.end());
    let budget = triangles as usize;
    let ground_cells = ((budget as f64 * 0.19).sqrt() as usize).max(1);
    let lake_cells = ((budget as f64 * 0.02).sqrt() as usize).max(6);
    let bark_budget = budget / 8;

    let mut random = Random::new(2);
    let foot = DVec3::new(ground::TREE.x, ground::height(ground::TREE), ground::TREE.y);
    let branches = tree::grow(foot, TREE_HEIGHT, &mut random);
    let ground = ground::mesh(ground_cells, GROUND);
    let lake = lake::mesh(lake_cells, WATER);
    let bark = tree::bark_mesh(&branches, bark_budget, BARK);
    let spent = ground.triangles() + lake.triangles() + bark.triangles();
    let leaves = tree::Leaves::new(&branches, (budget - spent) / 2, &mut random);
    let leaves = tree::leaf_mesh(&leaves, &mut random, LEAVES);

    let meshes: Vec<Mesh> = vec![ground, lake, bark, leaves];
    let instances = (0..meshes.len() as u32)
        .map(|mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY })
        .collect();
    let name = format!("terrain:{triangles}");
    Scene {
        hash: SceneHash(*blake3::hash(format!("{name} version {TERRAIN_VERSION}").as_bytes()).as_bytes()),
        name,
        meshes,
        instances,
        materials: materials(),
        textures: vec![textures::ground(), textures::bark()],
        cameras: cameras(),
        rig: RigKind::TileCorners,
        ..Scene::default()
    }
}

const GROUND: u32 = 0;
const WATER: u32 = 1;
const BARK: u32 = 2;
const LEAVES: u32 = 3;

/// In the order of the constants above.
fn materials() -> Vec<Material> {
    let matt = |name: &str, texture: Option<u32>, double_sided| Material {
        name: name.to_owned(),
        base_color: Vec4::ONE,
        base_color_texture: texture.map(TextureRef::new),
        double_sided,
        ..Material::default()
    };
    vec![
        matt("ground", Some(0), false),
        lake::material(),
        matt("bark", Some(1), false),
        matt("leaves", None, true),
    ]
}

/// Viewpoints that show the scene well; the first is its default view.
///
/// All look down on the tile, as the cluster paper's views do: four samples from above its corners show the same
/// surfaces. Views from the ground need closer samples (the `Cell` rig).
fn cameras() -> Vec<NamedCamera> {
    let camera = |name: &str, eye: DVec3, target: DVec3, fov_deg: f64| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg, ..Camera::look_at(eye, target) },
    };
    let lake = ground::LAKE.0;
    vec![
        camera("valley", DVec3::new(-14.0, 72.0, 112.0), DVec3::new(4.0, 12.0, 0.0), 45.0),
        camera("overview", DVec3::new(72.0, 98.0, 104.0), DVec3::new(0.0, 8.0, -8.0), 45.0),
        camera("west", DVec3::new(-125.0, 88.0, 62.0), DVec3::new(0.0, 10.0, 0.0), 45.0),
        camera("east", DVec3::new(118.0, 80.0, 48.0), DVec3::new(6.0, 14.0, -4.0), 45.0),
        camera("glitter", DVec3::new(-58.0, 62.0, -30.0), DVec3::new(lake.x + 4.0, 0.0, lake.y + 6.0), 55.0),
        camera("map", DVec3::new(0.0, 230.0, 60.0), DVec3::ZERO, 50.0),
    ]
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    /// BLAKE3 over every number of the geometry, in hexadecimal, shortened.
    fn fingerprint(scene: &Scene) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut add = |numbers: &[f32]| {
            for x in numbers {
                hasher.update(&x.to_bits().to_le_bytes());
            }
        };
        for mesh in &scene.meshes {
            mesh.positions.iter().chain(&mesh.normals).for_each(|v| add(&v.to_array()));
            mesh.colors.iter().for_each(|c| add(&c.to_array()));
            mesh.uvs.iter().for_each(|uv| add(&uv.to_array()));
        }
        for index in scene.meshes.iter().flat_map(|mesh| &mesh.indices) {
            hasher.update(&index.to_le_bytes());
        }
        for texture in &scene.textures {
            hasher.update(&texture.rgba);
        }
        hasher.finalize().to_hex()[..16].to_owned()
    }

    #[test]
    fn the_same_number_of_triangles_is_the_same_scene_on_every_machine() {
        // Pinned. If it fails without a change of the scene, some operation is not portable; after a change of the
        // scene, raise TERRAIN_VERSION.
        assert_eq!(fingerprint(&terrain(2_000)), "a3661158832ec771");
        assert_eq!(fingerprint(&terrain(50_000)), "5b80aa6938ee4d1d");
    }

    #[test]
    fn the_terrain_has_the_requested_number_of_triangles_or_one_fewer() {
        for count in [2_000, 2_001, 3_333, 10_000, 50_000, 123_457, 500_000] {
            let triangles = terrain(count).triangles() as u64;
            assert!(triangles == count || triangles + 1 == count, "{count}: {triangles}");
        }
        assert_eq!(terrain(0).triangles(), 2_000);
    }

    #[test]
    fn every_part_of_the_terrain_keeps_the_invariants_of_a_mesh() {
        for count in [2_000, 50_000] {
            let scene = terrain(count);
            for mesh in &scene.meshes {
                let vertices = mesh.positions.len();
                assert!(mesh.triangles() > 0, "{}", mesh.name);
                assert_eq!(
                    (mesh.normals.len(), mesh.colors.len(), mesh.uvs.len()),
                    (vertices, vertices, vertices)
                );
                assert!(mesh.indices.iter().all(|&i| (i as usize) < vertices));
                assert!(mesh.positions.iter().all(|p| p.is_finite()));
                assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                assert!(mesh.colors.iter().all(|c| c.min_element() >= 0.0 && c.max_element() <= 1.2));
            }
        }
    }

    #[test]
    fn the_front_of_nearly_every_triangle_is_where_its_normals_point() {
        for mesh in &terrain(20_000).meshes {
            let is_wrong = |corners: &&[u32; 3]| {
                let [a, b, c] = corners.map(|i| mesh.positions[i as usize].as_dvec3());
                let normals: DVec3 = corners.iter().map(|&i| mesh.normals[i as usize].as_dvec3()).sum();
                let front = (b - a).cross(c - a);
                front.dot(normals) < -1e-6 * front.length()
            };
            let triangles = mesh.indices.as_chunks::<3>().0;
            let wrong = triangles.iter().filter(is_wrong).count();
            // On steep rock, normals that neighbours share may lie behind a triangle.
            assert!(wrong * 100 <= triangles.len(), "{}: {wrong} of {}", mesh.name, triangles.len());
        }
    }

    #[test]
    fn the_terrains_cameras_are_valid_above_ground_and_see_something() {
        let scene = terrain(20_000);
        let bounds = scene.bounds();
        for NamedCamera { name, camera } in &scene.cameras {
            camera.validate().unwrap();
            let floor = ground::height(DVec2::new(camera.eye.x, camera.eye.z)).max(ground::WATER);
            assert!(camera.eye.y > floor + 1.0, "{name}");
            assert!(bounds.contains(camera.target), "{name}");
        }
    }

    #[test]
    fn only_the_lake_is_glossy() {
        let scene = terrain(5_000);
        let glossy: Vec<&str> =
            scene.materials.iter().filter(|m| m.is_glossy()).map(|m| m.name.as_str()).collect();
        assert_eq!(glossy, ["water"]);
        assert_ne!(terrain(5_000).hash, terrain(5_001).hash);
    }
}
