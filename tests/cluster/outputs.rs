//! All outputs in one call, and frames that are made again from their records.

use argus_scene::{Camera, Frame, Output, Outputs, PlanRequest, View};
use glam::{DVec2, DVec3};
use tonic::Code;

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL, json, run, stderr};

/// Steady light and exposure, so that views of two clusters can be compared.
/// What each service would measure for itself is given, too.
const FIXED: [&str; 8] = ["--effects", "all", "--indirect", "off", "--exposure", "0", "--visibility", "cpu"];

fn floats(frame: &Frame, output: Output) -> Vec<f32> {
    let bytes = frame.images[output].as_ref().unwrap().as_chunks::<4>().0;
    bytes.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// A view of all outputs, whose flow leads to a camera a little aside.
fn everything(camera: Camera, plan: PlanRequest) -> View {
    let step = (camera.target - camera.eye).cross(camera.up) * 0.02;
    let flow_to = Camera { eye: camera.eye + step, target: camera.target + step, ..camera };
    let outputs = Output::ALL.into_iter().collect();
    View { outputs, plan, flow_to: Some(flow_to), ..small_view(camera) }
}

/// Checks what outputs say of each other. A client has no more than the view and these numbers.
fn agree(view: &View, frame: &Frame) {
    let (camera, to, size) = (view.camera, view.flow_to.unwrap(), [view.width, view.height]);
    let [range, depth, flow, normal, radiance] =
        [Output::Range, Output::Depth, Output::Flow, Output::Normal, Output::Radiance]
            .map(|output| floats(frame, output));
    assert!(radiance.iter().all(|value| value.is_finite() && *value >= 0.0));
    let axis = (camera.target - camera.eye).normalize();
    let half = to.tan_half_fov(size[0], size[1]);
    let extent = DVec2::new(size[0].into(), size[1].into());
    for i in 0..(size[0] * size[1]) as usize {
        let centre = DVec2::new((i as u32 % size[0]).into(), (i as u32 / size[0]).into()) + 0.5;
        let direction = camera.direction(centre, size[0], size[1]);
        let along = direction.dot(axis);
        let (range, depth) = (f64::from(range[i]), f64::from(depth[i]));
        assert!(range == depth || (depth / (range * along) - 1.0).abs() < 1e-6, "{depth} at {range}");
        let normal = DVec3::new(normal[3 * i].into(), normal[3 * i + 1].into(), normal[3 * i + 2].into());
        assert!(normal == DVec3::ZERO || (normal.length() - 1.0).abs() < 1e-5);
        if depth.is_finite() {
            let seen = to.view_from_world() * (camera.eye + direction * (depth / along) - to.eye);
            let ndc = DVec2::new(seen.x, -seen.y) / (-seen.z * half);
            let moved = (ndc + 1.0) * 0.5 * extent - centre;
            let flow = DVec2::new(flow[2 * i].into(), flow[2 * i + 1].into());
            assert!((moved - flow).length() < 0.01, "{flow}, not {moved}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn all_outputs_come_in_one_call_from_triangles_and_from_samples() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let traced = PlanRequest { holes: Some(argus_scene::Holes::Trace), ..PlanRequest::from_samples() };
    let mut frames = Vec::new();
    for plan in [direct, PlanRequest::from_samples(), traced] {
        let view = everything(camera, plan);
        let (frame, meta) = wire.render((&view).into()).await.unwrap();
        assert!(frame.images.iter().map(|(output, _)| output).eq(Output::ALL));
        assert_eq!(meta.digest, frame.images.digest());
        agree(&view, &frame);
        // The other images are those of a view that asks for them alone.
        let plain = View { outputs: Outputs::COLOR.with(Output::Range), flow_to: None, rays: None, ..view };
        let pinned = View { pin: Some(frame.provenance.clone()), ..plain };
        let (plain, _) = wire.render((&pinned).into()).await.unwrap();
        for (output, image) in plain.images.iter() {
            assert!(frame.images[output].as_ref() == Some(image), "{output:?} depends on other outputs");
        }
        frames.push(frame);
    }
    // Normals and ids are of the triangles, so those of the three are equal.
    for output in Outputs::GEOMETRY.iter() {
        assert!(
            frames[1..].iter().all(|frame| frame.images[output] == frames[0].images[output]),
            "{output:?}"
        );
    }
    // Each id has a name.
    let client = argus_client::Client::connect(&coordinator.url).await.unwrap();
    for output in [Output::Instance, Output::Material] {
        let names = client.names(output).await.unwrap();
        let ids = frames[0].images[output].as_ref().unwrap().as_chunks::<4>().0;
        let most = ids.iter().map(|id| i32::from_le_bytes(*id)).max().unwrap();
        assert!((0..names.len() as i32).contains(&most), "{most} of {names:?}");
    }
    let wrong = client.names(Output::Color).await.unwrap_err();
    assert!(matches!(wrong, argus_client::ClientError::Invalid { .. }), "{wrong}");
    let surfaces = floats(&frames[0], Output::Range).into_iter().map(f32::is_finite);
    let ids = frames[0].images[Output::Instance].as_ref().unwrap().as_chunks::<4>().0;
    let apart = surfaces.zip(ids).filter(|(there, id)| *there != (i32::from_le_bytes(**id) >= 0)).count();
    assert!(apart * 100 < ids.len(), "{apart} pixels have an id or a range, but not both");
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_outputs_are_refused_by_field() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    let good: argus_proto::v1::View = (&everything(camera, PlanRequest::default())).into();
    let flat = argus_proto::v1::Camera { fov_deg: Some(200.0), ..good.camera.unwrap() };
    let colour = vec![argus_proto::v1::Output::Color as i32];
    let cases = [
        ("outputs", argus_proto::v1::View { outputs: vec![99], ..good.clone() }),
        ("outputs", argus_proto::v1::View { outputs: vec![0], ..good.clone() }),
        ("flow_to", argus_proto::v1::View { flow_to: None, ..good.clone() }),
        ("flow_to", argus_proto::v1::View { flow_to: Some(flat), ..good.clone() }),
        ("flow_to", argus_proto::v1::View { outputs: colour, ..good.clone() }),
    ];
    for (field, view) in cases {
        let status = wire.render(view).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
        assert!(status.message().starts_with(field), "{status}");
    }
}

#[test]
fn a_recorded_frame_is_made_again_by_another_cluster() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let all = "color,range,mask,radiance,depth,normal,instance,material,flow";
    let flow = ["--flow-eye", "1,30,60"];
    for (name, plan) in [("direct", ["--direct", "--supersampling=2"]), ("warped", ["--search", "splat"])] {
        let (out, record) = (file(name), file(&format!("{name}.json")));
        let view = ["view", "--server", &coordinator.url, "--size", "96x72", "--json", "--output", all];
        let report = json(&[&view[..], &flow, &plan, &["--out", &out, "--provenance", &record]].concat());
        let recorded: serde_json::Value = serde_json::from_slice(&std::fs::read(&record).unwrap()).unwrap();
        assert_eq!(report["digest"], recorded["digest"]);
        for image in
            ["color.png", "mask.png", "range.exr", "depth.exr", "normal.exr", "instance.exr", "flow.exr"]
        {
            assert!(folder.path().join(name).join(image).is_file(), "{image}");
        }
    }
    drop(workers);
    drop(coordinator);
    let other = Coordinator::start(SMALL, &FIXED);
    let _workers = other.workers(2);
    other.wait_for_workers(2);
    let replay = |record: &str| run(&["replay", record, "--server", &other.url, "--out", &file("again")]);
    for name in ["direct", "warped"] {
        let output = replay(&file(&format!("{name}.json")));
        assert!(
            output.status.success(),
            "{name}: {} {}",
            stderr(&output),
            String::from_utf8_lossy(&output.stdout)
        );
        assert_eq!(String::from_utf8_lossy(&output.stdout), "equal\n");
        for image in std::fs::read_dir(folder.path().join(name)).unwrap() {
            let image = image.unwrap();
            let again = folder.path().join("again").join(image.file_name());
            assert!(
                std::fs::read(image.path()).unwrap() == std::fs::read(again).unwrap(),
                "{name}: {image:?} is another file"
            );
        }
    }
    // A record of something else.
    let text = std::fs::read_to_string(file("direct.json")).unwrap();
    let mut record: serde_json::Value = serde_json::from_str(&text).unwrap();
    record["digest"] = "00".repeat(32).into();
    std::fs::write(file("other.json"), record.to_string()).unwrap();
    let output = replay(&file("other.json"));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("differs: digest: 0000"));
    record["provenance"]["scene"][0] = (record["provenance"]["scene"][0].as_u64().unwrap() ^ 1).into();
    std::fs::write(file("other.json"), record.to_string()).unwrap();
    let output = replay(&file("other.json"));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("differs: scene: "));
    let mut record: serde_json::Value = serde_json::from_str(&text).unwrap();
    record["provenance"]["specification"]["exposure"] = 12.5.into();
    std::fs::write(file("other.json"), record.to_string()).unwrap();
    let output = replay(&file("other.json"));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.starts_with("differs: pin: exposure "), "{said}");
    let output = replay(&file("missing.json"));
    assert!(stderr(&output).contains("cannot read"), "{}", stderr(&output));
}

#[test]
fn equal_bursts_have_equal_digests() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let load = |views: &str| {
        let load = ["load", "--server", &coordinator.url, "--size", "48x36", "--direct", "--json"];
        json(&[&load[..], &["--views", views]].concat())
    };
    let (first, second, fewer) = (load("8"), load("8"), load("7"));
    assert_eq!(first["distinct_frames"], 8, "{first:#}");
    assert!(first["digest"].is_string() && first["digest"] == second["digest"], "{first:#} {second:#}");
    assert_ne!(first["digest"], fewer["digest"]);
}
