//! glTF documents made here, one for each possible error of a loader.

mod compressed;
mod geometry;
mod materials;
mod nodes;
mod poses;
mod specification;

use std::collections::BTreeMap;

use argus_scene::Scene;
use argus_scene::load::{LoadError, load_bundle};
use base64::Engine;
use bytes::Bytes;
use serde_json::{Value, json};

fn load(document: &Value) -> Result<Scene, LoadError> {
    load_with(document, &[])
}

fn load_with(document: &Value, others: &[(&str, &[u8])]) -> Result<Scene, LoadError> {
    let mut files = BTreeMap::from([("a.gltf".to_owned(), Bytes::from(document.to_string()))]);
    files.extend(others.iter().map(|(name, bytes)| ((*name).to_owned(), Bytes::copy_from_slice(bytes))));
    load_bundle("a.gltf", &files)
}

fn refused(document: &Value) -> String {
    let line = load(document).expect_err("must be refused").to_string();
    assert!(line.starts_with("a.gltf: ") && !line.contains('\n'), "{line}");
    line
}

fn data_uri(bytes: &[u8]) -> String {
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{text}")
}

/// A unit square in the xy plane: accessor 0 holds its corners, 1 its six indices, 2 texture coordinates.
fn square() -> Value {
    let corners: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let uvs: [[f32; 2]; 4] = [[0., 1.], [1., 1.], [1., 0.], [0., 0.]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend(uvs.iter().flatten().flat_map(|x| x.to_le_bytes()));
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": data_uri(&bytes)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
            {"buffer": 0, "byteOffset": 60, "byteLength": 32},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    })
}

fn changed(pointer: &str, value: Value) -> Value {
    let mut document = square();
    let (parent, key) = pointer.rsplit_once('/').expect("a JSON pointer");
    match document.pointer_mut(parent).expect("a parent") {
        Value::Object(object) => object.insert(key.to_owned(), value),
        Value::Array(array) => {
            Some(std::mem::replace(&mut array[key.parse::<usize>().expect("a number")], value))
        }
        _ => panic!("{pointer} leads nowhere"),
    };
    document
}
