//! The scene: triangles, materials, lights and animation, independent of its file format.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use crate::animation::{Animation, Node};
use crate::deformation::Deformation;
use crate::revisions::Revisions;
use crate::{Camera, Lighting, Material, Texture};

/// BLAKE3 over the scene's whole bundle of files (or, for a generated scene, its name and version).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SceneHash(pub [u8; 32]);

impl fmt::Display for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Triangles of one material. Positions are relative to `origin`, so that a mesh far from zero keeps its precision.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// As the file names it, or empty.
    pub name: String,
    /// Position of the vertices' zero in mesh space, metres.
    pub origin: DVec3,
    /// Positions relative to `origin`, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, one per position; loaders compute missing ones.
    pub normals: Vec<Vec3>,
    /// Unit tangents with the bitangent's sign in w, one per position; empty if no normal map needs them.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates, one per position, or empty.
    pub uvs: Vec<Vec2>,
    /// The second set of texture coordinates, one per position, or empty.
    pub uvs2: Vec<Vec2>,
    /// Linear vertex colours that multiply the base colour, one per position, or empty.
    pub colors: Vec<Vec4>,
    /// Three per triangle, each a valid index of a position without NaN. A triangle may have no area or use a vertex
    /// twice, as in its file; such triangles are counted.
    pub indices: Vec<u32>,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// How its vertices move, if they may; their shape here is that of time zero, or of [`Scene::posed`].
    pub deformation: Option<Arc<Deformation>>,
}

impl Mesh {
    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// Its texture coordinates of a set, 0 or 1: see [`crate::TextureRef::uv_set`].
    pub fn uvs_of(&self, set: u8) -> &[Vec2] {
        if set == 0 { &self.uvs } else { &self.uvs2 }
    }
}

/// A mesh placed in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::nodes`] of the node whose space is mesh space, and whose animations move the instance; `None`
    /// without a node.
    pub node: Option<u32>,
    /// World position of mesh space at time zero; [`Scene::at`] returns it for other times.
    pub world_from_mesh: DAffine3,
}

/// A viewpoint recommended by the scene's author or generator.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// As the file names it, or empty.
    pub name: String,
    /// The viewpoint.
    pub camera: Camera,
}

/// A property that a scene's image depends on; passes run only for effects that are present.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effect {
    /// Alpha-tested materials: visibility must look textures up.
    AlphaCutout,
    /// Materials that emit.
    Emission,
    /// Glossy materials: samples carry the planes for specular.
    Specular,
    /// Materials that let light through.
    Transmission,
    /// Normal maps.
    NormalMap,
    /// Directional, point or spot lights.
    PunctualLights,
    /// A sky that is not black.
    Sky,
    /// Animation of visible parts.
    Animation,
}

/// Default placement of sample cameras in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RigKind {
    /// Four cameras above the corners of a tile: for height fields seen from outside.
    TileCorners,
    /// Omni cameras on a lattice around the viewpoints: for interiors and scenes that are walked through.
    Cell,
}

/// Triangles, materials, lights and animation, under a name and a hash.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Name from the user: a file's path or `terrain:500000`.
    pub name: String,
    /// Hash of the whole bundle of files.
    pub hash: SceneHash,
    /// Triangles by material.
    pub meshes: Vec<Mesh>,
    /// Placed meshes, at time zero.
    pub instances: Vec<Instance>,
    /// At least one.
    pub materials: Vec<Material>,
    /// Decoded images.
    pub textures: Vec<Texture>,
    /// Parents before children.
    pub nodes: Vec<Node>,
    /// Movements of nodes.
    pub animations: Vec<Animation>,
    /// Lights, sky and exposure, at time zero.
    pub lighting: Lighting,
    /// Recommended viewpoints; may be empty.
    pub cameras: Vec<NamedCamera>,
    /// Default placement of sample cameras.
    pub rig: RigKind,
    /// Features that the loader ignores, one line each.
    pub warnings: Vec<String>,
    /// Transforms that clients set lately, by revision.
    pub revisions: Revisions,
    /// What it was made of, if clients moved nodes of it.
    pub by_request: Option<Arc<MovedScene>>,
}

/// What a scene with other transforms was made of.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedScene {
    /// The scene as it was opened.
    pub base: Arc<Scene>,
    /// Nodes that clients may move, by index: those of this revision, and those that moved before.
    pub movers: BTreeSet<u32>,
}

impl Default for Scene {
    /// A scene without a name and without triangles, under sun and sky.
    fn default() -> Self {
        Self {
            name: String::new(),
            hash: SceneHash([0; 32]),
            meshes: Vec::new(),
            instances: Vec::new(),
            materials: vec![Material::default()],
            textures: Vec::new(),
            nodes: Vec::new(),
            animations: Vec::new(),
            lighting: Lighting::default(),
            cameras: Vec::new(),
            rig: RigKind::Cell,
            warnings: Vec::new(),
            revisions: Revisions::default(),
            by_request: None,
        }
    }
}

impl Scene {
    /// Number of triangles over all instances.
    pub fn triangles(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh as usize].triangles()).sum()
    }

    /// The effects of this scene, in the order of [`Effect`].
    pub fn effects(&self) -> Vec<Effect> {
        let used = |test: fn(&Material) -> bool| {
            self.instances.iter().any(|i| {
                let material = self.meshes[i.mesh as usize].material;
                test(&self.materials[material as usize])
            })
        };
        let sky = &self.lighting.sky;
        let present = [
            (Effect::AlphaCutout, used(|m| m.alpha_cutoff().is_some())),
            (Effect::Emission, used(|m| m.emissive.max_element() > 0.0)),
            (Effect::Specular, used(Material::is_glossy)),
            (Effect::Transmission, used(|m| m.transmission > 0.0)),
            (Effect::NormalMap, used(|m| m.normal_texture.is_some())),
            (Effect::PunctualLights, !self.lighting.lights.is_empty()),
            (Effect::Sky, (sky.zenith + sky.horizon + sky.ground).max_element() > 0.0),
            (Effect::Animation, self.is_animated()),
        ];
        present.into_iter().filter_map(|(effect, present)| present.then_some(effect)).collect()
    }
}
