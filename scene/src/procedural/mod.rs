//! Generated scenes, the same triangles on every machine.
//!
//! [`terrain`] is the scene that needs no file: after the cluster paper's (section 5), one highly
//! tessellated tree over a height-field terrain, with a lake for a surface whose look depends on the viewer.

mod ground;
mod lake;
mod noise;
mod occlusion;
mod textures;
mod tree;

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3, Vec4};

use crate::scene::{Instance, NamedCamera, RigKind};
use crate::{Camera, Lighting, Material, Mesh, Scene, SceneHash, TextureRef};
use noise::Random;
use occlusion::{Crown, GroundOcclusion};

/// How many triangles [`terrain`] can be made of.
pub const TERRAIN_TRIANGLES: RangeInclusive<u64> = 2_000..=20_000_000;
/// How many it is made of unless a user says otherwise: as many as the cluster paper's.
pub const DEFAULT_TERRAIN_TRIANGLES: u64 = 500_000;
/// Part of the scene's hash; raise it with every change of geometry, colour, lighting or cameras.
const TERRAIN_VERSION: u32 = 1;

/// Height of the tree's trunk to its tip, metres.
const TREE_HEIGHT: f64 = 28.0;

/// A valley of 200 m × 200 m with a lake, mountains along its rim and one tree, in `triangles` triangles
/// (exactly, or one fewer), clamped to [`TERRAIN_TRIANGLES`].
///
/// About two fifths of them are the ground's, an eighth the bark's, the rest leaves of two triangles each.
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
    // The crown's shade is surveyed from a fixed number of leaves, so that it does not depend on the budget.
    let survey = tree::Leaves::new(&branches, 20_000, &mut random);
    let crown = Crown::new(&survey.centers, survey.area);

    let ground = ground::mesh(ground_cells, &GroundOcclusion::new(&crown), GROUND);
    let lake = lake::mesh(lake_cells, WATER);
    let bark = tree::bark_mesh(&branches, bark_budget, &crown, BARK);
    let spent = ground.triangles() + lake.triangles() + bark.triangles();
    let leaves = tree::Leaves::new(&branches, (budget - spent) / 2, &mut random);
    let leaves = tree::leaf_mesh(&leaves, &crown, &mut random, LEAVES);

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
        nodes: Vec::new(),
        animations: Vec::new(),
        lighting: Lighting::default(),
        cameras: cameras(),
        rig: RigKind::TileCorners,
        warnings: Vec::new(),
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

/// Viewpoints that show the scene well; the first is the one it is known by.
///
/// All look down on the tile, as the cluster paper's views do: four samples from above its corners hold what
/// such views see. Views from the ground ask for samples nearer by (the `Cell` rig).
fn cameras() -> Vec<NamedCamera> {
    let camera = |name: &str, eye: DVec3, target: DVec3, fov_deg: f64| NamedCamera {
        name: name.to_owned(),
        camera: Camera { fov_deg, ..Camera::look_at(eye, target) },
    };
    let lake = ground::LAKE.0;
    vec![
        camera("valley", DVec3::new(-14.0, 72.0, 112.0), DVec3::new(4.0, 12.0, 0.0), 45.0),
        camera("overview", DVec3::new(95.0, 105.0, 150.0), DVec3::new(0.0, 5.0, -5.0), 45.0),
        camera("west", DVec3::new(-125.0, 88.0, 62.0), DVec3::new(0.0, 10.0, 0.0), 45.0),
        camera("east", DVec3::new(118.0, 80.0, 48.0), DVec3::new(6.0, 14.0, -4.0), 45.0),
        camera("glitter", DVec3::new(-58.0, 62.0, -30.0), DVec3::new(lake.x + 4.0, 0.0, lake.y + 6.0), 55.0),
        camera("map", DVec3::new(0.0, 230.0, 60.0), DVec3::ZERO, 50.0),
    ]
}
