//! Several scenes in one service: each client sees its own, and workers move to where they are needed.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use argus_client::{Client, ConnectOptions, RenderOptions};
use argus_scene::{PlanRequest, View};
use serde_json::Value;

use crate::support::{Coordinator, PATIENCE, SMALL, all_answered, argus, run, stderr};

/// The second scene of these tests.
const HILLS: &str = "hills=terrain:3000";

/// Flags without effects of light, so that a scene is ready at once.
const PLAIN: [&str; 3] = ["--effects=none", "--indirect=off", "--visibility=raster"];

/// A coordinator of the scenes `terrain` and `hills`.
fn start() -> Coordinator {
    Coordinator::start(SMALL, &[&PLAIN[..], &["--scene", HILLS]].concat())
}

/// Number of workers of each scene that answer views.
fn answering(status: &Value) -> Vec<u64> {
    let scenes = status["scenes"].as_array().unwrap();
    scenes.iter().map(|scene| scene["answering"].as_u64().unwrap()).collect()
}

async fn client(coordinator: &Coordinator, scene: Option<&str>) -> Client {
    let scene = scene.map(str::to_owned);
    let options = ConnectOptions { scene, ..ConnectOptions::default() };
    Client::connect_with(&coordinator.url, &options).await.unwrap()
}

fn view_of(client: &Client) -> View {
    let camera = client.description().cameras[0].camera;
    let plan = PlanRequest { direct: true, ..PlanRequest::default() };
    View::new(camera, [80, 60], plan)
}

fn patient() -> RenderOptions {
    RenderOptions { deadline: PATIENCE, ..RenderOptions::default() }
}

/// Starts an `argus load` of a scene in the background.
fn load(coordinator: &Coordinator, scene: &str, more: &[&str]) -> Child {
    let usual = ["load", "--server", &coordinator.url, "--scene-name", scene, "--json", "--timeout", "60"];
    let mut command = argus(&[&usual, more].concat());
    command.stdout(Stdio::piped()).spawn().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn each_client_sees_its_own_scene_as_a_service_of_that_scene_alone_shows_it() {
    let both = start();
    let _workers = both.workers(2);
    let status = both.wait_until("a worker for each scene", |status| answering(status) == [1, 1]);
    assert_eq!(status["scenes"][1]["name"], "hills", "{status:#}");
    assert_eq!(status["scenes"][1]["scene"], "terrain:3000", "{status:#}");

    let mut frames = Vec::new();
    for (scene, alone) in [(None, SMALL), (Some("terrain"), SMALL), (Some("hills"), "terrain:3000")] {
        let here = client(&both, scene).await;
        assert_eq!(here.description().scenes, ["terrain", "hills"]);
        assert_eq!(here.description().scene_name, alone);
        let frame = here.render(&view_of(&here), &patient()).await.unwrap().frame;
        frames.push((alone, view_of(&here), frame));
    }
    assert_eq!(frames[0].2.images, frames[1].2.images, "the first scene is that of requests that name none");
    assert_ne!(frames[0].2.images, frames[2].2.images);
    for (scene, view, frame) in &frames[1..] {
        let single = Coordinator::start(scene, &PLAIN);
        let _worker = single.worker(&[]);
        let here = client(&single, None).await;
        let pinned = View { pin: Some(frame.provenance.clone()), ..view.clone() };
        let alone = here.render(&pinned, &patient()).await.unwrap();
        assert_eq!(alone.frame.images, frame.images, "{scene}");
        assert_eq!(alone.frame.provenance, frame.provenance, "{scene}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn one_worker_serves_two_scenes_in_turn_and_every_view_is_answered() {
    let coordinator = start();
    let _worker = coordinator.worker(&[]);
    let loads = ["terrain", "hills"]
        .map(|scene| load(&coordinator, scene, &["--views", "6", "--size", "80x60", "--direct"]));
    loads.into_iter().for_each(all_answered);
    // What a worker shows of a scene is the same when it comes back to it, also from samples.
    let clients = [client(&coordinator, None).await, client(&coordinator, Some("hills")).await];
    let views = clients.each_ref().map(|here| View { plan: PlanRequest::from_samples(), ..view_of(here) });
    let first = clients[0].render(&views[0], &patient()).await.unwrap().frame;
    let second = clients[1].render(&views[1], &patient()).await.unwrap().frame;
    assert_ne!(second.images, first.images);
    let pinned = View { pin: Some(first.provenance.clone()), ..views[0].clone() };
    assert_eq!(clients[0].render(&pinned, &patient()).await.unwrap().frame.images, first.images);
    let status = coordinator.status();
    let moved = |scene: usize| status["scenes"][scene]["workers_moved"].as_u64().unwrap();
    assert!(moved(0) >= 1 && moved(1) >= 1, "{status:#}");
    assert_eq!(status["counters"]["workers_lost"], 0, "a move is no loss: {status:#}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_whose_only_worker_is_killed_gets_that_of_another_scene_and_loses_no_view() {
    let coordinator = start();
    let mut workers = coordinator.workers(2);
    let status = coordinator.wait_until("a worker for each scene", |status| answering(status) == [1, 1]);
    let of_first = status["workers"][0]["pid"].as_u64().unwrap() as u32;
    let here = client(&coordinator, Some("hills")).await;
    let before = here.render(&view_of(&here), &patient()).await.unwrap().frame;

    workers.iter_mut().find(|worker| worker.pid() != of_first).unwrap().kill();
    let after = here.render(&view_of(&here), &patient()).await.unwrap().frame;
    assert_eq!(after.images, before.images, "the other worker shows this scene now");
    let status = coordinator.status();
    assert_eq!(answering(&status), [0, 1], "{status:#}");
    assert_eq!(status["scenes"][0]["workers_moved"], 1, "{status:#}");
    // And back, for a viewer of the first scene.
    let there = client(&coordinator, None).await;
    let frame = there.render(&view_of(&there), &patient()).await.unwrap().frame;
    assert_ne!(frame.images, before.images);
}

#[test]
fn load_on_one_scene_moves_a_worker_of_another_to_it() {
    let coordinator = start();
    let _workers = coordinator.workers(3);
    coordinator.wait_until("workers for both scenes", |status| answering(status) == [2, 1]);
    let begin = Instant::now();
    // Demand is counted once a worker has measured what its views cost.
    while coordinator.status()["scenes"][0]["workers_moved"] == 0 {
        assert!(begin.elapsed() < PATIENCE, "no worker moved: {:#}", coordinator.status());
        let busy = ["--clients", "4", "--seconds", "5", "--rate", "12", "--size", "320x240", "--direct"];
        all_answered(load(&coordinator, "hills", &busy));
    }
    coordinator.wait_until("two workers of the scene with viewers", |status| answering(status)[1] >= 2);
    let metrics = metrics(&coordinator);
    for row in [
        "argus_processes{scene=\"hills\",role=\"sampler\"}",
        "argus_views_in_flight{scene=\"terrain\"}",
        "argus_view_seconds_count{scene=\"hills\"}",
    ] {
        assert!(metrics.contains(row), "{row} is missing: {metrics}");
    }
    let table = run(&["status", "--server", &coordinator.url]);
    let table = String::from_utf8_lossy(&table.stdout).into_owned();
    assert!(table.contains("hills") && table.contains("terrain:20000, version"), "{table}");
}

/// The page of metrics.
fn metrics(coordinator: &Coordinator) -> String {
    use std::io::{Read as _, Write as _};
    let host = coordinator.url.strip_prefix("http://").unwrap();
    let mut stream = std::net::TcpStream::connect(host).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    let mut page = String::new();
    stream.read_to_string(&mut page).unwrap();
    page
}

#[test]
fn an_unknown_scene_is_refused_with_the_names_of_all_and_one_without_a_worker_waits() {
    let coordinator = start();
    for command in [&["view", "--out", "never.png"][..], &["status"], &["load", "--views", "1"]] {
        let output = run(&[command, &["--server", &coordinator.url, "--scene-name", "hall"]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{command:?}: {message}");
        for part in ["scene", "\"hall\"", "terrain, hills"] {
            assert!(message.contains(part), "{command:?} does not say {part}: {message}");
        }
    }
    let begin = Instant::now();
    let view = [
        "view",
        "--server",
        &coordinator.url,
        "--scene-name",
        "hills",
        "--timeout",
        "1",
        "--out",
        "never.png",
    ];
    let output = run(&view);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("no answer within"), "{}", stderr(&output));
    assert!(begin.elapsed() > Duration::from_millis(900), "it waits for a worker");
}
