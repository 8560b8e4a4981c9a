//! Buffers, accessors and primitives.

use argus_scene::RigKind;
use glam::{DVec3, Vec3};
use serde_json::json;

use super::{changed, data_uri, load, load_with, refused, square};

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
fn references_to_missing_objects_are_named() {
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
    // An accessor of zeros has no bytes that limit its count.
    let mut zeros = square();
    zeros["accessors"][0] = json!({"componentType": 5126, "count": 1_000_000_000, "type": "VEC3"});
    assert!(refused(&zeros).contains("claims more"));
}

#[test]
fn arrays_shared_by_many_meshes_are_limited_in_total() {
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
fn only_triangles_with_vertices_that_are_nan_or_out_of_range_are_dropped() {
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
