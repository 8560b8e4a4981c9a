//! A real cluster: a coordinator and workers, each a process, over the loopback interface.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, PATIENCE, Process, SMALL, all_answered, argus, json, run, stderr};
use argus_proto::status::invalid_field;
use argus_proto::v1;
use argus_scene::{Frame, Output, PlanRequest, Search, View};
use serde_json::Value;
use tokio::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard};
use tonic::Code;

static ROLES: RwLock<()> = RwLock::const_new(());

/// Lock for tests whose roles another test's load would change: cores are few.
async fn alone() -> RwLockWriteGuard<'static, ()> {
    ROLES.write().await
}

/// Lock for tests that may run beside one another, yet not beside one that is [`alone`].
async fn not_beside_roles() -> RwLockReadGuard<'static, ()> {
    ROLES.read().await
}

/// Starts an `argus load` in the background.
fn load(url: &str, more: &[&str]) -> Child {
    let mut command = argus(&["load", "--server", url, "--json"]);
    if !more.contains(&"--size") {
        command.args(["--size", "96x72"]);
    }
    command.args(more).stdout(Stdio::piped());
    command.spawn().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn roles_follow_demand_and_every_frame_is_answered() {
    let _alone = alone().await;
    // Where samplers also compose, every split of a light load is equally good.
    let coordinator = Coordinator::start(SMALL, &["--samplers-composite=false"]);
    let _workers = coordinator.workers(3);
    let status = coordinator.wait_for_workers(3);
    assert_eq!(
        status["samplers"].as_u64().unwrap() + status["compositors"].as_u64().unwrap(),
        3,
        "{status:#}"
    );

    // Views from triangles are samplers' work: without other work, more than one worker must sample.
    let direct = [(); 2]
        .map(|()| load(&coordinator.url, &["--clients", "2", "--seconds", "12", "--rate", "10", "--direct"]));
    let several = |status: &Value| status["samplers"].as_u64() >= Some(2);
    coordinator.wait_until("several samplers under direct views", several);
    // The predicted and the measured tick come from separate sources: demand and costs, and clocks.
    coordinator.wait_until("a tick that takes what is predicted", |status| {
        let ms = |key: &str| status[key].as_f64().unwrap();
        let (predicted, measured) = (ms("tick_predicted_ms"), ms("tick_measured_ms"));
        predicted > 1.0 && measured > 1.0 && (0.4..2.5).contains(&(measured / predicted))
    });
    direct.into_iter().for_each(all_answered);

    // Views from samples are compositors' work; the samples exist, so one sampler is enough.
    let warped = [(); 2].map(|()| {
        load(&coordinator.url, &["--clients", "4", "--seconds", "12", "--rate", "15", "--search", "splat"])
    });
    coordinator.wait_until("two compositors under warped views", |status| status["compositors"] == 2);
    warped.into_iter().for_each(all_answered);

    // And back, once the views from samples end.
    let direct = load(&coordinator.url, &["--clients", "4", "--seconds", "12", "--rate", "10", "--direct"]);
    let status = coordinator.wait_until("several samplers again", several);
    all_answered(direct);

    for key in [
        "samples_per_tick",
        "sample_ms",
        "views_per_tick",
        "view_ms",
        "tick_predicted_ms",
        "tick_measured_ms",
    ] {
        assert!(status[key].as_f64().unwrap() >= 0.0, "{key}: {status:#}");
    }
    for worker in status["workers"].as_array().unwrap() {
        assert!(worker["pid"].is_u64() && worker["id"].is_string(), "{worker:#}");
        assert!(worker["address"].as_str().unwrap().starts_with("http://127.0.0.1:"), "{worker:#}");
        assert!(
            ["sampler", "compositor", "draining"].contains(&worker["role"].as_str().unwrap()),
            "{worker:#}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_killed_under_load_loses_no_view() {
    let _alone = alone().await;
    let coordinator = Coordinator::start(SMALL, &[]);
    let mut workers = coordinator.workers(3);
    coordinator.wait_for_workers(3);
    for victim_role in ["compositor", "sampler"] {
        let status = coordinator.wait_until("both roles", |status| {
            status["samplers"].as_u64() > Some(0) && status["compositors"].as_u64() > Some(0)
        });
        let pid_of = |worker: &Value| worker["pid"].as_u64().unwrap() as u32;
        let victim =
            status["workers"].as_array().unwrap().iter().find(|worker| worker["role"] == victim_role);
        let pid = pid_of(victim.unwrap());

        let direct = load(&coordinator.url, &["--clients", "1", "--seconds", "6", "--rate", "5", "--direct"]);
        let warped = load(
            &coordinator.url,
            &["--clients", "4", "--seconds", "6", "--rate", "10", "--search", "splat"],
        );
        tokio::time::sleep(Duration::from_secs(2)).await;
        workers.iter_mut().find(|worker| worker.pid() == pid).unwrap().kill();
        all_answered(direct);
        all_answered(warped);

        workers.retain(|worker| worker.pid() != pid);
        workers.push(coordinator.worker(&[]));
        coordinator.wait_for_workers(3);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_killed_while_it_fills_light_cells_loses_nothing() {
    let _alone = alone().await;
    let flags = ["--indirect=cells", "--refining-share=0", "--exposure=0"];
    let coordinator = Coordinator::start(SMALL, &flags);
    let mut workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    coordinator.wait_for_full_light();
    let asked = ["--clients", "3", "--seconds", "6", "--rate", "2", "--direct", "--size", "320x240"];
    let under_load = load(&coordinator.url, &asked);
    // Cameras move, so that it fills for as long as they do.
    let fills = |worker: &Value| worker["light_cells"]["filled"].as_u64() > Some(0);
    let status = coordinator.wait_until("a worker that fills cells", |status| {
        status["workers"].as_array().unwrap().iter().any(fills)
    });
    let victim = status["workers"].as_array().unwrap().iter().find(|worker| fills(worker)).unwrap();
    let pid = victim["pid"].as_u64().unwrap() as u32;
    workers.iter_mut().find(|worker| worker.pid() == pid).unwrap().kill();
    all_answered(under_load);

    // What the other one filled is what any worker fills.
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (out, record) = (file("view.png"), file("view.json"));
    let began = Instant::now();
    loop {
        let view = ["view", "--server", &coordinator.url, "--direct", "--size", "160x120", "--json"];
        json(&[&view[..], &["--out", &out, "--provenance", &record]].concat());
        if std::fs::read_to_string(&record).unwrap().contains("cells") {
            break;
        }
        assert!(began.elapsed() < PATIENCE, "no view is lit by cells");
    }
    let other = Coordinator::start(SMALL, &flags);
    let _worker = other.worker(&[]);
    let again = run(&["replay", &record, "--server", &other.url, "--out", &file("again.png")]);
    assert_eq!(String::from_utf8_lossy(&again.stdout), "equal\n", "{}", stderr(&again));
}

/// The change that makes a valid view invalid.
type Spoil = fn(&mut v1::View);

#[tokio::test(flavor = "multi_thread")]
async fn invalid_input_is_rejected_by_field_and_the_server_goes_on() {
    let _beside = not_beside_roles().await;
    let coordinator = Coordinator::start(SMALL, &[]);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let mut wire = Wire::connect(&coordinator.url).await;
    let good = v1::View::from(&small_view(wire.describe().await.cameras[0].camera));
    let (_, meta) = wire.render(good.clone()).await.unwrap();
    assert!(!meta.worker.is_empty());

    fn camera(view: &mut v1::View) -> &mut v1::Camera {
        view.camera.as_mut().unwrap()
    }
    let cases: &[(&str, Spoil)] = &[
        ("camera", |v| v.camera = None),
        ("camera.eye", |v| camera(v).eye = None),
        ("camera.eye", |v| camera(v).eye = Some(v1::Vec3 { x: f64::NAN, y: 0.0, z: 0.0 })),
        ("camera.target", |v| camera(v).target = Some(v1::Vec3 { x: 0.0, y: f64::INFINITY, z: 0.0 })),
        ("camera.target", |v| camera(v).target = camera(v).eye),
        ("camera.up", |v| camera(v).up = Some(v1::Vec3 { x: 0.0, y: 0.0, z: f64::NEG_INFINITY })),
        ("camera.up", |v| camera(v).up = Some(v1::Vec3::default())),
        ("camera.up", |v| {
            let (eye, target) = (camera(v).eye.unwrap(), camera(v).target.unwrap());
            let along = v1::Vec3 { x: target.x - eye.x, y: target.y - eye.y, z: target.z - eye.z };
            camera(v).up = Some(along);
        }),
        ("camera.fov_deg", |v| camera(v).fov_deg = Some(0.0)),
        ("camera.fov_deg", |v| camera(v).fov_deg = Some(180.0)),
        ("camera.fov_deg", |v| camera(v).fov_deg = Some(-45.0)),
        ("camera.fov_deg", |v| camera(v).fov_deg = Some(f64::NAN)),
        ("width", |v| v.width = 0),
        ("height", |v| v.height = 0),
        ("width", |v| v.width = 8193),
        ("height", |v| v.height = u32::MAX),
        ("width", |v| (v.width, v.height) = (8192, 8192)),
        ("outputs", |v| v.outputs.clear()),
        ("outputs", |v| v.outputs = vec![99]),
        ("outputs", |v| v.outputs = vec![0]),
        ("plan.search", |v| v.plan.get_or_insert_default().search = Some(77)),
        ("plan.steps", |v| v.plan.get_or_insert_default().steps = Some(0)),
        ("plan.steps", |v| v.plan.get_or_insert_default().steps = Some(5000)),
        ("plan.supersampling", |v| v.plan.get_or_insert_default().supersampling = Some(9)),
        ("plan.samples", |v| v.plan.get_or_insert_default().samples = Some(0)),
        ("pin.scene_hash", |v| v.pin.get_or_insert_default().scene_hash = vec![1; 7].into()),
    ];
    for (i, (field, spoil)) in cases.iter().enumerate() {
        let mut view = good.clone();
        spoil(&mut view);
        let status = wire.render(view).await.expect_err(field);
        assert_eq!(status.code(), Code::InvalidArgument, "case {i}, {field}: {status}");
        let (at, reason) = invalid_field(&status).unwrap_or_else(|| panic!("case {i}, {field}: no details"));
        assert!(at.starts_with(field), "case {i}: {at} instead of {field}");
        assert!(!reason.is_empty(), "case {i}, {field}");
    }
    // A pin on another scene is well formed but cannot be met.
    let (frame, _) = wire.render(good.clone()).await.expect("the server goes on");
    let mut elsewhere = frame.provenance.clone();
    elsewhere.scene = argus_scene::SceneHash([7; 32]);
    let status = wire.render(v1::View { pin: Some((&elsewhere).into()), ..good.clone() }).await.unwrap_err();
    assert!(matches!(status.code(), Code::InvalidArgument | Code::FailedPrecondition), "{status}");
    wire.render(good).await.expect("the server goes on");

    // The same by the command: the field and the reason, and exit code 2.
    for (wrong, field) in [
        (["--eye", "nan,0,0", "--target", "0,0,0"].as_slice(), "eye"),
        (&["--eye", "1,2,3", "--target", "1,2,3"], "target"),
        (&["--eye", "0,9,0", "--target", "0,0,0"], "up"),
        (&["--eye", "1,2,3", "--target", "0,0,0", "--fov-deg", "180"], "fov_deg"),
        (&["--eye", "1,2,3", "--target", "0,0,0", "--size", "0x10"], "width"),
    ] {
        let arguments = [&["view", "--server", &coordinator.url, "--out", "never.png"], wrong].concat();
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(field), "{wrong:?}: {}", stderr(&output));
    }
}

/// The plans whose bytes must not depend on the worker.
fn plans() -> [PlanRequest; 5] {
    let default = PlanRequest::default();
    [
        default,
        PlanRequest::from_samples(),
        PlanRequest { search: Some(Search::Linear), steps: Some(32), ..default },
        PlanRequest { supersampling: Some(2), samples: Some(2), ..default },
        PlanRequest { direct: true, ..default },
    ]
}

fn same_pixels(a: &Frame, b: &Frame, what: &str) {
    for output in [Output::Color, Output::Range, Output::Mask, Output::Source] {
        let (a, b) = (&a.images[output], &b.images[output]);
        assert!(a.is_some() && a == b, "{what}: {} differs", output.name());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_pinned_provenance_a_cluster_and_one_process_give_the_same_bytes() {
    let _beside = not_beside_roles().await;
    let cluster = Coordinator::start(SMALL, &["--visibility=raster"]);
    let _workers = cluster.workers(3);
    let single = Coordinator::start(SMALL, &["--visibility=raster"]);
    let _worker = single.worker(&[]);
    cluster.wait_for_workers(3);
    single.wait_for_workers(1);
    // Light rises in each at its own pace, and each refuses pins to light that it does not serve yet, or no longer.
    cluster.wait_for_full_light();
    let status = single.wait_for_full_light();
    assert_eq!(status["workers"][0]["role"], "both", "{status:#}");

    let mut of_many = Wire::connect(&cluster.url).await;
    let mut of_one = Wire::connect(&single.url).await;
    let description = of_one.describe().await;
    assert_eq!(description.scene_hash, of_many.describe().await.scene_hash);
    for (i, plan) in plans().into_iter().enumerate() {
        let camera = description.cameras[i % description.cameras.len()].camera;
        let asked = View { plan, ..small_view(camera) };
        let (frame, _) = of_many.render((&asked).into()).await.unwrap();
        let pinned = View { pin: Some(frame.provenance.clone()), ..asked };
        let (alone, _) = of_one.render((&pinned).into()).await.unwrap();
        assert_eq!(alone.provenance, frame.provenance, "plan {i}");
        same_pixels(&alone, &frame, &format!("plan {i}, one process"));
        // Again from the cluster, where another worker may answer.
        let (again, _) = of_many.render((&pinned).into()).await.unwrap();
        same_pixels(&again, &frame, &format!("plan {i}, again"));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_without_the_scene_fetches_it_from_the_coordinator_and_keeps_it() {
    let _beside = not_beside_roles().await;
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("kept");
    // A bundle of two files, in a folder that only the coordinator knows.
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    std::fs::write(models.join("paint.mtl"), "newmtl paint\nKd 0.8 0.2 0.1\n").unwrap();
    let quad = "mtllib paint.mtl\nusemtl paint\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 4 3 2 1\n";
    std::fs::write(models.join("quad.obj"), quad).unwrap();

    let coordinator = Coordinator::start_in(&models, "quad.obj", &[]);
    let scenes = ["--scenes", kept.to_str().unwrap()];
    let mut worker = coordinator.worker(&scenes);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let description = wire.describe().await;
    let view = v1::View::from(&small_view(description.cameras[0].camera));
    let (frame, _) = wire.render(view.clone()).await.unwrap();
    let bundle = kept.join(description.scene_hash.to_string());
    assert!(bundle.is_dir(), "the worker kept what it fetched");

    // A second start finds the scene in the worker's folder, with the same image.
    worker.stop();
    coordinator.wait_for_workers(0);
    let _worker = coordinator.worker(&scenes);
    coordinator.wait_for_workers(1);
    let (again, _) = wire.render(view).await.unwrap();
    same_pixels(&again, &frame, "from the kept scene");
    let color = frame.images[Output::Color].clone().unwrap();
    assert!(
        color.chunks(3).any(|pixel| u32::from(pixel[0]) > 2 * u32::from(pixel[2])),
        "the quad is red somewhere"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_full_disk_a_worker_still_serves_a_scene_it_cannot_store_and_cannot_log() {
    let _beside = not_beside_roles().await;
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("kept");
    // Larger than the limit of the worker's files.
    let quad = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 4 3 2 1\n";
    let padding = "# nothing to see here\n".repeat(20_000);
    std::fs::write(folder.path().join("quad.obj"), format!("{quad}{padding}")).unwrap();
    let coordinator = Coordinator::start_in(folder.path(), "quad.obj", &[]);
    // Ignored signals stay ignored in child processes, so a write beyond the limit fails, as on a full disk.
    let limited = "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\" 2>/dev/full";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", limited, argus(&[]).get_program().to_str().unwrap(), "worker"]);
    command.args(["--coordinator", &coordinator.url, "--listen", "127.0.0.1:0"]);
    command.args(["--scenes", kept.to_str().unwrap()]);
    let _worker = Process::start(command);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    wire.render(v1::View::from(&small_view(camera))).await.unwrap();
    let left: Vec<_> = std::fs::read_dir(&kept).map(Iterator::collect).unwrap_or_default();
    assert!(left.is_empty(), "half a scene is left on a full disk: {left:?}");
}

#[test]
fn an_image_that_a_full_disk_refuses_is_an_error_with_the_files_name() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let seen = ["view", "--eye", "60,40,60", "--target", "0,5,0", "--size", "64x48", "--out", "/dev/full"];
    let output = run(&[&seen[..], &["--server", &coordinator.url]].concat());
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("/dev/full") && message.contains("No space left"), "{message}");
}
