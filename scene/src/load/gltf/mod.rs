//! glTF 2.0, binary and JSON.
//!
//! The `gltf` crate's types describe the document, but its validation and iterators index without checks (`validate`
//! panics on an accessor out of range). So every reference is looked up here, and only what the default scene draws
//! is read: an unused broken object does no harm.

mod accessor;
mod animation;
mod compressed;
mod document;
mod material;
mod nodes;
mod object;
mod primitive;
mod skin;

use std::collections::BTreeSet;

use base64::Engine;
use bytes::Bytes;
use gltf::json;

use super::bundle::Bundle;
use super::{Parts, Warnings};
use document::Document;

/// Limit of a scene's memory: a factor on the bundle's size, for arrays shared by several meshes, and a number of
/// bytes for small files.
const MOST_GROWTH: (u64, u64) = (256, 16 << 20);

/// Counts memory before it is allocated.
struct Budget {
    left: u64,
}

impl Budget {
    fn for_bundle(bundle: &Bundle) -> Self {
        Self { left: (bundle.len() as u64).saturating_mul(MOST_GROWTH.0).saturating_add(MOST_GROWTH.1) }
    }

    /// Reserves `count` elements of `size` bytes.
    fn take(&mut self, count: usize, size: u64) -> Result<(), String> {
        let bytes = (count as u64).saturating_mul(size);
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(format!("it claims more than {} times its own size", MOST_GROWTH.0)),
        }
    }
}

/// Names of the files that a document refers to, as they are written.
pub(super) fn references(bytes: &Bytes) -> Result<BTreeSet<String>, String> {
    let document = Document::parse(bytes)?;
    let buffers = document.root.buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    let images = document.root.images.iter().filter_map(|image| image.uri.as_deref());
    Ok(buffers.chain(images).filter(|uri| !uri.starts_with("data:")).map(file_of).collect())
}

/// The file that a URI names.
fn file_of(uri: &str) -> String {
    // Exporters escape names differently: a name with a stray per cent sign is used as it is.
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
    decoded.map_or_else(|_| uri.to_owned(), |name| name.into_owned())
}

/// The content of a URI: a file of the bundle, or inline data.
fn fetch(bundle: &Bundle, uri: &str) -> Result<Bytes, String> {
    let Some(data) = uri.strip_prefix("data:") else {
        return bundle.get("", &file_of(uri)).map(|(_, bytes)| bytes.clone());
    };
    let (kind, data) = data.split_once(',').ok_or("a data URI without data")?;
    if !kind.ends_with(";base64") {
        return Ok(Bytes::from(percent_encoding::percent_decode_str(data).collect::<Vec<u8>>()));
    }
    let lenient = base64::engine::GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        base64::engine::GeneralPurposeConfig::new()
            .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent),
    );
    let bytes = lenient.decode(data.trim()).map_err(|error| format!("a data URI: {error}"))?;
    Ok(Bytes::from(bytes))
}

/// Reads the default scene of a document.
pub(super) fn load(bundle: &Bundle, warnings: &mut Warnings) -> Result<Parts, String> {
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
    let mut budget = Budget::for_bundle(bundle);
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

/// A name from the document, or an empty one.
fn name(name: &Option<String>) -> String {
    name.clone().unwrap_or_default()
}

/// Looks up an index.
fn get<'a, T>(list: &'a [T], index: json::Index<T>, what: &str) -> Result<&'a T, String> {
    list.get(index.value()).ok_or_else(|| format!("{what} {} does not exist", index.value()))
}
