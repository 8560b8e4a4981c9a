//! Scene files.

use std::collections::BTreeMap;

use argus_scene::load::load_bundle;
use bytes::Bytes;

/// Valid files, by name.
pub fn corpus() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("scene.obj", include_bytes!("../corpus/loaders/scene.obj").to_vec()),
        ("faces.obj", include_bytes!("../corpus/loaders/faces.obj").to_vec()),
        ("ascii.ply", include_bytes!("../corpus/loaders/ascii.ply").to_vec()),
        ("binary.ply", binary_ply()),
        ("scene.gltf", include_bytes!("../corpus/loaders/scene.gltf").to_vec()),
        ("scene.glb", glb(include_bytes!("../corpus/loaders/scene.gltf"))),
        // Files that scene.obj refers to.
        ("scene.mtl", include_bytes!("../corpus/loaders/scene.mtl").to_vec()),
        ("checker.png", include_bytes!("../corpus/loaders/checker.png").to_vec()),
    ]
}

/// Loads a bundle in which the file of that name is `bytes` and the others are valid. The loader must return, and what
/// it returns must be a scene in itself.
pub fn load(name: &str, bytes: &[u8]) -> Result<(), String> {
    let mut files: BTreeMap<String, Bytes> =
        corpus().into_iter().map(|(name, bytes)| (name.to_owned(), bytes.into())).collect();
    let bytes = if name.ends_with(".png") { with_checksums(bytes) } else { bytes.to_vec() };
    files.insert(name.to_owned(), bytes.into());
    let main = if name.ends_with(".mtl") || name.ends_with(".png") { "scene.obj" } else { name };
    let scene = load_bundle(main, &files).map_err(|error| error.to_string())?;
    for mesh in &scene.meshes {
        let vertices = mesh.positions.len();
        assert!(mesh.indices.len().is_multiple_of(3), "{} indices are no triangles", mesh.indices.len());
        assert!(mesh.indices.iter().all(|&index| (index as usize) < vertices), "an index is out of bounds");
        assert!(mesh.positions.iter().all(|p| p.is_finite()), "a position is not finite");
        assert!(
            mesh.normals.is_empty() || mesh.normals.len() == vertices,
            "normals are not those of vertices"
        );
        assert!(mesh.normals.iter().all(|n| n.is_finite()), "a normal is not finite");
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len(), "an instance of no mesh");
        assert!(instance.world_from_mesh.is_finite(), "a transform is not finite");
    }
    assert!(!scene.materials.is_empty(), "there is no material");
    Ok(())
}

/// A PNG whose chunks have the right checksums, since nothing that is edited would come further without.
fn with_checksums(png: &[u8]) -> Vec<u8> {
    let mut png = png.to_vec();
    let mut at = 8;
    while let Some(Ok(length)) = png.get(at..at + 4).map(<[u8; 4]>::try_from) {
        let end = at.saturating_add(8).saturating_add(u32::from_be_bytes(length) as usize);
        let Some(chunk) = png.get(at + 4..end) else { break };
        let checksum = crc(chunk).to_be_bytes();
        let Some(place) = png.get_mut(end..end + 4) else { break };
        place.copy_from_slice(&checksum);
        at = end + 4;
    }
    png
}

/// CRC-32 as PNG has it, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let bit = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit))
}

/// A quad in PLY's binary form.
fn binary_ply() -> Vec<u8> {
    let mut bytes =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n"
            .to_vec();
    for (x, z) in [(0.0_f32, 0.0_f32), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        for value in [x, 0.5, z] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([255, 128, 0]);
    }
    bytes.push(4);
    (0..4_i32).for_each(|index| bytes.extend(index.to_le_bytes()));
    bytes
}

/// glTF's JSON in its binary container.
fn glb(json: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for number in [2, 12 + 8 + json.len() as u32, json.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes
}
