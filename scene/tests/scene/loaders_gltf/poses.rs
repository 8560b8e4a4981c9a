//! What moves vertices: skins, morph targets, and transforms that flatten.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_scene::reference::Tracer;
use argus_scene::{Bounds, Scene};
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use super::{data_uri, load, refused};

/// A document whose accessors are made here.
struct Made {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Made {
    fn new() -> Self {
        Self { bytes: Vec::new(), views: Vec::new(), accessors: Vec::new() }
    }

    /// Adds an accessor of little-endian numbers, and returns its index.
    fn add(&mut self, bytes: &[u8], component: u32, kind: &str, width: usize) -> usize {
        let size = [1, 1, 2, 2, 4, 4, 4][component as usize - 5120];
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend(bytes);
        let count = bytes.len() / (size * width);
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({"bufferView": view, "componentType": component, "type": kind, "count": count}));
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let kind = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        self.add(&bytes, 5126, kind, N)
    }

    /// The document with more members.
    fn with(&self, members: Value) -> Value {
        let mut document = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": self.bytes.len(), "uri": data_uri(&self.bytes)}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "scene": 0,
        });
        let all = document.as_object_mut().unwrap();
        members
            .as_object()
            .unwrap()
            .iter()
            .for_each(|(key, value)| drop(all.insert(key.clone(), value.clone())));
        document
    }
}

/// A quarter turn about z, from +x to +y.
const QUARTER: [f32; 4] = [0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2];
const STILL: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// A strip from y = 0 to 2 whose upper joint stands at y = 1: its vertices at 0 belong to the lower joint, those at 1 to
/// both alike, and those at 2 to the upper one. Returns the document and its weights, which tests may replace.
fn strip() -> (Made, Value) {
    let mut made = Made::new();
    let corners: Vec<[f32; 3]> = (0..6).map(|i| [(i % 2) as f32 * 0.5, (i / 2) as f32, 0.0]).collect();
    let positions = made.floats(&corners);
    let normals = made.floats(&[[0.0, 0.0, 1.0]; 6]);
    let triangles = [0u16, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4].map(u16::to_le_bytes).concat();
    let indices = made.add(&triangles, 5123, "SCALAR", 1);
    let joints = made.add(&[[0u8, 1, 0, 0]; 6].concat(), 5121, "VEC4", 4);
    // Each in its own measure: the loader normalises sums.
    let weights = made.floats(&[
        [1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.3, 0.3, 0.0, 0.0],
        [2.0, 2.0, 0.0, 0.0],
        [0.0, 0.7, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
    ]);
    let mut lowered = [0.0; 16];
    (0..4).for_each(|i| lowered[5 * i] = 1.0);
    let standing = lowered;
    lowered[13] = -1.0;
    let matrices = made.floats(&[standing, lowered]);
    let attributes =
        json!({"POSITION": positions, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let members = json!({
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": matrices}],
        "nodes": [
            {"mesh": 0, "skin": 0},
            {"name": "lower", "children": [2]},
            {"name": "upper", "translation": [0, 1, 0], "rotation": QUARTER},
        ],
        "scenes": [{"nodes": [0, 1]}],
    });
    (made, members)
}

/// World positions of a scene's only mesh at a time.
fn vertices(scene: &Scene, time_secs: f64) -> Vec<DVec3> {
    let scene = Arc::new(scene.clone()).posed(time_secs);
    let instance = scene.at(time_secs).instances[0];
    let mesh = &scene.meshes[instance.mesh as usize];
    let place = |p: &Vec3| instance.world_from_mesh.transform_point3(mesh.origin + p.as_dvec3());
    mesh.positions.iter().map(place).collect()
}

/// Whether a box holds a point, but for the rounding of vertices.
fn holds(bounds: &Bounds, point: DVec3) -> bool {
    (point.clamp(bounds.min, bounds.max) - point).length() < 1e-6
}

#[track_caller]
fn assert_near(seen: &[DVec3], right: &[[f64; 3]]) {
    let near = |(a, b): (&DVec3, &[f64; 3])| (*a - DVec3::from_array(*b)).length() < 1e-6;
    assert!(seen.len() == right.len() && seen.iter().zip(right).all(near), "{seen:?} instead of {right:?}");
}

/// The strip whose upper half turned from up to the left.
const BENT: [[f64; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [0.5, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.25, 1.25, 0.0],
    [-1.0, 1.0, 0.0],
    [-1.0, 1.5, 0.0],
];
/// The strip at rest.
const STRAIGHT: [[f64; 3]; 6] =
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 2.0, 0.0], [0.5, 2.0, 0.0]];

#[test]
fn joints_bend_a_strip_wherever_its_node_and_its_skeleton_are() {
    let (made, members) = strip();
    let scene = load(&made.with(members.clone())).unwrap();
    assert_near(&vertices(&scene, 0.0), &BENT);
    assert!(scene.warnings.is_empty() && !scene.is_animated(), "{:?}", scene.warnings);

    // The node of the mesh, and nodes above it, move nothing.
    let mut moved = members.clone();
    moved["nodes"][0] = json!({"mesh": 0, "skin": 0, "translation": [7, 8, 9], "scale": [3, 3, 3]});
    moved["nodes"].as_array_mut().unwrap().push(json!({"children": [0], "translation": [50, 0, 0]}));
    moved["scenes"][0]["nodes"] = json!([3, 1]);
    assert_near(&vertices(&load(&made.with(moved)).unwrap(), 0.0), &BENT);

    // Nodes above the skeleton do.
    let mut raised = members.clone();
    raised["nodes"].as_array_mut().unwrap().push(json!({"children": [1], "translation": [0, 10, 0]}));
    raised["scenes"][0]["nodes"] = json!([0, 3]);
    assert_near(&vertices(&load(&made.with(raised)).unwrap(), 0.0), &BENT.map(|[x, y, z]| [x, y + 10.0, z]));

    // One mesh with a skin and without.
    let mut twice = members;
    twice["nodes"].as_array_mut().unwrap().push(json!({"mesh": 0}));
    twice["scenes"][0]["nodes"] = json!([3, 0, 1]);
    let scene = load(&made.with(twice)).unwrap();
    assert_eq!((scene.instances.len(), scene.meshes.len()), (2, 2));
    assert_near(&vertices(&scene, 0.0), &STRAIGHT);
}

#[test]
fn a_skeleton_that_mirrors_keeps_the_front_of_its_mesh() {
    let (made, mut members) = strip();
    members["nodes"][1]["scale"] = json!([-1, 1, 1]);
    let scene = load(&made.with(members)).unwrap();
    assert_near(&vertices(&scene, 0.0), &BENT.map(|[x, y, z]| [-x, y, z]));
    assert_eq!(scene.meshes[0].normals[0], Vec3::Z);
    let hit = Tracer::new(Arc::new(scene)).trace(DVec3::new(-0.2, 0.4, 3.0), DVec3::NEG_Z).unwrap();
    assert!(hit.front);
}

#[test]
fn unusual_weights_and_matrices_are_read_and_broken_ones_warned_of() {
    // Fixed-point weights, 16-bit joints, and a second set of influences.
    let (mut made, mut members) = strip();
    let joints = made.add(
        &[[0u16, 1, 0, 0]; 6].concat().iter().flat_map(|j| j.to_le_bytes()).collect::<Vec<_>>(),
        5123,
        "VEC4",
        4,
    );
    let weights = made.add(
        &[[255u8, 0], [255, 0], [127, 127], [0, 0], [0, 255], [0, 9]].map(|[a, b]| [a, b, 0, 0]).concat(),
        5121,
        "VEC4",
        4,
    );
    made.accessors[weights]["normalized"] = json!(true);
    let second = made.floats(&[[0.0; 4], [0.0; 4], [0.0; 4], [1.0, 1.0, 0.0, 0.0], [0.0; 4], [0.0; 4]]);
    let attributes = &mut members["meshes"][0]["primitives"][0]["attributes"];
    (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(joints), json!(weights));
    (attributes["JOINTS_1"], attributes["WEIGHTS_1"]) = (json!(joints), json!(second));
    let scene = load(&made.with(members.clone())).unwrap();
    assert_near(&vertices(&scene, 0.0), &BENT);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);

    // A vertex without weights stays in its place, and so does all without matrices and turns.
    members["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("WEIGHTS_1");
    let scene = load(&made.with(members.clone())).unwrap();
    assert_near(&vertices(&scene, 0.0)[3..4], &STRAIGHT[3..4]);
    assert!(scene.warnings[0].contains("without a joint"), "{:?}", scene.warnings);

    let (made, members) = strip();
    let mut nan =
        Made { bytes: made.bytes.clone(), views: made.views.clone(), accessors: made.accessors.clone() };
    let broken = nan.floats(&[[f32::NAN; 16], [f32::INFINITY; 16]]);
    let few = nan.add(&[[0u8, 9, 0, 0]; 6].concat(), 5121, "VEC4", 4);
    for (pointer, value, line) in [
        ("/skins/0/inverseBindMatrices", json!(broken), "is not finite"),
        ("/meshes/0/primitives/0/attributes/JOINTS_0", json!(few), "does not have"),
        ("/skins/0/joints", json!([1]), "does not have"),
        ("/scenes/0/nodes", json!([0]), "not in the scene"),
    ] {
        let mut members = members.clone();
        *members.pointer_mut(pointer).unwrap() = value;
        let scene = load(&nan.with(members)).unwrap();
        assert!(scene.warnings.iter().any(|w| w.contains(line)), "{pointer}: {:?}", scene.warnings);
        assert!(vertices(&scene, 0.0).iter().all(|v| v.is_finite()), "{pointer}");
    }
    for (pointer, value, reason) in [
        ("/nodes/0/skin", json!(5), "skin 5 does not exist"),
        ("/skins/0/joints", json!([1, 77]), "node 77 does not exist"),
        ("/skins/0/inverseBindMatrices", json!(99), "accessor 99 does not exist"),
    ] {
        let mut members = members.clone();
        *members.pointer_mut(pointer).unwrap() = value;
        let line = refused(&made.with(members));
        assert!(line.contains(reason), "{pointer}: {line}");
    }
}

/// Adds an animation of one channel.
fn animate(
    made: &mut Made,
    members: &mut Value,
    name: &str,
    (node, path): (usize, &str),
    (times, values): (&[[f32; 1]], usize),
    how: &str,
) {
    let times = made.floats(times);
    let animation = json!({"name": name, "samplers": [{"input": times, "output": values, "interpolation": how}],
        "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]});
    match members.get_mut("animations").and_then(Value::as_array_mut) {
        Some(all) => all.push(animation),
        None => members["animations"] = json!([animation]),
    }
}

#[test]
fn a_channel_of_a_joint_bends_the_strip_at_its_time() {
    let (mut made, mut members) = strip();
    members["nodes"][2]["rotation"] = json!(STILL);
    let turns = made.floats(&[STILL, QUARTER]);
    animate(&mut made, &mut members, "bend", (2, "rotation"), (&[[0.0], [1.0]], turns), "LINEAR");
    let raised = made.floats(&[[0.0, 1.0, 0.0], [0.0, 5.0, 0.0]]);
    animate(&mut made, &mut members, "stretch", (2, "translation"), (&[[0.0], [1.0]], raised), "LINEAR");
    animate(&mut made, &mut members, "back", (2, "rotation"), (&[[0.0], [1.0]], turns), "STEP");
    // The third moves what the first does.
    let document = made.with(members);
    let scene = load(&document).unwrap();
    assert!(scene.is_animated() && scene.deforms());
    assert!(scene.warnings[0].contains("\"back\"") && scene.warnings.len() == 1, "{:?}", scene.warnings);
    assert_near(&vertices(&scene, 0.0), &STRAIGHT);
    // At half its time the joint has turned by 45° and stands at y = 3.
    let (c, s) = (0.5f64.sqrt(), 0.5f64.sqrt());
    let upper = |x: f64, y: f64| [c * x - s * y, 3.0 + s * x + c * y, 0.0];
    let mean = |[x, y, _]: [f64; 3], other: [f64; 2]| [(x + other[0]) / 2.0, (y + other[1]) / 2.0, 0.0];
    let half = [
        [0.0, 0.0, 0.0],
        [0.5, 0.0, 0.0],
        mean(upper(0.0, 0.0), [0.0, 1.0]),
        mean(upper(0.5, 0.0), [0.5, 1.0]),
        upper(0.0, 1.0),
        upper(0.5, 1.0),
    ];
    assert_near(&vertices(&scene, 0.5), &half);
    let bounds = scene.bounds();
    for i in 0..50 {
        assert!(vertices(&scene, f64::from(i) / 50.0).iter().all(|v| holds(&bounds, *v)), "{bounds:?}");
    }
    assert!(bounds.size().max_element() < 10.0, "{bounds:?}");
    // The reference's rays meet the strip where it is.
    let tracer = Tracer::new(Arc::new(scene));
    let middle = DVec3::from_array(upper(0.2, 0.8));
    let met = |time: f64| tracer.at(time).trace(middle + DVec3::Z, DVec3::NEG_Z).is_some();
    assert_eq!([0.0, 0.5, 0.25].map(met), [false, true, false]);
    assert_ne!(tracer.at(0.5).content_hash(), tracer.content_hash());
    assert_eq!(tracer.at(0.5).at(0.0).content_hash(), tracer.content_hash());

    chooses_by_name_or_number(&document);
}

/// Another animation is chosen by name or number.
#[cfg(feature = "procedural")]
fn chooses_by_name_or_number(document: &Value) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("strip.gltf");
    std::fs::write(&file, document.to_string()).unwrap();
    let file = file.display().to_string();
    for chosen in ["back", "2"] {
        let spec = format!("{file}+animation:{chosen}");
        let other = argus_scene::open(&spec).unwrap();
        assert_near(&vertices(&other, 0.1)[..2], &STRAIGHT[..2]);
        // A step has not turned yet.
        assert_near(&vertices(&other, 0.0), &STRAIGHT);
        assert!((vertices(&other, 0.9)[4] - DVec3::new(0.0, 5.6, 0.0)).length() < 1e-5);
        assert!(other.warnings[0].contains("\"bend\"") && other.warnings.len() == 1, "{:?}", other.warnings);
        assert_eq!(argus_scene::base_of(&spec), file);
        assert_ne!(other.hash, argus_scene::open(&file).unwrap().hash);
    }
    let wrong = argus_scene::open(&format!("{file}+animation:run")).unwrap_err().to_string();
    assert!(wrong.contains("\"stretch\"") && wrong.contains("no animation"), "{wrong}");
}

#[cfg(not(feature = "procedural"))]
fn chooses_by_name_or_number(_document: &Value) {}

/// A square of which a target lifts the corner (1, 1) by 4 along z.
fn lifted() -> (Made, Value) {
    let mut made = Made::new();
    let positions = made.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let normals = made.floats(&[[0.0, 0.0, 1.0]; 4]);
    let indices = made.add(&[0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes).concat(), 5123, "SCALAR", 1);
    let tilted = made.floats(&[[0.0; 3], [0.0; 3], [-2.0, 0.0, 0.0], [0.0; 3]]);
    // A sparse accessor without a view: zeros, but for the third corner.
    let corner = made.add(&[2u8], 5121, "SCALAR", 1);
    let by = made.floats(&[[0.0, 0.0, 4.0]]);
    let (corner, by) =
        (made.accessors[corner]["bufferView"].clone(), made.accessors[by]["bufferView"].clone());
    made.accessors.push(json!({"componentType": 5126, "type": "VEC3", "count": 4, "sparse": {"count": 1,
        "indices": {"bufferView": corner, "componentType": 5121}, "values": {"bufferView": by}}}));
    let lift = made.accessors.len() - 1;
    let members = json!({
        "meshes": [{"weights": [0.5], "primitives": [{"attributes": {"POSITION": positions, "NORMAL": normals},
            "indices": indices, "targets": [{"POSITION": lift, "NORMAL": tilted}]}]}],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0]}],
        "scenes": [{"nodes": [0]}],
    });
    (made, members)
}

#[test]
fn a_morph_target_moves_vertices_by_its_weight() {
    let heights = |scene: &Scene, time: f64| vertices(scene, time)[2].z;
    let (mut made, mut members) = lifted();
    let scene = load(&made.with(members.clone())).unwrap();
    assert_near(
        &vertices(&scene, 0.0),
        &[[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [11.0, 1.0, 2.0], [10.0, 1.0, 0.0]],
    );
    assert!((scene.meshes[0].normals[2] - Vec3::new(-1.0, 0.0, 1.0).normalize()).length() < 1e-6);
    assert!(scene.warnings.is_empty() && !scene.is_animated(), "{:?}", scene.warnings);
    members["nodes"][0]["weights"] = json!([0.25]);
    assert_eq!(heights(&load(&made.with(members.clone())).unwrap(), 0.0), 1.0);

    // Without normals, a triangle keeps that of its plane.
    let mut flat = members.clone();
    flat["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("NORMAL");
    let flat = load(&made.with(flat)).unwrap();
    assert!((flat.meshes[0].normals[0] - Vec3::new(0.0, -1.0, 1.0).normalize()).length() < 1e-6);

    // Channels of each interpolation: 0 to 1 in two seconds; half way the spline adds 2·(1 + 1)/8 of its tangents.
    for (how, values, right) in [
        ("LINEAR", vec![0.0, 1.0], 2.0),
        ("STEP", vec![0.0, 1.0], 0.0),
        ("CUBICSPLINE", vec![9.0, 0.0, 1.0, -1.0, 1.0, 9.0], 4.0),
    ] {
        let (mut made, mut members) = lifted();
        let values = made.floats(&values.into_iter().map(|v| [v]).collect::<Vec<[f32; 1]>>());
        animate(&mut made, &mut members, "lift", (0, "weights"), (&[[0.0], [2.0]], values), how);
        let scene = load(&made.with(members)).unwrap();
        assert!(scene.is_animated() && scene.warnings.is_empty(), "{how}: {:?}", scene.warnings);
        assert_eq!((heights(&scene, 0.0), heights(&scene, 1.0)), (0.0, right), "{how}");
        let bounds = scene.bounds();
        assert!(
            (0..40).all(|i| holds(&bounds, vertices(&scene, f64::from(i) * 0.05)[2])),
            "{how}: {bounds:?}"
        );
    }

    // What targets cannot move here is said.
    let colors = made.floats(&[[0.0; 3]; 4]);
    members["meshes"][0]["primitives"][0]["targets"][0]["COLOR_0"] = json!(colors);
    let scene = load(&made.with(members.clone())).unwrap();
    assert!(scene.warnings[0].contains("morph targets"), "{:?}", scene.warnings);
    // A target of two values for four vertices, and one that is not finite.
    let (few, nan) = (made.floats(&[[1.0; 3]; 2]), made.floats(&[[f32::NAN; 3]; 4]));
    members["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": few}, {"POSITION": nan}]);
    members["nodes"][0]["weights"] = json!([1, 1e30, 5]);
    let scene = load(&made.with(members)).unwrap();
    assert!(scene.warnings.iter().any(|w| w.contains("too few values")), "{:?}", scene.warnings);
    assert_eq!(heights(&scene, 0.0), 0.0);
}

/// A closed box of edge 2 around the origin under nodes.
fn boxed(nodes: Value) -> (Made, Value) {
    let mut made = Made::new();
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32 * 2.0 - 1.0);
    let positions = made.floats(&(0..8).map(corner).collect::<Vec<_>>());
    let faces = [[0u16, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles: Vec<u8> =
        faces.iter().flat_map(|f| [f[0], f[1], f[2], f[0], f[2], f[3]]).flat_map(u16::to_le_bytes).collect();
    let indices = made.add(&triangles, 5123, "SCALAR", 1);
    let members = json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": positions}, "indices": indices}]}],
        "nodes": nodes,
        "scenes": [{"nodes": [0]}],
    });
    (made, members)
}

/// The range and the shading normal that rays along −z and along −y meet.
fn seen(tracer: &Tracer) -> [Option<(f64, Vec3)>; 2] {
    [(DVec3::new(0.3, 0.2, 5.0), DVec3::NEG_Z), (DVec3::new(0.3, 5.0, 0.2), DVec3::NEG_Y)].map(
        |(from, way)| {
            let hit = tracer.trace(from, way)?;
            Some((hit.range, tracer.surface(&hit, way, DVec3::ZERO, DVec3::ZERO).normal))
        },
    )
}

#[test]
fn what_a_transform_flattens_is_seen_as_what_it_makes_thin() {
    let turned = json!([0.3, 0, 0, 0.953_939_2]);
    let under = |above: Value, own: Value| {
        let mut above = above;
        above["children"] = json!([1]);
        let mut own = own;
        own["mesh"] = json!(0);
        json!([above, own])
    };
    let matrix = |z: f64| json!({"matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, z, 0, 0, 0, 0, 1]});
    for (name, flat, thin) in [
        (
            "own scale",
            under(json!({}), json!({"scale": [1, 1, 0]})),
            under(json!({}), json!({"scale": [1, 1, 1e-4]})),
        ),
        (
            "mirrored",
            under(json!({}), json!({"scale": [-1, 1, 0]})),
            under(json!({}), json!({"scale": [-1, 1, 1e-4]})),
        ),
        ("matrix", under(json!({}), matrix(0.0)), under(json!({}), matrix(1e-4))),
        (
            "above a turned node",
            under(json!({"scale": [1, 0, 1]}), json!({"rotation": turned})),
            under(json!({"scale": [1, 1e-4, 1]}), json!({"rotation": turned})),
        ),
    ] {
        let [flat, thin] = [flat, thin].map(|nodes| {
            let (made, members) = boxed(nodes);
            load(&made.with(members)).unwrap()
        });
        assert!(flat.warnings.is_empty(), "{name}: {:?}", flat.warnings);
        let [flat, thin] = [flat, thin].map(|scene| seen(&Tracer::new(Arc::new(scene))));
        let mut met = 0;
        for (flat, thin) in flat.into_iter().zip(thin) {
            // Edge-on, only what is thin is met.
            let Some((range, normal)) = flat else { continue };
            let (right, right_normal) = thin.unwrap();
            assert!((range - right).abs() < 1e-3, "{name}: {range} instead of {right}");
            assert!(normal.dot(right_normal) > 0.999, "{name}: {normal} instead of {right_normal}");
            met += 1;
        }
        assert_eq!(met, 1, "{name}");
    }
    // On two or three axes nothing is left to see.
    for scale in [json!([0, 1, 0]), json!([0, 0, 0])] {
        let (made, members) = boxed(under(json!({}), json!({"scale": scale})));
        let scene = load(&made.with(members)).unwrap();
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        assert!(scene.meshes.iter().all(|mesh| mesh.positions.iter().all(|p| p.is_finite())));
        assert_eq!(seen(&Tracer::new(Arc::new(scene))), [None, None]);
    }
}

#[test]
fn a_thing_that_is_flat_for_a_moment_is_flat_then_and_whole_before_and_after() {
    let (mut made, mut members) = boxed(json!([{"mesh": 0, "translation": [0, 0, 1]}]));
    let scales =
        made.floats(&[[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.5], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]);
    animate(
        &mut made,
        &mut members,
        "squeeze",
        (0, "scale"),
        (&[[0.0], [1.0], [2.0], [3.0], [4.0]], scales),
        "LINEAR",
    );
    let scene = load(&made.with(members)).unwrap();
    assert!(scene.is_animated() && scene.warnings.is_empty(), "{:?}", scene.warnings);
    let tracer = Tracer::new(Arc::new(scene));
    // The front stands at z = 1 + its scale.
    for (time, right) in [
        (0.0, Some(3.0)),
        (0.5, Some(3.5)),
        (1.0, Some(4.0)),
        (2.0, Some(3.5)),
        (3.0, None),
        (3.9999, Some(3.0001)),
    ] {
        let range = seen(&tracer.at(time))[0].map(|(range, _)| range);
        let near = range.zip(right).is_some_and(|(a, b): (f64, f64)| (a - b).abs() < 1e-6);
        assert!(near || range == right, "{time}: {range:?} instead of {right:?}");
        assert!(seen(&tracer.at(time))[0].is_none_or(|(_, normal)| normal == Vec3::Z), "{time}");
    }
    assert_eq!(
        tracer.scene().bounds(),
        Bounds { min: DVec3::new(-1.0, -1.0, 0.0), max: DVec3::new(1.0, 1.0, 2.0) }
    );
}
