//! glTF documents made here, one for each thing that a loader can get wrong.

#![cfg(feature = "loaders")]

use std::collections::BTreeMap;

use argus_scene::load::{LoadError, load_bundle};
use argus_scene::scene::Track;
use argus_scene::{AlphaMode, Effect, Light, RigKind, Scene};
use base64::Engine;
use bytes::Bytes;
use glam::{DVec3, Vec3, Vec4};
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
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Object(object) => object.insert(key.to_owned(), value),
        Value::Array(array) => Some(std::mem::replace(&mut array[key.parse::<usize>().unwrap()], value)),
        _ => panic!("{pointer} leads nowhere"),
    };
    document
}

#[test]
fn a_square_is_two_triangles_with_flat_normals_under_sun_and_sky() {
    let scene = load(&square()).unwrap();
    assert_eq!(scene.triangles(), 2);
    assert!(scene.meshes[0].normals.iter().all(|n| *n == Vec3::Z));
    assert_eq!(scene.bounds().max, DVec3::new(1.0, 1.0, 0.0));
    assert_eq!(scene.lighting, argus_scene::Lighting::default());
    assert_eq!(scene.rig, RigKind::Cell);
}

#[test]
fn references_to_what_does_not_exist_are_named() {
    for (pointer, value, reason) in [
        ("/nodes/0/mesh", json!(7), "mesh 7 does not exist"),
        ("/scenes/0/nodes", json!([9]), "node 9 does not exist"),
        ("/scene", json!(3), "scene 3 does not exist"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(40), "accessor 40 does not exist"),
        ("/meshes/0/primitives/0/indices", json!(41), "accessor 41 does not exist"),
        ("/meshes/0/primitives/0/material", json!(42), "material 42 does not exist"),
        ("/accessors/0/bufferView", json!(43), "buffer view 43 does not exist"),
        ("/bufferViews/0/buffer", json!(44), "buffer 44 does not exist"),
        ("/nodes/0/children", json!([45]), "node 45 does not exist"),
    ] {
        let line = refused(&changed(pointer, value));
        assert!(line.contains(reason), "{pointer}: {line}");
    }
}

#[test]
fn counts_and_lengths_beyond_the_file_are_refused_before_memory_is_taken() {
    let huge = json!(u64::MAX);
    for (pointer, value, reason) in [
        ("/accessors/0/count", huge.clone(), "claims more"),
        ("/accessors/0/count", json!(5), "does not fit"),
        ("/accessors/1/count", json!(4_000_000_000u32), "claims more"),
        ("/accessors/0/byteOffset", huge.clone(), "does not fit"),
        ("/bufferViews/0/byteLength", huge.clone(), "does not fit"),
        ("/bufferViews/0/byteOffset", huge, "does not fit"),
        ("/bufferViews/0/byteStride", json!(4), "overlap"),
        ("/buffers/0/byteLength", json!(4096), "instead of 4096"),
        ("/accessors/0/type", json!("VEC2"), "another type"),
        ("/accessors/0/type", json!("VEC5"), "unknown"),
        ("/accessors/1/componentType", json!(5126), "does not fit"),
        ("/accessors/0/componentType", json!(1), "unknown"),
    ] {
        let line = refused(&changed(pointer, value.clone()));
        assert!(line.contains(reason), "{pointer} = {value}: {line}");
    }
    // An accessor of zeros has no bytes at all to show for its count.
    let mut zeros = square();
    zeros["accessors"][0] = json!({"componentType": 5126, "count": 1_000_000_000, "type": "VEC3"});
    assert!(refused(&zeros).contains("claims more"));
}

#[test]
fn arrays_that_many_meshes_share_do_not_multiply_without_end() {
    let mut document = square();
    let bytes = vec![0u8; 3 << 20];
    document["buffers"][0] = json!({"byteLength": bytes.len(), "uri": "a.bin"});
    document["bufferViews"] = json!([{"buffer": 0, "byteLength": bytes.len()}]);
    document["accessors"] =
        json!([{"bufferView": 0, "componentType": 5126, "count": bytes.len() / 12, "type": "VEC3"}]);
    let primitive = json!({"attributes": {"POSITION": 0}});
    document["meshes"] = json!([{"primitives": vec![primitive; 5000]}]);
    let line = load_with(&document, &[("a.bin", &bytes)]).expect_err("must be refused").to_string();
    assert!(line.contains("times its own size"), "{line}");
}

#[test]
fn loops_second_parents_and_doubly_listed_nodes() {
    let mut document = square();
    document["nodes"] = json!([{"children": [1]}, {"children": [2]}, {"children": [0]}]);
    assert!(refused(&document).contains("own ancestor"));
    document["nodes"] = json!([{"children": [0], "mesh": 0}]);
    assert!(refused(&document).contains("own ancestor"));

    // The scene lists a grandchild as a root: with its parents' transforms, once.
    document["nodes"] = json!([{"children": [1], "translation": [5, 0, 0]}, {"children": [2]}, {"mesh": 0}]);
    for order in [json!([0, 2]), json!([2, 0]), json!([2, 1, 0])] {
        document["scenes"][0]["nodes"] = order;
        let scene = load(&document).unwrap();
        assert_eq!((scene.triangles(), scene.bounds().min.x), (2, 5.0));
        assert!(scene.warnings.iter().any(|line| line.contains("drawn once")));
    }
    // A root whose parent is not in the scene is drawn as a root.
    document["scenes"][0]["nodes"] = json!([2]);
    assert_eq!(load(&document).unwrap().bounds().min.x, 0.0);

    document["nodes"] = json!([{"children": [2]}, {"children": [2]}, {"mesh": 0}]);
    document["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = load(&document).unwrap();
    assert_eq!(scene.triangles(), 2);
    assert!(scene.warnings.iter().any(|line| line.contains("two parents")));
}

#[test]
fn world_transforms_are_combined_in_f64() {
    let mut document = square();
    document["nodes"] = json!([
        {"children": [1], "translation": [16_777_216, 0, 0]},
        {"children": [2], "translation": [0.25, 0, 0], "scale": [0.5, 0.5, 0.5]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1]},
    ]);
    let scene = load(&document).unwrap();
    assert_eq!(scene.instances[0].world_from_mesh.translation.x, 16_777_217.25);
    assert_eq!(scene.nodes.iter().map(|n| n.parent).collect::<Vec<_>>(), [None, Some(0), Some(1)]);
}

#[test]
fn a_long_chain_of_nodes_does_not_overflow_the_stack() {
    let mut document = square();
    let count = 20_000;
    let mut nodes: Vec<Value> = (1..count).map(|child| json!({"children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    document["nodes"] = Value::Array(nodes);
    assert_eq!(load(&document).unwrap().triangles(), 2);
}

#[test]
fn a_mesh_of_two_nodes_is_stored_once() {
    let mut document = square();
    document["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}]);
    document["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = load(&document).unwrap();
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.triangles()), (1, 2, 4));
}

#[test]
fn vertices_that_are_nan_or_out_of_range_cost_their_triangles() {
    let mut document = square();
    let mut bytes: Vec<u8> =
        [f32::NAN, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.].iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 1, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([1u16, 2, 9].iter().flat_map(|i| i.to_le_bytes()));
    document["buffers"][0] = json!({"byteLength": bytes.len(), "uri": data_uri(&bytes)});
    document["bufferViews"][1]["byteLength"] = json!(18);
    document["accessors"][1]["count"] = json!(9);
    document["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": 0});
    let scene = load(&document).unwrap();
    assert_eq!(scene.triangles(), 1);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
}

#[test]
fn points_and_lines_are_skipped_with_a_warning() {
    let scene = load(&changed("/meshes/0/primitives/0/mode", json!(1))).unwrap();
    assert_eq!(scene.triangles(), 0);
    assert!(scene.warnings[0].contains("not drawn"));
    assert!(refused(&changed("/meshes/0/primitives/0/mode", json!(7))).contains("unknown mode"));
}

#[test]
fn sparse_and_quantised_accessors_are_decoded() {
    let mut document = square();
    let mut bytes = vec![3u8, 0];
    bytes.extend([2f32, 2., 2.].iter().flat_map(|x| x.to_le_bytes()));
    document["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 14, "uri": data_uri(&bytes)}));
    let views = document["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 1, "byteLength": 1}));
    views.push(json!({"buffer": 1, "byteOffset": 2, "byteLength": 12}));
    document["accessors"][0]["sparse"] =
        json!({"count": 1, "indices": {"bufferView": 3, "componentType": 5121}, "values": {"bufferView": 4}});
    assert_eq!(load(&document).unwrap().bounds().max, DVec3::splat(2.0));
    document["accessors"][0]["sparse"]["count"] = json!(2);
    assert!(refused(&document).contains("sparse"));

    let mut document = square();
    let corners: [[i16; 4]; 4] = [[0, 0, 0, 0], [32767, 0, 0, 0], [32767, 32767, 0, 0], [0, -32768, 0, 0]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u8, 1, 2, 0, 2, 3]);
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    document["buffers"][0] = json!({"byteLength": bytes.len(), "uri": data_uri(&bytes)});
    document["bufferViews"] = json!([{"buffer": 0, "byteLength": 32, "byteStride": 8}, {"buffer": 0, "byteOffset": 32, "byteLength": 6}]);
    document["accessors"] = json!([
        {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR"},
    ]);
    document["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": 0});
    let bounds = load(&document).unwrap().bounds();
    assert_eq!((bounds.max.x, bounds.min.y), (1.0, -1.0));
}

#[test]
fn names_outside_the_scenes_folder_are_never_opened() {
    for uri in
        ["../a.bin", "/etc/passwd", "file:///etc/passwd", "..%2fa.bin", "http://host/a.bin", "a\\..\\..\\b"]
    {
        let document = changed("/buffers/0/uri", json!(uri));
        let line = load_with(&document, &[("../a.bin", &[0; 92])]).expect_err(uri).to_string();
        assert!(line.contains("folder"), "{uri}: {line}");
    }
    let document = changed("/buffers/0/uri", json!("missing%20one.bin"));
    assert!(refused(&document).contains("missing one.bin: not in the bundle"));
    assert!(refused(&changed("/buffers/0/uri", json!("data:;base64,@@@@"))).contains("data URI"));
}

fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbaImage::from_pixel(2, 2, image::Rgba([200, 100, 50, 255]));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

/// A square whose material names one texture for everything.
fn textured(image: Value) -> Value {
    let mut document = square();
    document["images"] = json!([image]);
    document["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}]);
    document["textures"] = json!([{"source": 0, "sampler": 0}]);
    document["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}},
        "normalTexture": {"index": 0},
    }]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document
}

#[test]
fn textures_are_decoded_addressed_and_given_tangents() {
    let bytes = png();
    let scene =
        load_with(&textured(json!({"uri": "wood%20grain.png"})), &[("wood grain.png", &bytes)]).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // Colour and data read the same image differently.
    assert_eq!(scene.textures.len(), 2);
    assert_eq!(scene.textures[0].rgba[..4], [200, 100, 50, 255]);
    use argus_scene::material::Wrap;
    assert_eq!(scene.textures[0].wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert!(scene.meshes[0].tangents.iter().all(|t| (*t - Vec4::new(1., 0., 0., 1.)).length() < 1e-5));
}

#[test]
fn a_bad_texture_costs_that_texture_and_a_warning() {
    let whole = png();
    let cases: [(Value, &[u8]); 5] = [
        (json!({"uri": "x.png"}), &whole[..40]),
        (json!({"uri": "missing.png"}), &whole),
        (json!({"uri": "x.png"}), b"not an image"),
        (json!({"uri": "../x.png"}), &whole),
        (json!({"bufferView": 77, "mimeType": "image/png"}), &whole),
    ];
    for (image, bytes) in cases {
        let scene = load_with(&textured(image.clone()), &[("x.png", bytes)]).unwrap();
        assert_eq!((scene.triangles(), scene.textures.len()), (2, 0), "{image}");
        assert_eq!(scene.materials[0].base_color_texture, None);
        assert_eq!(scene.warnings.len(), 1, "{image}: {:?}", scene.warnings);
    }
}

#[test]
fn materials_keep_their_extensions() {
    let mut document = textured(json!({"uri": "x.png"}));
    document["materials"][0] = json!({
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true, "emissiveFactor": [1, 0.5, 0],
        "pbrMetallicRoughness": {"metallicFactor": 0.25, "roughnessFactor": 0.5, "baseColorTexture": {
            "index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 3], "rotation": 1}}}},
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 10},
            "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_transmission": {"transmissionFactor": 0.75},
        },
    });
    let scene = load_with(&document, &[("x.png", &png())]).unwrap();
    let material = &scene.materials[0];
    assert_eq!(material.alpha, AlphaMode::Mask(0.25));
    assert_eq!(material.emissive, Vec3::new(10.0, 5.0, 0.0));
    assert_eq!((material.ior, material.transmission, material.double_sided), (1.33, 0.75, true));
    let texture = material.base_color_texture.unwrap();
    assert_eq!((texture.offset.x, texture.scale.y, texture.rotation), (0.5, 3.0, 1.0));
    document["materials"][0] = json!({"alphaMode": "BLEND", "extensions": {"KHR_materials_unlit": {}}});
    let scene = load(&document).unwrap();
    assert_eq!((scene.materials[0].alpha, scene.materials[0].emissive), (AlphaMode::Blend, Vec3::ONE));
    assert!(scene.warnings.iter().any(|line| line.contains("blending")));
    document["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    assert!(refused(&document).contains("EXT_meshopt_compression"));
}

#[test]
fn lights_and_cameras_stand_where_their_nodes_do() {
    let mut document = square();
    document["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}},
        {"type": "perspective", "perspective": {"yfov": 9, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0}},
    ]);
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 0.5, 0], "intensity": 4, "range": 7, "spot": {"innerConeAngle": 2, "outerConeAngle": 1}},
        {"type": "directional", "intensity": 3},
        {"type": "sphere"},
    ]}});
    let light = |light: usize| json!({"KHR_lights_punctual": {"light": light}});
    // Turned a quarter to the left: −z becomes −x.
    let turned = json!([0, 0.707_106_77, 0, 0.707_106_77]);
    document["nodes"] = json!([
        {"mesh": 0}, {"camera": 0, "name": "door", "translation": [1, 2, 3], "rotation": turned},
        {"camera": 1}, {"camera": 2}, {"camera": 3},
        {"translation": [4, 5, 6], "extensions": light(0)}, {"rotation": turned, "extensions": light(1)},
        {"extensions": light(2)}, {"extensions": light(9)},
    ]);
    document["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4, 5, 6, 7, 8]);
    let scene = load(&document).unwrap();
    assert_eq!(scene.cameras.len(), 1);
    let camera = scene.cameras[0].camera;
    assert_eq!((scene.cameras[0].name.as_str(), camera.eye), ("door", DVec3::new(1.0, 2.0, 3.0)));
    assert!((camera.target - camera.eye - DVec3::NEG_X).length() < 1e-6);
    assert!((camera.fov_deg - 57.29578).abs() < 1e-4);
    assert_eq!(scene.lighting.sky, argus_scene::Sky::BLACK);
    let [
        Light::Spot { position, intensity, inner_cone, outer_cone, .. },
        Light::Directional { direction, .. },
    ] = scene.lighting.lights[..]
    else {
        panic!("{:?}", scene.lighting.lights)
    };
    assert_eq!((position, intensity), (DVec3::new(4.0, 5.0, 6.0), Vec3::new(4.0, 2.0, 0.0)));
    assert!(inner_cone < outer_cone);
    assert!((direction - DVec3::NEG_X).length() < 1e-6);
    assert_eq!(scene.warnings.len(), 5, "{:?}", scene.warnings);
}

#[test]
fn animations_follow_the_nodes_and_bad_channels_are_left_out() {
    let mut document = square();
    let numbers: [f32; 8] = [0., 1., 0., 0., 0., 1., 2., 3.];
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    document["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 32, "uri": data_uri(&bytes)}));
    let views = document["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 1, "byteLength": 8}));
    views.push(json!({"buffer": 1, "byteOffset": 8, "byteLength": 24}));
    let accessors = document["accessors"].as_array_mut().unwrap();
    accessors.push(json!({"bufferView": 3, "componentType": 5126, "count": 2, "type": "SCALAR"}));
    accessors.push(json!({"bufferView": 4, "componentType": 5126, "count": 2, "type": "VEC3"}));
    document["nodes"] = json!([{"children": [1]}, {"mesh": 0, "name": "moved"}]);
    document["animations"] = json!([{"name": "slide", "samplers": [{"input": 3, "output": 4}], "channels": [
        {"sampler": 0, "target": {"node": 1, "path": "translation"}},
        {"sampler": 0, "target": {"node": 1, "path": "rotation"}},
        {"sampler": 0, "target": {"node": 1, "path": "colour"}},
        {"sampler": 5, "target": {"node": 1, "path": "scale"}},
        {"sampler": 0, "target": {"node": 8, "path": "scale"}},
        {"sampler": 0, "target": {"path": "pointer"}},
    ]}]);
    let scene = load(&document).unwrap();
    assert_eq!(scene.animations.len(), 1);
    let channels = &scene.animations[0].channels;
    assert_eq!(channels.len(), 1);
    assert_eq!(scene.nodes[channels[0].node as usize].name, "moved");
    assert_eq!(channels[0].track, Track::Translation(vec![Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0)]));
    assert_eq!(scene.warnings.len(), 4, "{:?}", scene.warnings);
    assert!(scene.effects().contains(&Effect::Animation));
}

#[test]
fn height_fields_are_sampled_from_above_unless_somebody_placed_a_camera() {
    let mut document = square();
    // The square, laid down: 100 m × 100 m and no height.
    document["nodes"][0] =
        json!({"mesh": 0, "scale": [100, 100, 100], "rotation": [-0.707_106_77, 0, 0, 0.707_106_77]});
    assert_eq!(load(&document).unwrap().rig, RigKind::TileCorners);
    document["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]);
    document["nodes"].as_array_mut().unwrap().push(json!({"camera": 0}));
    document["scenes"][0]["nodes"] = json!([0, 1]);
    assert_eq!(load(&document).unwrap().rig, RigKind::Cell);
}
