//! Scene files.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

use argus_scene::load::{decode_environment, load_bundle};
use argus_scene::{Light, Scene};
use bytes::Bytes;
use image::{ImageFormat, RgbImage};
use meshoptimizer_rs::codec;

/// Valid files, by name.
pub fn corpus() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("scene.obj", include_bytes!("../corpus/loaders/scene.obj").to_vec()),
        ("faces.obj", include_bytes!("../corpus/loaders/faces.obj").to_vec()),
        ("ascii.ply", include_bytes!("../corpus/loaders/ascii.ply").to_vec()),
        ("faces-first.ply", include_bytes!("../corpus/loaders/faces-first.ply").to_vec()),
        ("binary.ply", binary_ply("little", f32::to_le_bytes, i32::to_le_bytes)),
        ("big-endian.ply", binary_ply("big", f32::to_be_bytes, i32::to_be_bytes)),
        ("scene.gltf", include_bytes!("../corpus/loaders/scene.gltf").to_vec()),
        ("posed.gltf", include_bytes!("../corpus/loaders/posed.gltf").to_vec()),
        ("scene.glb", glb(include_bytes!("../corpus/loaders/scene.gltf"))),
        ("triangle.glb", glb_with_blob()),
        // Files that scene.obj refers to, or would refer to if scene.mtl named another image.
        ("scene.mtl", include_bytes!("../corpus/loaders/scene.mtl").to_vec()),
        ("checker.png", include_bytes!("../corpus/loaders/checker.png").to_vec()),
        ("checker.jpg", image(ImageFormat::Jpeg)),
        ("checker.bmp", image(ImageFormat::Bmp)),
        ("checker.tga", image(ImageFormat::Tga)),
        ("checker.webp", image(ImageFormat::WebP)),
        ("checker.gif", image(ImageFormat::Gif)),
        ("lossy.webp", include_bytes!("../corpus/loaders/quadrants-lossy.webp").to_vec()),
        ("cmyk.jpg", include_bytes!("../corpus/loaders/quadrants-cmyk.jpg").to_vec()),
        ("progressive.jpg", include_bytes!("../corpus/loaders/quadrants-progressive.jpg").to_vec()),
        ("palette.png", include_bytes!("../corpus/loaders/quadrants-palette.png").to_vec()),
        ("etc1s.ktx2", include_bytes!("../corpus/loaders/quadrants-etc1s.ktx2").to_vec()),
        ("etc1s-alpha.ktx2", include_bytes!("../corpus/loaders/quadrants-etc1s-alpha.ktx2").to_vec()),
        ("uastc.ktx2", include_bytes!("../corpus/loaders/quadrants-uastc.ktx2").to_vec()),
        ("astc.ktx2", include_bytes!("../corpus/loaders/quadrants-astc.ktx2").to_vec()),
        // The buffer of a document: see `document`.
        ("cube.drc", include_bytes!("../corpus/loaders/cube.drc").to_vec()),
        ("packed.bin", packed().concat()),
    ]
}

/// A square by meshopt: four positions of 12 bytes, and six indices.
fn packed() -> [Vec<u8>; 2] {
    let workspace = &mut meshoptimizer_rs::Workspace::default();
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let corners: Vec<u8> = corners.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let encoding = codec::VertexEncoding::DEFAULT;
    // What cannot be encoded is not valid input: the test of the corpus finds it.
    let vertices = codec::encode_vertex_buffer(&corners, 4, 12, encoding, workspace);
    let indices = codec::encode_index_buffer(&[0, 1, 2, 0, 2, 3], codec::IndexEncoding::DEFAULT, workspace);
    [vertices, indices].map(Result::unwrap_or_default)
}

/// A document whose buffer is the file `name` of `bytes` bytes, compressed by Draco or by meshopt.
fn document(name: &str, bytes: usize) -> String {
    let (views, primitive) = if name.ends_with(".drc") {
        let draco =
            r#"{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":2,"NORMAL":1}}}"#;
        (
            format!(r#"{{"buffer":0,"byteLength":{bytes}}}"#),
            format!(r#""attributes":{{"POSITION":2,"NORMAL":3}},"indices":4,"extensions":{draco}"#),
        )
    } else {
        let vertices = bytes.min(packed()[0].len());
        let view = |at: usize, bytes: usize, stride: usize, count: usize, mode: &str| {
            format!(
                r#"{{"buffer":1,"byteLength":{},"extensions":{{"EXT_meshopt_compression":{{"buffer":0,
"byteOffset":{at},"byteLength":{bytes},"byteStride":{stride},"count":{count},"mode":"{mode}"}}}}}}"#,
                stride * count
            )
        };
        let positions = view(0, vertices, 12, 4, "ATTRIBUTES");
        let indices = view(vertices, bytes - vertices, 2, 6, "TRIANGLES");
        (format!("{positions},{indices}"), r#""attributes":{"POSITION":0},"indices":1"#.to_owned())
    };
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{{primitive}}}]}}],"bufferViews":[{views}],
"buffers":[{{"uri":"{name}","byteLength":{bytes}}},{{"byteLength":99}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
{{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}},
{{"componentType":5126,"count":24,"type":"VEC3"}},{{"componentType":5126,"count":24,"type":"VEC3"}},
{{"componentType":5123,"count":36,"type":"SCALAR"}}]}}"#
    )
}

/// Whether a scene refers to a file as an image.
fn is_image(name: &str) -> bool {
    [".png", ".jpg", ".bmp", ".tga", ".webp", ".gif", ".ktx2"].iter().any(|end| name.ends_with(end))
}

/// A small image in a format.
fn image(format: ImageFormat) -> Vec<u8> {
    let image = RgbImage::from_fn(8, 8, |x, y| image::Rgb([x as u8 * 30, y as u8 * 30, 128]));
    let mut bytes = Vec::new();
    // An image that cannot be written is not valid input: the test of the corpus finds it.
    let _ = image.write_to(&mut Cursor::new(&mut bytes), format);
    bytes
}

/// Loads a bundle in which the file `name` is `bytes` and the rest are valid. The loader must return, and its scene
/// must be consistent.
pub fn load(name: &str, bytes: &[u8]) -> Result<(), String> {
    let mut files: BTreeMap<String, Bytes> =
        corpus().into_iter().map(|(name, bytes)| (name.to_owned(), bytes.into())).collect();
    let bytes = if name.ends_with(".png") { with_checksums(bytes) } else { bytes.to_vec() };
    files.insert(name.to_owned(), bytes.into());
    if is_image(name) {
        let materials = include_str!("../corpus/loaders/scene.mtl").replace("checker.png", name);
        files.insert("scene.mtl".to_owned(), materials.into());
    }
    let is_buffer = name.ends_with(".drc") || name.ends_with(".bin");
    if is_buffer {
        files.insert("packed.gltf".to_owned(), document(name, files[name].len()).into());
    }
    let main = if is_buffer {
        "packed.gltf"
    } else if name.ends_with(".mtl") || is_image(name) {
        "scene.obj"
    } else {
        name
    };
    let scene = load_bundle(main, &files).map_err(|error| error.to_string())?;
    let scene = Arc::new(scene);
    is_consistent(&scene);
    is_consistent(&scene.posed(0.3));
    let _ = scene.bounds();
    Ok(())
}

/// Checks that a scene's indices are in bounds and its numbers finite.
fn is_consistent(scene: &Scene) {
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
}

/// Environment maps in both formats.
pub fn environments() -> Vec<Vec<u8>> {
    let texel =
        |x: u32, y: u32| image::Rgb([x as f32 * 0.2, y as f32 * 0.3, if x == 3 { 900.0 } else { 0.5 }]);
    let file = |format| {
        let image = image::DynamicImage::ImageRgb32F(image::Rgb32FImage::from_fn(16, 8, texel));
        let mut bytes = Vec::new();
        let _ = image.write_to(&mut Cursor::new(&mut bytes), format);
        bytes
    };
    let mut exposed = b"#?RADIANCE\nEXPOSURE=2\nCOLORCORR=1 2 1\nPRIMARIES=1\n\n-Y 1 +X 2\n".to_vec();
    exposed.extend([128; 8]);
    vec![file(ImageFormat::Hdr), file(ImageFormat::OpenExr), exposed]
}

/// Reads an environment map. What it makes of any bytes must be finite.
pub fn environment(bytes: &[u8]) -> Result<(), String> {
    let environment = decode_environment("map", bytes).map_err(|error| error.to_string())?;
    let map = environment.map;
    assert!(map.brightest().is_finite() && map.darkest().min_element() >= 0.0, "radiance is not finite");
    assert!(map.harmonics().iter().all(|factor| factor.is_finite()), "irradiance is not finite");
    for light in environment.lights {
        let Light::Directional { direction, irradiance, angular_radius } = light else { continue };
        assert!(direction.is_normalized() && irradiance.is_finite(), "{light:?}");
        assert!((0.0..1.0).contains(&angular_radius), "{light:?}");
    }
    Ok(())
}

/// A PNG with correct chunk checksums: otherwise every edited image is refused at once.
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

/// CRC-32 as in PNG, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let bit = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit))
}

/// A quad in PLY's binary form, in either byte order.
fn binary_ply(order: &str, float: fn(f32) -> [u8; 4], int: fn(i32) -> [u8; 4]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for (x, z) in [(0.0_f32, 0.0_f32), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        for value in [x, 0.5, z] {
            bytes.extend(float(value));
        }
        bytes.extend([255, 128, 0]);
    }
    bytes.push(4);
    (0..4_i32).for_each(|index| bytes.extend(int(index)));
    bytes
}

/// A glTF document in its binary container.
fn glb(json: &[u8]) -> Vec<u8> {
    container(&[(b"JSON", json)])
}

/// A triangle whose vertices are in the container too.
fn glb_with_blob() -> Vec<u8> {
    let json = br#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#;
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let blob: Vec<u8> = corners.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    container(&[(b"JSON", json), (b"BIN\0", &blob)])
}

fn container(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, chunk) in chunks {
        let length = chunk.len().next_multiple_of(4);
        body.extend((length as u32).to_le_bytes());
        body.extend(*kind);
        body.extend(*chunk);
        // JSON is padded with spaces; a reader of numbers ignores the bytes after them.
        body.resize(body.len() + length - chunk.len(), b' ');
    }
    let mut bytes = b"glTF".to_vec();
    for number in [2, 12 + body.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(body);
    bytes
}
