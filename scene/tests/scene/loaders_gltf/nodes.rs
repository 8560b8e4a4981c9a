//! The hierarchy and its objects: instances, lights, cameras, animations.

use argus_scene::animation::Track;
use argus_scene::{Effect, Light, RigKind};
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use super::{data_uri, load, refused, square};

#[test]
fn loops_are_refused_and_nodes_with_two_parents_or_listed_twice_are_drawn_once() {
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
fn lights_and_cameras_have_their_nodes_transforms() {
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
fn height_fields_without_a_camera_are_sampled_from_above() {
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
