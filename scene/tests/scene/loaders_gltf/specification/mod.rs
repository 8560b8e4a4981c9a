//! Every field of glTF 2.0 and of its common extensions: shown, warned of, or without effect on a picture.
//!
//! Each row loads a small document with and without a change. Names are left out of the comparison.

mod hierarchy;
mod materials;

use argus_scene::Scene;
use serde_json::{Value, json};

use super::{data_uri, load, square};

/// What a field does.
#[derive(Debug, Clone, Copy)]
enum Outcome {
    /// The scene changes, without a warning.
    Shown,
    /// A warning with these words is added.
    Warned(&'static str),
    /// Nothing changes, because the field does not affect a picture.
    NotApplicable,
    /// The document is refused with these words.
    Refused(&'static str),
}
use Outcome::{NotApplicable, Refused, Shown, Warned};

/// Field, outcome, and changes: those that both documents have, and those of the field.
type Row = (&'static str, Outcome, Value, Value);

/// Merges a change: objects by key, which null removes, and arrays by element; all else is replaced.
fn merge(document: &mut Value, change: &Value) {
    match (document, change) {
        (Value::Object(into), Value::Object(from)) => {
            for (key, value) in from {
                match value {
                    Value::Null => _ = into.remove(key),
                    value => merge(into.entry(key.clone()).or_insert(Value::Null), value),
                }
            }
        }
        (Value::Array(into), Value::Array(from)) => {
            into.resize(into.len().max(from.len()), Value::Null);
            into.iter_mut().zip(from).for_each(|(into, from)| merge(into, from));
        }
        (into, from) => *into = from.clone(),
    }
}

fn image(color: [u8; 4]) -> Value {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba(color.map(|c| c ^ (16 * (x + y)) as u8)));
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("PNG in memory");
    json!({"uri": data_uri(bytes.get_ref())})
}

/// A lit square with a camera. Accessors from 3: second texture coordinates, normals, tangents, colours (bytes), colours
/// (16 bits, no alpha), times, places.
fn base() -> Value {
    let mut document = square();
    let uvs = [[0.5f32, 0.], [0., 0.5], [1., 0.5], [0.5, 1.]];
    let mut bytes: Vec<u8> = uvs.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0f32, 0.6, 0.8].repeat(4).iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0.8f32, 0.48, -0.36, 1.].repeat(4).iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([255u8, 0, 128, 64].repeat(4));
    bytes.extend([65535u16, 0, 128, 0].repeat(4).iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0f32, 1., 0., 0., 0., 1., 2., 3.].iter().flat_map(|x| x.to_le_bytes()));
    let accessor = |view: u32, component: u32, count: u32, kind: &str| json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
    let normalized = |mut accessor: Value| {
        accessor["normalized"] = json!(true);
        accessor
    };
    let view = |offset: u32, length: u32| json!({"buffer": 1, "byteOffset": offset, "byteLength": length});
    let mut strided = view(160, 32);
    strided["byteStride"] = json!(8);
    merge(
        &mut document,
        &json!({
            "buffers": [{}, {"byteLength": bytes.len(), "uri": data_uri(&bytes)}],
            "bufferViews": [{}, {}, {}, view(0, 32), view(32, 48), view(80, 64), view(144, 16), strided, view(192, 8), view(200, 24)],
            "accessors": [{}, {}, {},
                accessor(3, 5126, 4, "VEC2"), accessor(4, 5126, 4, "VEC3"), accessor(5, 5126, 4, "VEC4"),
                normalized(accessor(6, 5121, 4, "VEC4")), normalized(accessor(7, 5123, 4, "VEC3")),
                accessor(8, 5126, 2, "SCALAR"), accessor(9, 5126, 2, "VEC3"),
            ],
            "images": [image([200, 100, 50, 255]), image([90, 60, 220, 128])],
            "samplers": [{}],
            "textures": [{"source": 0, "sampler": 0}, {"source": 1}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "roughnessFactor": 0.5}}],
            "meshes": [{"primitives": [{"material": 0, "attributes": {"TEXCOORD_1": 3}}]}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
            "nodes": [{}, {"camera": 0, "translation": [0, 0, 3]}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}],
            "scenes": [{"nodes": [0, 1, 2]}],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5}]}},
        }),
    );
    document
}

/// The scene without names and hash, and its warnings.
fn loaded(document: &Value) -> Result<(Scene, Vec<String>), String> {
    let mut scene = load(document).map_err(|error| error.to_string())?;
    let warnings = std::mem::take(&mut scene.warnings);
    scene.hash = argus_scene::SceneHash([0; 32]);
    scene.meshes.iter_mut().for_each(|mesh| mesh.name.clear());
    scene.materials.iter_mut().for_each(|material| material.name.clear());
    scene.textures.iter_mut().for_each(|texture| texture.name.clear());
    scene.nodes.iter_mut().for_each(|node| node.name.clear());
    scene.animations.iter_mut().for_each(|animation| animation.name.clear());
    Ok((scene, warnings))
}

/// Rows whose outcome is another, with what was found.
fn wrong(rows: Vec<Row>) -> Vec<String> {
    let mut wrong = Vec::new();
    for (field, outcome, given, change) in rows {
        let mut document = base();
        merge(&mut document, &given);
        let before = loaded(&document);
        merge(&mut document, &change);
        let (before, after) = (before.unwrap_or_else(|error| panic!("{field}: {error}")), loaded(&document));
        let right = match (&after, outcome) {
            (Err(error), Refused(words)) => error.contains(words),
            (Ok((scene, warnings)), Shown) => *scene != before.0 && *warnings == before.1,
            (Ok((scene, warnings)), NotApplicable) => *scene == before.0 && *warnings == before.1,
            (Ok((_, warnings)), Warned(words)) => {
                warnings.len() == before.1.len() + 1 && warnings.iter().any(|line| line.contains(words))
            }
            _ => false,
        };
        if !right {
            let found = match &after {
                Ok((scene, warnings)) => format!("scene changed: {}, {warnings:?}", *scene != before.0),
                Err(error) => error.clone(),
            };
            wrong.push(format!("{field} is not {outcome:?}: {found}"));
        }
    }
    wrong
}

fn none() -> Value {
    json!({})
}

fn material(change: Value) -> Value {
    json!({"materials": [change]})
}
