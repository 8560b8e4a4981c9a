//! A moving scene, from its file to the frames of a session, with a real coordinator and real workers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use crate::support::wire::Wire;
use crate::support::{Coordinator, run, stderr};
use argus_client::{Client, RenderOptions, SessionEvent, SessionOptions};
use argus_scene::metrics::compare;
use argus_scene::reference::Tracer;
use argus_scene::{Camera, Frame, Output, Plan, Provenance, SceneState, View};
use glam::DVec3;
use image::RgbImage;
use serde_json::{Value, json};

const SIZE: [u32; 2] = [160, 120];
/// Interval of epochs, milliseconds: about the time in which this machine renders four small samples.
const EPOCH_MS: u32 = 200;

/// What moves the red box.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Mover {
    /// Its node.
    Node,
    /// The joint of its skin.
    Joint,
    /// A client. Nothing is animated, and a hundred pebbles lie beside the boxes.
    Client,
}

/// Writes a scene of a floor and two boxes; the red one moves from x = −3 to 3 and back in four seconds.
pub(crate) fn write_scene(folder: &Path, mover: Mover) -> PathBuf {
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32 * 2.0 - 1.0);
    let faces = [[0u16, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut bytes: Vec<u8> = (0..8).flat_map(corner).flat_map(f32::to_le_bytes).collect();
    let triangles = faces.iter().flat_map(|f| [f[0], f[1], f[2], f[0], f[2], f[3]]);
    bytes.extend(triangles.flat_map(u16::to_le_bytes));
    let times = [0.0_f32, 2.0, 4.0];
    let places = [[-3.0_f32, 1.0, 1.0], [3.0, 1.0, 1.0], [-3.0, 1.0, 1.0]];
    bytes.extend(times.into_iter().chain(places.into_iter().flatten()).flat_map(f32::to_le_bytes));
    // All vertices belong to joint 0.
    bytes.extend([[0u8; 4]; 8].concat());
    bytes.extend((0..8).flat_map(|_| [1.0_f32, 0.0, 0.0, 0.0]).flat_map(f32::to_le_bytes));
    std::fs::write(folder.join("boxes.bin"), &bytes).unwrap();
    let view =
        |offset: usize, length: usize| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    let mesh = |material: u32| json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": material}]});
    let paint =
        |color: [f32; 4]| json!({"pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0}});
    let mut document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": "boxes.bin"}],
        "bufferViews": [view(0, 96), view(96, 72), view(168, 12), view(180, 36), view(216, 32), view(248, 128)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "SCALAR", "min": [0], "max": [4]},
            {"bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 4, "componentType": 5121, "count": 8, "type": "VEC4"},
            {"bufferView": 5, "componentType": 5126, "count": 8, "type": "VEC4"},
        ],
        "materials": [paint([0.7, 0.7, 0.7, 1.0]), paint([0.1, 0.2, 0.8, 1.0]), paint([0.9, 0.05, 0.05, 1.0])],
        "meshes": [mesh(0), mesh(1), mesh(2)],
        "nodes": [
            {"mesh": 0, "scale": [6, 0.1, 6], "translation": [0, -0.1, 0]},
            {"mesh": 1, "scale": [0.7, 0.7, 0.7], "translation": [0, 0.7, -2.5]},
            {"mesh": 2, "scale": [0.8, 0.8, 0.8], "translation": [9, 9, 9]},
        ],
        "animations": [{
            "samplers": [{"input": 2, "output": 3, "interpolation": "LINEAR"}],
            "channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}],
        }],
        "scenes": [{"nodes": [0, 1, 2]}],
        "scene": 0,
    });
    if mover == Mover::Joint {
        // The joint has the transform of the box, and the box stands elsewhere.
        let attributes = &mut document["meshes"][2]["primitives"][0]["attributes"];
        (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(4), json!(5));
        document["skins"] = json!([{"joints": [2]}]);
        document["nodes"]
            .as_array_mut()
            .unwrap()
            .push(json!({"mesh": 2, "skin": 0, "translation": [0, 50, 0]}));
        document["nodes"][2].as_object_mut().unwrap().remove("mesh");
        document["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    }
    if mover == Mover::Client {
        document.as_object_mut().unwrap().remove("animations");
        let nodes = document["nodes"].as_array_mut().unwrap();
        for (node, name) in nodes.iter_mut().zip(["floor", "blue", "red"]) {
            node["name"] = json!(name);
        }
        nodes[2]["translation"] = json!([-3, 1, 1]);
        let pebble = |i: u32| {
            let at = [f64::from(i % 10) - 4.5, 0.1, -5.0 + 0.1 * f64::from(i / 10)];
            json!({"mesh": 1, "name": format!("pebble {i}"), "scale": [0.05, 0.05, 0.05], "translation": at})
        };
        nodes.extend((0..100).map(pebble));
        document["scenes"][0]["nodes"] = (0..103).collect();
    }
    let path = folder.join("boxes.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    path
}

pub(crate) fn camera() -> Camera {
    Camera::look_at(DVec3::new(1.0, 9.0, 9.0), DVec3::new(0.0, 0.0, 0.5))
}

pub(crate) fn view() -> View {
    View::new(camera(), SIZE, argus_scene::PlanRequest::from_samples())
}

pub(crate) fn image(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width, frame.height, frame.images[Output::Color].clone().unwrap().to_vec())
        .unwrap()
}

fn flip(truth: &RgbImage, ours: &RgbImage) -> f64 {
    compare(truth, ours).unwrap().flip_mean
}

/// Position of the moving box at an epoch.
fn true_x(epoch: u64) -> f64 {
    let phase = (epoch as f64 * f64::from(EPOCH_MS) * 1e-3).rem_euclid(4.0);
    3.0 - 3.0 * (phase - 2.0).abs()
}

/// Mean column of the red pixels.
pub(crate) fn red_column(image: &RgbImage) -> f64 {
    let red = |p: &image::Rgb<u8>| p.0[0] > 50 && p.0[0] / 2 > p.0[1].max(p.0[2]);
    let columns: Vec<f64> =
        image.enumerate_pixels().filter(|(_, _, p)| red(p)).map(|(x, _, _)| f64::from(x)).collect();
    assert!(columns.len() > 50, "the box is seen");
    columns.iter().sum::<f64>() / columns.len() as f64
}

pub(crate) fn start(folder: &Path, mover: Mover, more: &[&str]) -> Coordinator {
    let scene = write_scene(folder, mover);
    let epoch = EPOCH_MS.to_string();
    let arguments = ["--rig", "tile-corners", "--sample-size", "240x180", "--epoch-ms", &epoch];
    Coordinator::start(scene.to_str().unwrap(), &[&arguments, more].concat())
}

/// Frames of a session, requested one after the other.
async fn session(url: &str, frames: usize) -> Vec<Frame> {
    let client = Client::connect(url).await.unwrap();
    let mut session = client.session(SessionOptions::default());
    let mut seen = Vec::new();
    while seen.len() < frames {
        session.send(&view());
        match tokio::time::timeout(Duration::from_secs(60), session.next()).await.unwrap().unwrap() {
            SessionEvent::Frame { frame, .. } => seen.push(*frame),
            SessionEvent::Failed { error, .. } => panic!("{error}"),
        }
        tokio::time::sleep(Duration::from_millis(40)).await;
    }
    seen
}

fn direct_at(epoch: u64, like: &Provenance) -> View {
    let plan = Plan::direct(4);
    View {
        pin: Some(Provenance {
            state: SceneState::of_epoch(epoch),
            plan,
            device: String::new(),
            ..like.clone()
        }),
        ..view()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sessions_frames_follow_a_moving_scene_and_each_shows_one_epoch() {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), Mover::Node, &[]);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);

    let frames = session(&coordinator.url, 60).await;
    let epochs: Vec<u64> = frames.iter().map(|frame| frame.provenance.state.epoch).collect();
    assert!(epochs.is_sorted(), "epochs ascend: {epochs:?}");
    let mut by_epoch: BTreeMap<u64, &Frame> = BTreeMap::new();
    let mut by_version: BTreeMap<Option<u64>, u64> = BTreeMap::new();
    for frame in &frames {
        let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a warp") };
        let version = warp.samples.first().map(|id| id.version);
        let of_it = |id: &argus_scene::SampleId| Some(id.version) == version;
        let shown = by_version.entry(version).or_insert(frame.provenance.state.epoch);
        assert_eq!(*shown, frame.provenance.state.epoch, "a version shows one epoch");
        assert!(!warp.samples.is_empty() && warp.samples.iter().all(of_it), "{:?}", warp.samples);
        let same = by_epoch.entry(frame.provenance.state.epoch).or_insert(frame);
        assert_eq!(
            same.images[Output::Color],
            frame.images[Output::Color],
            "two frames of one camera and epoch"
        );
    }
    assert!(by_epoch.len() >= 4, "{epochs:?}");

    // The box is at its animated position.
    let seen: Vec<(u64, f64)> =
        by_epoch.iter().map(|(epoch, frame)| (*epoch, red_column(&image(frame)))).collect();
    for (a, column_a) in &seen {
        for (b, column_b) in &seen {
            let moved = true_x(*a) - true_x(*b);
            assert!(
                moved.abs() < 0.5 || (column_a - column_b) * moved > 0.0,
                "{a}: {column_a}, {b}: {column_b}"
            );
        }
    }
    let columns = || seen.iter().map(|(_, column)| *column);
    assert!(columns().fold(0.0, f64::max) - columns().fold(f64::MAX, f64::min) > 15.0, "{seen:?}");

    // Every frame is the direct frame of its own epoch, within the error of a warp, and of no other.
    let mut wire = Wire::connect(&coordinator.url).await;
    let mut truth: BTreeMap<u64, RgbImage> = BTreeMap::new();
    for (&epoch, frame) in by_epoch.iter().take(8) {
        let (direct, _) = wire.render((&direct_at(epoch, &frame.provenance)).into()).await.unwrap();
        assert_eq!(direct.provenance.state.epoch, epoch);
        let (again, _) = wire.render((&direct_at(epoch, &frame.provenance)).into()).await.unwrap();
        assert_eq!(direct.images[Output::Color], again.images[Output::Color]);
        truth.insert(epoch, image(&direct));
    }
    for (epoch, truth) in &truth {
        let own = flip(truth, &image(by_epoch[epoch]));
        assert!(own < 0.06, "epoch {epoch}: FLIP {own}");
        for (other, frame) in
            by_epoch.iter().filter(|(other, _)| (true_x(**other) - true_x(*epoch)).abs() > 1.0)
        {
            let apart = flip(truth, &image(frame));
            assert!(apart > own, "epoch {other} is taken for {epoch}: FLIP {apart} against {own}");
        }
    }

    // An epoch that is no longer held is refused by name; the current one is not.
    let first = &frames[0].provenance;
    let gone = View { pin: Some(first.clone()), ..view() };
    let status = wire.render((&gone).into()).await.unwrap_err();
    assert!(status.message().contains(&format!("epoch {}", first.state.epoch)), "{status}");
    let status = coordinator.status();
    assert!(status["epoch"].as_u64().unwrap() >= *epochs.last().unwrap(), "{status:#}");
    assert!(status["samples_per_tick"].as_f64().unwrap() > 0.1, "each epoch is sampled anew: {status:#}");
    let held = |worker: &Value| worker["samples_held"].as_u64().unwrap();
    // Samples of four cameras: epochs in work, the one before, and the one in preparation.
    assert!(status["workers"].as_array().unwrap().iter().all(|worker| held(worker) <= 24), "{status:#}");
}

#[test]
fn a_view_of_a_given_time_equals_the_reference() {
    view_of_a_given_time(Mover::Node);
}

#[test]
fn a_view_of_a_given_time_equals_the_reference_where_a_joint_moves_vertices() {
    view_of_a_given_time(Mover::Joint);
}

fn view_of_a_given_time(mover: Mover) {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), mover, &["--effects", "none", "--exposure", "0"]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let out = folder.path().join("moment.png");
    let Camera { eye, target, .. } = camera();
    let point = |p: DVec3| format!("{},{},{}", p.x, p.y, p.z);
    let (eye, target, size) = (point(eye), point(target), format!("{}x{}", SIZE[0], SIZE[1]));
    let arguments =
        ["view", "--server", &coordinator.url, "--eye", &eye, "--target", &target, "--size", &size];
    let more =
        ["--direct", "--supersampling", "2", "--time", "1.4", "--json", "--out", out.to_str().unwrap()];
    let report = crate::support::json(&[&arguments[..], &more].concat());
    assert_eq!(report["epoch"], 7, "{report:#}");
    let scene = Arc::new(argus_scene::open(folder.path().join("boxes.gltf").to_str().unwrap()).unwrap());
    let truth = Tracer::new(scene.clone()).at(1.4).render(&camera(), SIZE[0], SIZE[1], 16, |_| {});
    let ours = image::open(&out).unwrap().to_rgb8();
    let error = flip(&truth.display(scene.lighting.exposure), &ours);
    assert!(error < 0.03, "FLIP {error}");

    let without = run(&[&arguments[..], &["--time", "1", "--out", "never.png"]].concat());
    assert_eq!(without.status.code(), Some(2), "{}", stderr(&without));
    assert!(stderr(&without).contains("--direct"), "{}", stderr(&without));
}

#[tokio::test(flavor = "multi_thread")]
async fn time_can_be_held_still() {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), Mover::Node, &["--time-scale", "0"]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let frames = session(&coordinator.url, 12).await;
    for frame in &frames {
        assert_eq!(
            (frame.provenance.state.epoch, &frame.images[Output::Color]),
            (0, &frames[0].images[Output::Color])
        );
    }
    assert_eq!(coordinator.status()["epoch"], 0);
}

#[tokio::test]
async fn particles_drift_from_epoch_to_epoch_in_a_still_scene() {
    let with = ["--particles", "60", "--vpl-maps", "megaviews", "--epoch-ms", "100"];
    let serve = Coordinator::start("terrain:2000", &with);
    let _worker = serve.worker(&[]);
    serve.wait_for_workers(1);
    let client = Client::connect(&serve.url).await.unwrap();
    let wanted =
        View { camera: Camera::look_at(DVec3::new(120.0, 80.0, 50.0), DVec3::new(0.0, 10.0, 0.0)), ..view() };
    let first = client.render(&wanted, &RenderOptions::default()).await.unwrap().frame;
    let mut later = client.render(&wanted, &RenderOptions::default()).await.unwrap().frame;
    for _ in 0..200 {
        if later.provenance.state.epoch > first.provenance.state.epoch + 5 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
        later = client.render(&wanted, &RenderOptions::default()).await.unwrap().frame;
    }
    assert!(later.provenance.state.epoch > first.provenance.state.epoch, "no other moment was served");
    assert_ne!(image(&first), image(&later), "their light moves");
}
