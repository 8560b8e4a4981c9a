//! Parses the container and the JSON of a document.

use std::collections::BTreeSet;

use bytes::Bytes;
use gltf::json;
use serde_json::Value;

use super::compressed::Compressed;

/// Extensions that are supported, or that are warned of where a material uses them. A file may require them.
const KNOWN_EXTENSIONS: [&str; 24] = [
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MESHOPT_compression",
    "MSFT_texture_dds",
];

/// Extensions by which a texture names an image of another format, and whether that format is read.
const IMAGE_EXTENSIONS: [(&str, bool); 4] = [
    ("KHR_texture_basisu", true),
    ("EXT_texture_webp", true),
    ("MSFT_texture_dds", true),
    ("EXT_texture_avif", false),
];

/// Extensions without which the first picture of a file is the same: data, sound, behaviour, and choices beside it.
const BESIDE_THE_PICTURE: [&str; 11] = [
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "KHR_audio_emitter",
    "KHR_interactivity",
    "KHR_materials_variants",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];

fn is_known(extension: &str) -> bool {
    KNOWN_EXTENSIONS.contains(&extension) || BESIDE_THE_PICTURE.contains(&extension)
}

/// A parsed document; its indices are not checked.
pub(super) struct Document {
    pub(super) root: json::Root,
    /// The binary chunk.
    pub(super) blob: Option<Bytes>,
    pub(super) compressed: Compressed,
    /// Whether a morph target moves more than positions, normals and tangents.
    pub(super) other_targets: bool,
    /// The materials as they are written: `root` lacks some of their extensions.
    pub(super) materials: Vec<Value>,
}

impl Document {
    pub(super) fn parse(bytes: &Bytes) -> Result<Self, String> {
        let (text, blob) = if bytes.starts_with(b"glTF") { split_glb(bytes)? } else { (bytes.clone(), None) };
        let not_json = |error: serde_json::Error| format!("its JSON cannot be read: {error}");
        let mut value: Value = serde_json::from_slice(&text).map_err(not_json)?;
        normalise(&mut value);
        check_version(&value)?;
        let other_targets = has_other_targets(&value);
        let compressed = Compressed::take(&mut value);
        let materials = value.get("materials").and_then(Value::as_array).cloned().unwrap_or_default();
        let root = serde_json::from_value(value).map_err(|error| format!("is not glTF 2.0: {error}"))?;
        Ok(Self { root, blob, compressed, materials, other_targets })
    }

    /// Rejects a document that requires an unknown extension.
    pub(super) fn check_extensions(&self) -> Result<(), String> {
        let unknown = self.root.extensions_required.iter().find(|extension| !is_known(extension));
        match unknown {
            Some(extension) => Err(format!("it requires the extension {extension}, which is not supported")),
            None => Ok(()),
        }
    }

    /// Returns the extensions that the document uses without requiring them, and that are ignored here; each once.
    pub(super) fn ignored_extensions(&self) -> BTreeSet<&str> {
        let used = self.root.extensions_used.iter().map(String::as_str);
        used.filter(|extension| !is_known(extension)).collect()
    }
}

/// Whether a morph target has an attribute that the `gltf` crate drops.
fn has_other_targets(document: &Value) -> bool {
    fn list<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
        value.get(key).and_then(Value::as_array).into_iter().flatten()
    }
    let targets =
        list(document, "meshes").flat_map(|mesh| list(mesh, "primitives")).flat_map(|p| list(p, "targets"));
    let mut kinds = targets.filter_map(Value::as_object).flat_map(|target| target.keys());
    kinds.any(|kind| kind.starts_with("TEXCOORD_") || kind.starts_with("COLOR_"))
}

fn check_version(document: &Value) -> Result<(), String> {
    let asset = document.get("asset").ok_or("is not glTF: it has no asset")?;
    let text = |key: &str| asset.get(key).and_then(Value::as_str);
    let version = text("version").ok_or("is not glTF: its asset has no version")?;
    let needed = text("minVersion").unwrap_or(version);
    // A newer minor version is accepted unless the file requires it.
    let too_new = text("minVersion").is_some_and(|v| v != "2.0");
    if !needed.starts_with("2.") || too_new {
        return Err(format!("is glTF {needed}; 2.0 is supported"));
    }
    Ok(())
}

/// The two chunks of a binary glTF. Chunks of other kinds may follow and are skipped.
fn split_glb(bytes: &Bytes) -> Result<(Bytes, Option<Bytes>), String> {
    let word = |at: usize| -> Result<u32, String> {
        let word = bytes.get(at..at + 4).ok_or("the GLB header is cut short")?;
        Ok(u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
    };
    let (version, length) = (word(4)?, word(8)? as usize);
    if version != 2 {
        return Err(format!("is GLB version {version}; 2 is supported"));
    }
    if length > bytes.len() {
        return Err(format!(
            "the file is cut short: its header promises {length} bytes, it has {}",
            bytes.len()
        ));
    }
    let (mut at, mut text, mut blob) = (12usize, None, None);
    while at < length {
        let size = word(at)? as usize;
        let kind = word(at + 4)?;
        let start = at + 8;
        let end = start.checked_add(size).filter(|&end| end <= length);
        let end = end.ok_or_else(|| format!("a GLB chunk of {size} bytes does not fit in its file"))?;
        match &kind.to_le_bytes() {
            b"JSON" if text.is_none() && at == 12 => text = Some(bytes.slice(start..end)),
            b"JSON" => return Err("a GLB file has one JSON chunk, and it comes first".to_owned()),
            b"BIN\0" if blob.is_none() => blob = Some(bytes.slice(start..end)),
            b"BIN\0" => return Err("a GLB file has at most one binary chunk".to_owned()),
            _ => {}
        }
        // Chunks are padded to four bytes; files whose sizes leave the padding out are common.
        at = end.next_multiple_of(4);
    }
    Ok((text.ok_or("a GLB file without a JSON chunk")?, blob))
}

/// Prepares valid JSON for the `gltf` crate: whole numbers written as fractions (`5126.0`) become whole, a scene may
/// lack its nodes and a skin its joints, a texture's image is the one that its extension names, and channels without a
/// node and application data (`extras`) are removed.
fn normalise(document: &mut Value) {
    if let Some(scenes) = document.get_mut("scenes").and_then(Value::as_array_mut) {
        for scene in scenes.iter_mut().filter_map(Value::as_object_mut) {
            scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
        }
    }
    if let Some(skins) = document.get_mut("skins").and_then(Value::as_array_mut) {
        for skin in skins.iter_mut().filter_map(Value::as_object_mut) {
            skin.entry("joints").or_insert_with(|| Value::Array(Vec::new()));
        }
    }
    if let Some(animations) = document.get_mut("animations").and_then(Value::as_array_mut) {
        for channels in animations.iter_mut().filter_map(|a| a.get_mut("channels")?.as_array_mut()) {
            channels
                .retain(|channel| channel.get("target").is_none_or(|target| target.get("node").is_some()));
        }
    }
    simplify(document);
    for texture in document.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
        let named = |&(name, read): &(&str, bool)| {
            let source = texture.get("extensions")?.get(name)?.get("source")?;
            // An image of a format that is not read serves only to say so.
            (read || texture.get("source").is_none()).then(|| source.clone())
        };
        if let Some(source) = IMAGE_EXTENSIONS.iter().find_map(named) {
            texture["source"] = source;
        }
    }
}

/// The recursion is bounded: the parser rejects nesting deeper than 128 levels.
fn simplify(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let Some(x) = number.as_f64() else { return };
            if x.fract() == 0.0 && (0.0..9e15).contains(&x) && !(x == 0.0 && x.is_sign_negative()) {
                *number = (x as u64).into();
            }
        }
        Value::Array(values) => values.iter_mut().for_each(simplify),
        Value::Object(values) => {
            values.remove("extras");
            values.values_mut().for_each(simplify);
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(bytes: &[u8]) -> String {
        Document::parse(&Bytes::copy_from_slice(bytes)).err().unwrap()
    }

    fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let body: Vec<u8> = chunks
            .iter()
            .flat_map(|(kind, data)| [&(data.len() as u32).to_le_bytes()[..], &kind[..], data].concat())
            .collect();
        [b"glTF", &2u32.to_le_bytes()[..], &(12 + body.len() as u32).to_le_bytes()[..], &body].concat()
    }

    const EMPTY: &[u8] = b"{\"asset\":{\"version\":\"2.0\"}} ";

    #[test]
    fn each_kind_of_broken_container_is_named() {
        assert!(error(b"glTF").contains("cut short"));
        assert!(error(&glb(&[])).contains("without a JSON"));
        assert!(error(&glb(&[(b"BIN\0", b"1234"), (b"JSON", EMPTY)])).contains("comes first"));
        assert!(error(&glb(&[(b"JSON", EMPTY), (b"JSON", EMPTY)])).contains("one JSON chunk"));
        assert!(error(&glb(&[(b"JSON", EMPTY), (b"BIN\0", b""), (b"BIN\0", b"")])).contains("at most one"));
        let mut short = glb(&[(b"JSON", EMPTY)]);
        short.truncate(24);
        assert!(error(&short).contains("promises"));
        let mut version = glb(&[(b"JSON", EMPTY)]);
        version[4] = 1;
        assert!(error(&version).contains("version 1"));
        let mut lying = glb(&[(b"JSON", EMPTY)]);
        lying[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(error(&lying).contains("does not fit"));
    }

    #[test]
    fn unknown_chunks_and_unpadded_ones_are_read() {
        let chunks: [(&[u8; 4], &[u8]); 3] = [(b"JSON", EMPTY), (b"XTRA", b"1234"), (b"BIN\0", b"abcd")];
        let document = Document::parse(&Bytes::from(glb(&chunks))).unwrap();
        assert_eq!(document.blob.unwrap(), &b"abcd"[..]);
    }

    #[test]
    fn json_that_is_not_gltf_is_rejected_with_a_reason() {
        assert!(error(b"{").contains("JSON"));
        assert!(error(b"[]").contains("no asset"));
        assert!(error(br#"{"asset":{}}"#).contains("no version"));
        assert!(error(br#"{"asset":{"version":"1.0"}}"#).contains("glTF 1.0"));
        assert!(error(br#"{"asset":{"version":"2.1","minVersion":"2.1"}}"#).contains("glTF 2.1"));
        assert!(error("[".repeat(100_000).as_bytes()).contains("JSON"));
        assert!(error(br#"{"asset":{"version":"2.0"},"nodes":3}"#).contains("not glTF 2.0"));
    }

    #[test]
    fn unusual_but_valid_documents_are_read() {
        let text = br#"{"asset":{"version":"2.0","extras":7},"scenes":[{}],
            "accessors":[{"count":3.0,"componentType":5126.0,"type":"SCALAR"}],
            "animations":[{"samplers":[],"channels":[{"sampler":0,"target":{"path":"pointer"}}]}]}"#;
        let document = Document::parse(&Bytes::from_static(text)).unwrap();
        assert_eq!(document.root.accessors[0].count.0, 3);
        assert!(document.root.animations[0].channels.is_empty());
    }

    #[test]
    fn a_required_extension_that_is_unknown_is_named() {
        let text = br#"{"asset":{"version":"2.0"},"extensionsRequired":["XMPL_not_known"]}"#;
        let document = Document::parse(&Bytes::from_static(text)).unwrap();
        assert!(document.check_extensions().unwrap_err().contains("XMPL_not_known"));
    }
}
