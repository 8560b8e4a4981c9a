//! Scene files: glTF 2.0, OBJ + MTL and PLY become a [`Scene`].
//!
//! Files are untrusted. Any content gives a scene or a [`LoadError`] of one line. Memory is bounded by the bundle's size
//! rather than by the counts that it claims, but for 256 MiB of even textures. A bad texture costs that texture and a warning.

mod backdrop;
mod bulbs;
mod collect;
mod environment;
mod error;
mod geometry;
mod gltf;
mod images;
mod maps;
mod normals;
mod obj;
mod parts;
mod paths;
mod ply;
mod polygon;
mod scene_files;
mod tangents;

use std::collections::BTreeMap;
use std::path::Path;

use bytes::Bytes;

use crate::scene::{Instance, RigKind};
use crate::{Lighting, Material, Scene, Sky};

pub use collect::bundle_files;
pub use environment::{decode_environment, load_environment};
pub use error::LoadError;
use parts::{Format, Parts, Warnings};
use paths::InMemory;
use scene_files::SceneFiles;

/// Loads a scene from a file and the files that it refers to.
///
/// # Errors
/// One line that names the file and the reason.
pub fn load_path(path: impl AsRef<Path>) -> Result<Scene, LoadError> {
    let path = path.as_ref();
    let shown = path.display().to_string();
    let folder = collect::split(path)?;
    let scene = SceneFiles::collect(&folder, &folder.main).and_then(|bundle| load(&bundle));
    let mut scene = scene.map_err(|error| LoadError::new(&shown, error.reason))?;
    scene.name = shown;
    Ok(scene)
}

/// Loads a scene from files in memory; `name` is the main file. The same bundle has the same hash and gives the same
/// scene as on disk, except for the scene's name.
///
/// # Errors
/// One line that names the file and the reason.
pub fn load_bundle(name: &str, files: &BTreeMap<String, Bytes>) -> Result<Scene, LoadError> {
    load(&SceneFiles::collect(&InMemory(files), name)?)
}

fn load(bundle: &SceneFiles) -> Result<Scene, LoadError> {
    let mut warnings = Warnings::default();
    bundle.warn_of_substitutes(&mut warnings);
    let parts = match bundle.format {
        Format::Gltf => gltf::load(bundle, &mut warnings),
        Format::Obj => obj::load(bundle, &mut warnings),
        Format::Ply => ply::load(bundle, &mut warnings),
    };
    let mut parts = parts.map_err(|reason| LoadError::new(&bundle.main, reason))?;
    if parts.materials.is_empty() {
        parts.materials.push(Material::default());
    }
    if parts.instances.is_empty() {
        warnings.add("there are no triangles in it");
    }
    let lighting = if parts.lights.is_empty() && !has_lamps(&parts) {
        Lighting::default()
    } else {
        Lighting { lights: parts.lights, sky: Sky::BLACK, exposure: 1.0 }
    };
    let mut scene = Scene {
        name: bundle.main.clone(),
        hash: bundle.hash(),
        meshes: parts.meshes,
        instances: parts.instances,
        materials: parts.materials,
        textures: parts.textures,
        nodes: parts.nodes,
        animations: parts.animations,
        lighting,
        cameras: parts.cameras,
        ..Scene::default()
    };
    // The file's transforms are those at rest, which may not be any moment of an animation.
    scene.begin();
    scene.not_playing_warning().iter().for_each(|line| warnings.add(line));
    backdrop::mark(&mut scene);
    bulbs::measure(&mut scene);
    scene.rig = rig_of(&scene);
    scene.warnings = warnings.into_lines();
    Ok(scene)
}

/// Whether surfaces of a file emit as lamps do, so that it needs no sun and no sky: more than white, which is the most
/// that a display shows. Emission up to white is a screen or a glowing dial, which does not light its surroundings.
fn has_lamps(parts: &Parts) -> bool {
    let is_lamp = |instance: &Instance| {
        let mesh = &parts.meshes[instance.mesh as usize];
        parts.materials.get(mesh.material as usize).is_some_and(|m| m.emissive.max_element() > 1.0)
    };
    parts.instances.iter().any(is_lamp)
}

/// Share of a height field's area that may lie beyond its extent: its cameras do not show it.
const MOST_BEYOND: f64 = 0.01;

/// The rig for a scene. A scene without cameras that is eight times as long and wide as it is high counts as a height
/// field seen from above, unless surfaces reach out of its extent; any other scene is walked through.
fn rig_of(scene: &Scene) -> RigKind {
    if !scene.cameras.is_empty() {
        return RigKind::Cell;
    }
    let extent = scene.extent();
    let size = extent.size();
    let flat = size.y * 8.0 < size.x.min(size.z);
    if flat && scene.area_beyond(&extent) < MOST_BEYOND { RigKind::TileCorners } else { RigKind::Cell }
}
