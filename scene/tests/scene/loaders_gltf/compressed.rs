//! Compressed geometry and every kind of image file.
//!
//! `cube.drc` is a unit cube of 24 vertices with normals and texture coordinates, by Google's encoder. The images show
//! [`QUADRANTS`]; the KTX2 files are by the reference encoder of Basis Universal, and its decoder's texels are expected.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong
#![allow(clippy::type_complexity)] // rows of a table

use argus_scene::{Mesh, Scene, Texture};
use glam::{Vec2, Vec3};
use meshoptimizer_rs::{Workspace, codec};
use serde_json::{Value, json};

use super::{changed, data_uri, load, load_with, refused};

/// Colours of the quadrants, row by row.
const QUADRANTS: [[u8; 3]; 4] = [[200, 40, 40], [40, 160, 80], [40, 80, 200], [220, 220, 60]];

macro_rules! corpus {
    ($name:literal) => {
        include_bytes!(concat!("../../../../fuzz/corpus/loaders/", $name))
    };
}

const CUBE: &[u8] = corpus!("cube.drc");

/// A document of one mesh with these views of one buffer.
fn of_views(
    views: &[(Vec<u8>, Value)],
    accessors: Value,
    attributes: Value,
    indices: Option<usize>,
) -> Value {
    let mut bytes = Vec::new();
    let mut buffer_views = Vec::new();
    for (data, view) in views {
        let mut view = view.clone();
        let place = match view.pointer_mut("/extensions/EXT_meshopt_compression") {
            Some(packed) => packed,
            None => &mut view,
        };
        (place["buffer"], place["byteOffset"], place["byteLength"]) =
            (0.into(), bytes.len().into(), data.len().into());
        buffer_views.push(view);
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    let mut primitive = json!({"attributes": attributes, "material": 0});
    if let Some(indices) = indices {
        primitive["indices"] = indices.into();
    }
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": data_uri(&bytes)}, {"byteLength": 1 << 20}],
        "bufferViews": buffer_views,
        "accessors": accessors,
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": data_uri(corpus!("quadrants-palette.png"))}],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    })
}

/// A buffer view that meshopt has compressed. Its uncompressed bytes are in buffer 1, which is nowhere.
fn packed(mode: &str, filter: &str, count: usize, stride: usize) -> Value {
    let mut view = json!({
        "buffer": 1, "byteLength": count * stride,
        "extensions": {"EXT_meshopt_compression": {"count": count, "byteStride": stride, "mode": mode, "filter": filter}},
    });
    if mode == "ATTRIBUTES" {
        view["byteStride"] = stride.into();
    }
    view
}

fn floats<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn vertices(bytes: &[u8], stride: usize, version: codec::VertexEncoding) -> Vec<u8> {
    let count = bytes.len() / stride;
    codec::encode_vertex_buffer(bytes, count, stride, version, &mut Workspace::default()).unwrap()
}

const CORNERS: [[f32; 3]; 5] = [[0., 0., 0.], [2., 0., 0.], [2., 3., 0.], [0., 3., 0.], [1., 1., 4.]];
const INDICES: [u32; 9] = [0, 1, 2, 0, 2, 3, 1, 2, 4];

/// The corners' mesh, each view compressed by another mode and filter.
fn meshopt() -> Value {
    let workspace = &mut Workspace::default();
    let encoding = codec::VertexEncoding::new(0, 0).unwrap();
    let normals = [[0.6_f32, 0.0, 0.8, 0.0]; 5];
    let uvs = CORNERS.map(|[x, y, _]| [x * 0.25, y * 0.25]);
    let octahedral = codec::encode_filter_oct(5, 4, 8, normals.as_flattened(), workspace).unwrap();
    let exponents = codec::ExpMode::SharedVector;
    let exponential = codec::encode_filter_exp(5, 8, 15, uvs.as_flattened(), exponents, workspace).unwrap();
    let indices = codec::encode_index_buffer(&INDICES, codec::IndexEncoding::DEFAULT, workspace).unwrap();
    let views = [
        (vertices(&floats(&CORNERS), 12, encoding), packed("ATTRIBUTES", "NONE", 5, 12)),
        (vertices(&octahedral, 4, encoding), packed("ATTRIBUTES", "OCTAHEDRAL", 5, 4)),
        (vertices(&exponential, 8, encoding), packed("ATTRIBUTES", "EXPONENTIAL", 5, 8)),
        (indices, packed("TRIANGLES", "NONE", 9, 2)),
    ];
    let accessors = json!([
        {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5120, "normalized": true, "count": 5, "type": "VEC3"},
        {"bufferView": 2, "componentType": 5126, "count": 5, "type": "VEC2"},
        {"bufferView": 3, "componentType": 5123, "count": 9, "type": "SCALAR"},
    ]);
    of_views(&views, accessors, json!({"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}), Some(3))
}

/// Positions of each triangle from its least corner on, in an order that compression cannot change.
fn triangles(mesh: &Mesh) -> Vec<[[i32; 3]; 3]> {
    let at = |index: &u32| {
        (mesh.origin.as_vec3() + mesh.positions[*index as usize])
            .to_array()
            .map(|x| (x * 1000.0).round() as i32)
    };
    let mut found: Vec<_> = mesh
        .indices
        .chunks_exact(3)
        .map(|corners| {
            let mut corners = [at(&corners[0]), at(&corners[1]), at(&corners[2])];
            let least = (0..3).min_by_key(|&i| corners[i]).unwrap_or_default();
            corners.rotate_left(least);
            corners
        })
        .collect();
    found.sort_unstable();
    found
}

/// The triangles of [`CORNERS`].
fn expected() -> Vec<[[i32; 3]; 3]> {
    let positions = CORNERS.map(Vec3::from).to_vec();
    triangles(&Mesh { positions, indices: INDICES.to_vec(), ..Mesh::default() })
}

#[test]
fn meshopt_views_of_each_mode_and_filter_are_the_mesh_without_compression() {
    let document = meshopt();
    let scene = load(&document).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let mesh = &scene.meshes[0];
    assert_eq!(triangles(mesh), expected());
    assert!(mesh.normals.iter().all(|n| n.distance(Vec3::new(0.6, 0.0, 0.8)) < 0.02), "{:?}", mesh.normals);
    for (uv, [x, y, _]) in mesh.uvs.iter().zip(CORNERS) {
        assert!(uv.distance(Vec2::new(x, y) * 0.25) < 1e-3, "{uv}");
    }
    // The same under the other names, and required.
    for name in ["KHR_meshopt_compression", "MESHOPT_compression"] {
        let mut text: Value = document.to_string().replace("EXT_meshopt_compression", name).parse().unwrap();
        text["extensionsRequired"] = json!([name]);
        assert_eq!(load(&text).unwrap().meshes, scene.meshes, "{name}");
    }
    // Indices as a sequence, and vertices by the later version of the codec.
    let workspace = &mut Workspace::default();
    let sequence = codec::encode_index_sequence(&INDICES, codec::IndexEncoding::DEFAULT, workspace).unwrap();
    let later = codec::VertexEncoding::DEFAULT;
    let views = [
        (vertices(&floats(&CORNERS), 12, later), packed("ATTRIBUTES", "NONE", 5, 12)),
        (sequence, packed("INDICES", "NONE", 9, 4)),
    ];
    let accessors = json!([
        {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": 9, "type": "SCALAR"},
    ]);
    let document = of_views(&views, accessors, json!({"POSITION": 0}), Some(1));
    assert_eq!(triangles(&load(&document).unwrap().meshes[0]), expected());
}

/// The cube by Draco. Accessors have no buffer views, as is usual.
fn draco() -> Value {
    let accessors = json!([
        {"componentType": 5126, "count": 24, "type": "VEC3"},
        {"componentType": 5126, "count": 24, "type": "VEC3"},
        {"componentType": 5126, "count": 24, "type": "VEC2"},
        {"componentType": 5123, "count": 36, "type": "SCALAR"},
    ]);
    let attributes = json!({"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2});
    let mut document = of_views(&[(CUBE.to_vec(), json!({}))], accessors, attributes, Some(3));
    document["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    document["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression":
        {"bufferView": 0, "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}}});
    document
}

#[test]
fn a_draco_primitive_is_its_mesh() {
    // Ids of attributes are in the encoder's order.
    let mut document = draco();
    let ids = json!({"TEXCOORD_0": 0, "NORMAL": 1, "POSITION": 2});
    document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"] = ids;
    let scene = load(&document).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.positions.len(), mesh.triangles()), (24, 12));
    let bounds = scene.bounds();
    assert!(bounds.min.length() < 1e-3 && bounds.max.distance(glam::DVec3::ONE) < 1e-3, "{bounds:?}");
    for corners in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|i| mesh.positions[corners[i] as usize]);
        let normal = (b - a).cross(c - a).normalize();
        let outwards = mesh.origin.as_vec3() + (a + b + c) / 3.0 - 0.5;
        assert!(normal.dot(outwards) > 0.0, "a face looks inwards");
        for corner in corners {
            assert!(mesh.normals[*corner as usize].dot(normal) > 0.99);
        }
    }
    let mut uvs: Vec<[i32; 2]> =
        mesh.uvs.iter().map(|uv| [uv.x.round() as i32, uv.y.round() as i32]).collect();
    uvs.sort_unstable();
    uvs.dedup();
    assert_eq!(uvs, [[0, 0], [0, 1], [1, 0], [1, 1]]);
}

#[test]
fn integers_of_quantised_meshes_are_scaled_as_their_accessors_say() {
    let positions: Vec<u8> =
        CORNERS.iter().flat_map(|p| [p[0], p[1], p[2], 0.0]).flat_map(|x| (x as i16).to_le_bytes()).collect();
    let uvs: Vec<u8> = CORNERS
        .iter()
        .flat_map(|p| [p[0], p[1]])
        .flat_map(|x| ((x * 16383.75) as u16).to_le_bytes())
        .collect();
    let normals = [[76_i8 as u8, 0, 102, 0]; 5].concat();
    let views = [
        (positions, json!({"byteStride": 8})),
        (uvs, json!({"byteStride": 4})),
        (normals, json!({"byteStride": 4})),
        (INDICES.map(|index| index as u8).to_vec(), json!({})),
    ];
    let accessors = json!([
        {"bufferView": 0, "componentType": 5122, "count": 5, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "normalized": true, "count": 5, "type": "VEC2"},
        {"bufferView": 2, "componentType": 5120, "normalized": true, "count": 5, "type": "VEC3"},
        {"bufferView": 3, "componentType": 5121, "count": 9, "type": "SCALAR"},
    ]);
    let attributes = json!({"POSITION": 0, "TEXCOORD_0": 1, "NORMAL": 2});
    let mut document = of_views(&views, accessors, attributes, Some(3));
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = load(&document).unwrap();
    let mesh = &scene.meshes[0];
    assert_eq!(triangles(mesh), expected());
    assert!(mesh.uvs[2].distance(Vec2::new(0.5, 0.75)) < 1e-3, "{}", mesh.uvs[2]);
    assert!(mesh.normals[0].distance(Vec3::new(0.6, 0.0, 0.8)) < 0.01, "{}", mesh.normals[0]);
}

/// A square with the image as its base colour, by the path of `extension` or as it is.
fn textured(image: &[u8], extension: Option<&str>) -> Value {
    let mut document = changed("/meshes/0/primitives/0/material", 0.into());
    document["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    document["images"] = json!([{"uri": data_uri(image)}, {"uri": "none.png"}]);
    document["textures"] = match extension {
        Some(name) => json!([{"source": 1, "extensions": {name: {"source": 0}}}]),
        None => json!([{"source": 0}]),
    };
    document["extensionsRequired"] = extension.into_iter().collect();
    document
}

/// The texel in the middle of each quadrant.
fn quadrants(texture: &Texture) -> [[u8; 4]; 4] {
    std::array::from_fn(|i| {
        let (x, y) =
            (texture.width as usize * (1 + 2 * (i % 2)) / 4, texture.height as usize * (1 + 2 * (i / 2)) / 4);
        let at = (y * texture.width as usize + x) * 4;
        std::array::from_fn(|channel| texture.rgba[at + channel])
    })
}

fn shown(document: &Value, name: &str) -> Scene {
    let scene = load(document).unwrap();
    assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
    assert_eq!(scene.textures.len(), 1, "{name}");
    scene
}

/// A KTX2 file of one level.
pub(super) fn ktx2(
    format: u32,
    size: [u32; 2],
    scheme: u32,
    level: &[u8],
    swizzle: Option<&[u8; 4]>,
) -> Vec<u8> {
    let pairs =
        swizzle.map_or(Vec::new(), |s| [&16u32.to_le_bytes()[..], b"KTXswizzle\0", s, b"\0"].concat());
    let words =
        [format, 1, size[0], size[1], 0, 0, 1, 1, scheme, 104, 0, 104, pairs.len() as u32, 0, 0, 0, 0];
    let longs = [104 + pairs.len(), level.len(), level.len()].map(|long| (long as u64).to_le_bytes());
    let words = words.map(u32::to_le_bytes);
    [b"\xabKTX 20\xbb\r\n\x1a\n", words.as_flattened(), longs.as_flattened(), &pairs, level].concat()
}

/// The quadrants in 8 by 8 texels, by a function of a colour.
fn texels<const N: usize>(of: impl Fn([u8; 3]) -> [u8; N]) -> Vec<u8> {
    (0..64).flat_map(|i| of(QUADRANTS[(i % 8) / 4 + i / 32 * 2])).collect()
}

#[test]
fn images_of_every_format_show_their_colours() {
    let opaque = QUADRANTS.map(|[r, g, b]| [r, g, b, 255]);
    let grey = QUADRANTS.map(|[r, ..]| [r, r, r, 255]);
    let grey_alpha = QUADRANTS.map(|[r, g, _]| [r, r, r, g]);
    let translucent = [opaque[0], opaque[1], [40, 80, 200, 128], [220, 220, 60, 128]];
    let red = QUADRANTS.map(|[r, ..]| [r, 0, 0, 255]);
    let rgb = texels(|color| color);
    let image = |format: image::ImageFormat, kind: image::ColorType, texels: &[u8]| {
        let mut file = std::io::Cursor::new(Vec::new());
        image::write_buffer_with_format(&mut file, texels, 8, 8, kind, format).unwrap();
        file.into_inner()
    };
    use image::ColorType::{L8, L16, La8, Rgb8, Rgb16, Rgba8};
    use image::ImageFormat::{Bmp, Gif, Png, WebP};
    let wide = |bytes: Vec<u8>| {
        bytes.iter().flat_map(|&byte| (u16::from(byte) * 257).to_ne_bytes()).collect::<Vec<u8>>()
    };
    let wide_le = |bytes: Vec<u8>| {
        bytes.iter().flat_map(|&byte| (u16::from(byte) * 257).to_le_bytes()).collect::<Vec<u8>>()
    };
    let rgba = texels(|[r, g, b]| [r, g, b, 255]);
    let zstandard = zstd::bulk::compress(&rgb, 3).unwrap();
    let table: [(&str, Vec<u8>, Option<&str>, [[u8; 4]; 4], u8); 27] = [
        ("etc1s", corpus!("quadrants-etc1s.ktx2").to_vec(), Some("KHR_texture_basisu"), opaque, 4),
        ("etc1s and alpha", corpus!("quadrants-etc1s-alpha.ktx2").to_vec(), None, translucent, 4),
        (
            "uastc, zstandard",
            corpus!("quadrants-uastc.ktx2").to_vec(),
            Some("KHR_texture_basisu"),
            translucent,
            0,
        ),
        ("astc", corpus!("quadrants-astc.ktx2").to_vec(), None, translucent, 11),
        ("ktx2 r8", ktx2(9, [8, 8], 0, &texels(|[r, ..]| [r]), None), None, red, 0),
        ("ktx2 r8 swizzled", ktx2(9, [8, 8], 0, &texels(|[r, ..]| [r]), Some(b"rrr1")), None, grey, 0),
        ("ktx2 rg8", ktx2(16, [8, 8], 0, &texels(|[r, g, _]| [r, g]), Some(b"rrrg")), None, grey_alpha, 0),
        ("ktx2 rgb8 srgb", ktx2(29, [8, 8], 0, &rgb, None), None, opaque, 0),
        ("ktx2 rgb8, zstandard", ktx2(23, [8, 8], 2, &zstandard, None), None, opaque, 0),
        ("ktx2 rgb8, zlib", ktx2(23, [8, 8], 3, &zlib(&rgb), None), None, opaque, 0),
        ("ktx2 rgba8", ktx2(37, [8, 8], 0, &rgba, None), None, opaque, 0),
        ("ktx2 bgra8", ktx2(44, [8, 8], 0, &texels(|[r, g, b]| [b, g, r, 255]), None), None, opaque, 0),
        ("ktx2 rgba16", ktx2(91, [8, 8], 0, &wide_le(rgba.clone()), None), None, opaque, 0),
        ("webp", image(WebP, Rgb8, &rgb), Some("EXT_texture_webp"), opaque, 0),
        ("webp by itself", image(WebP, Rgb8, &rgb), None, opaque, 0),
        ("webp with loss", corpus!("quadrants-lossy.webp").to_vec(), Some("EXT_texture_webp"), opaque, 3),
        ("gif", image(Gif, Rgba8, &rgba), None, opaque, 8),
        ("bmp", image(Bmp, Rgb8, &rgb), None, opaque, 0),
        ("png", image(Png, Rgb8, &rgb), None, opaque, 0),
        ("png of 16 bits", image(Png, Rgb16, &wide(rgb.clone())), None, opaque, 0),
        ("grey png", image(Png, L8, &texels(|[r, ..]| [r])), None, grey, 0),
        ("grey png of 16 bits", image(Png, L16, &wide(texels(|[r, ..]| [r]))), None, grey, 0),
        ("grey png and alpha", image(Png, La8, &texels(|[r, g, _]| [r, g])), None, grey_alpha, 0),
        ("png with a palette", corpus!("quadrants-palette.png").to_vec(), None, opaque, 0),
        ("progressive jpeg", corpus!("quadrants-progressive.jpg").to_vec(), None, opaque, 3),
        ("cmyk jpeg", corpus!("quadrants-cmyk.jpg").to_vec(), None, opaque, 3),
        ("dds", dds(), Some("MSFT_texture_dds"), [[255, 0, 0, 255]; 4], 0),
    ];
    for (name, bytes, extension, expected, tolerance) in table {
        let scene = shown(&textured(&bytes, extension), name);
        for (found, expected) in
            quadrants(&scene.textures[0]).as_flattened().iter().zip(expected.as_flattened())
        {
            let found_all = quadrants(&scene.textures[0]);
            assert!(found.abs_diff(*expected) <= tolerance, "{name}: {found_all:?}");
        }
    }
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    encoder.finish().unwrap()
}

/// A DDS file of 8 by 8 texels of red in BC1.
fn dds() -> Vec<u8> {
    let mut words = [0u32; 32];
    words[0] = u32::from_le_bytes(*b"DDS ");
    (words[1], words[2], words[3], words[4]) = (124, 0x1007, 8, 8);
    (words[19], words[20], words[21], words[27]) = (32, 4, u32::from_le_bytes(*b"DXT1"), 0x1000);
    let block = [0x00, 0xf8, 0x00, 0xf8, 0, 0, 0, 0];
    [words.map(u32::to_le_bytes).as_flattened(), &[block; 4].concat()].concat()
}

#[test]
fn an_image_is_read_by_its_content_whatever_its_type_or_name_says() {
    for image in [json!({"mimeType": "image/png"}), json!({"mimeType": "nonsense"}), json!({"name": "x.png"})]
    {
        let mut document = textured(b"", None);
        document["images"][0] = image;
        document["images"][0]["uri"] = data_uri(corpus!("quadrants-progressive.jpg")).into();
        shown(&document, "data URI");
        let uastc = corpus!("quadrants-uastc.ktx2");
        document["images"][0]["uri"] = "odd name.png".into();
        let scene = load_with(&document, &[("odd name.png", uastc)]).unwrap();
        assert_eq!((scene.textures.len(), scene.warnings.len()), (1, 0), "{:?}", scene.warnings);
    }
}

#[test]
fn an_image_of_a_format_that_is_not_read_costs_its_texture_and_a_warning_that_names_it() {
    let avif = b"\0\0\0\x1cftypavif\0\0\0\0mif1miafavif".as_slice();
    let table: [(&str, Vec<u8>, Option<&str>, &str); 7] = [
        ("avif", avif.to_vec(), None, "Avif"),
        ("bc7", ktx2(145, [8, 8], 0, &[0; 64], None), None, "Vulkan format 145"),
        ("half floats", ktx2(97, [8, 8], 0, &[0; 512], None), None, "Vulkan format 97"),
        ("short", ktx2(37, [8, 8], 0, &[0; 255], None), None, "does not have 256 bytes"),
        ("broken", ktx2(37, [8, 8], 2, &[7; 99], None), None, "cannot be unpacked"),
        // 13 bytes of three each: the decoder panics.
        ("palette", corpus!("broken-palette.png").to_vec(), None, "is broken"),
        ("large", ktx2(37, [20_000, 4], 0, &[0; 99], None), None, "1 to 16384"),
    ];
    for (name, bytes, extension, words) in table {
        let scene = load(&textured(&bytes, extension)).unwrap();
        assert_eq!((scene.textures.len(), scene.warnings.len()), (0, 1), "{name}: {:?}", scene.warnings);
        assert!(scene.warnings[0].contains(words), "{name}: {:?}", scene.warnings);
    }
    // With an image of another format beside it, nothing is lost.
    let mut document = textured(avif, Some("EXT_texture_avif"));
    document["images"][1] = json!({"uri": data_uri(corpus!("quadrants-palette.png"))});
    shown(&document, "fallback");
    document["textures"][0].as_object_mut().unwrap().remove("source");
    assert!(load(&document).unwrap().warnings[0].contains("Avif"));
}

/// Time that a hostile file may take.
const LONGEST: std::time::Duration = std::time::Duration::from_secs(10);

#[test]
fn hostile_compressed_geometry_is_refused_at_once() {
    let meshopt = |pointer: &str, value: Value| {
        let mut document = meshopt();
        *document.pointer_mut(&format!("/bufferViews/{pointer}")).unwrap() = value;
        document
    };
    let extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    let draco = |pointer: &str, value: Value| {
        let mut document = draco();
        let parent =
            if pointer.starts_with('/') { pointer.to_owned() } else { format!("{extension}/{pointer}") };
        *document.pointer_mut(&parent).unwrap() = value;
        document
    };
    let table: [(&str, Value); 17] = [
        ("no compressed bytes", meshopt("0/extensions/EXT_meshopt_compression/byteLength", 0.into())),
        ("cut short", meshopt("0/extensions/EXT_meshopt_compression/byteLength", 20.into())),
        ("out of its buffer", meshopt("0/extensions/EXT_meshopt_compression/byteOffset", 9999.into())),
        ("a buffer that is nowhere", meshopt("0/extensions/EXT_meshopt_compression/buffer", 1.into())),
        ("a buffer that does not exist", meshopt("0/extensions/EXT_meshopt_compression/buffer", 9.into())),
        ("2^60 elements", meshopt("0/extensions/EXT_meshopt_compression/count", (1u64 << 60).into())),
        ("2^31 elements", meshopt("0/extensions/EXT_meshopt_compression/count", (1u64 << 31).into())),
        ("fewer elements", meshopt("0/extensions/EXT_meshopt_compression/count", 2.into())),
        ("no stride", meshopt("0/extensions/EXT_meshopt_compression/byteStride", 0.into())),
        ("an odd stride", meshopt("0/extensions/EXT_meshopt_compression/byteStride", 13.into())),
        ("an unknown mode", meshopt("0/extensions/EXT_meshopt_compression/mode", "POINTS".into())),
        ("an unknown filter", meshopt("0/extensions/EXT_meshopt_compression/filter", "WAVELET".into())),
        ("a filter of indices", meshopt("3/extensions/EXT_meshopt_compression/filter", "OCTAHEDRAL".into())),
        ("no attribute of this id", draco("attributes/POSITION", 77.into())),
        ("a view that does not exist", draco("bufferView", 5.into())),
        ("few bytes", draco("/bufferViews/0/byteLength", 30.into())),
        ("a position of two numbers", draco("attributes/POSITION", 0.into())),
    ];
    for (name, document) in table {
        let began = std::time::Instant::now();
        let line = refused(&document);
        assert!(
            line.contains("accessor")
                || line.contains("buffer view")
                || line.contains("meshopt")
                || line.contains("Draco"),
            "{name}: {line}"
        );
        assert!(began.elapsed() < LONGEST, "{name}: {:?}", began.elapsed());
    }
}

#[test]
fn a_small_file_that_claims_a_large_even_image_gets_little_memory() {
    // 16384² texels in a few bytes, as WebP, Zstandard and BasisLZ can have them.
    let mut etc1s = corpus!("quadrants-etc1s.ktx2").to_vec();
    etc1s[20..28].copy_from_slice(&[0, 0x40, 0, 0, 0, 0x40, 0, 0]);
    for bytes in
        [etc1s, ktx2(37, [16384, 16384], 2, &[0; 40], None), ktx2(37, [9, u32::MAX], 2, &[0; 40], None)]
    {
        let began = std::time::Instant::now();
        let scene = load(&textured(&bytes, None)).unwrap();
        assert_eq!((scene.textures.len(), scene.warnings.len()), (0, 1));
        assert!(began.elapsed() < LONGEST, "{:?}", began.elapsed());
    }
    // An even image of a usual size is shown.
    let even = zstd::bulk::compress(&vec![200; 2048 * 2048 * 3], 1).unwrap();
    assert!(even.len() < 2048 * 2048 * 4 / 1100);
    shown(&textured(&ktx2(23, [2048, 2048], 2, &even, None), None), "even");
}
