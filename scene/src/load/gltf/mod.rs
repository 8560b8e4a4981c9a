//! glTF 2.0, binary and JSON.
//!
//! The `gltf` crate's types describe the document, but its validation and iterators index without checks (`validate`
//! panics on an accessor out of range). So every reference is looked up here, and only what the default scene draws
//! is read: an unused broken object does no harm.

mod accessor;
mod animation;
mod compressed;
mod document;
mod lookup;
mod material;
mod nodes;
mod object;
mod primitive;
mod skin;

use std::collections::BTreeSet;

use bytes::Bytes;

use super::parts::{Parts, Warnings};
use super::scene_files::SceneFiles;
use document::Document;
use lookup::{Budget, file_of};

/// Names of the files that a document refers to, as they are written.
pub(super) fn references(bytes: &Bytes) -> Result<BTreeSet<String>, String> {
    let document = Document::parse(bytes)?;
    let buffers = document.root.buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    let images = document.root.images.iter().filter_map(|image| image.uri.as_deref());
    Ok(buffers.chain(images).filter(|uri| !uri.starts_with("data:")).map(file_of).collect())
}

/// Reads the default scene of a document.
pub(super) fn load(bundle: &SceneFiles, warnings: &mut Warnings) -> Result<Parts, String> {
    let document = Document::parse(bundle.main_bytes())?;
    document.check_extensions()?;
    for extension in document.ignored_extensions() {
        warnings.add(format!("the extension {extension} is not supported: the scene is shown without it"));
    }
    if document.other_targets {
        warnings
            .add("texture coordinates and colours of morph targets are not supported: they stay as they are");
    }
    let root = &document.root;
    let mut budget = Budget::for_files(bundle);
    let reader = accessor::Reader::new(&document, bundle, budget.left);

    let mut hierarchy = nodes::Hierarchy::new(root, &mut budget, warnings)?;
    let used = primitive::used_materials(root, &hierarchy);
    let material::Materials { all: materials, sets, textures } =
        material::read(&reader, bundle, &used, warnings);
    let animations = animation::read(&reader, &hierarchy, &mut budget, warnings)?;
    let mut parts = Parts { materials, animations, ..Parts::default() };
    primitive::place(&reader, &hierarchy, &sets, &mut parts, &mut budget, warnings)?;
    parts.textures = textures.decode(&mut parts.materials, warnings);
    parts.lights = nodes::lights(root, &mut hierarchy, warnings);
    parts.cameras = nodes::cameras(root, &hierarchy, &parts.animations, warnings);
    parts.nodes = hierarchy.nodes;
    Ok(parts)
}
