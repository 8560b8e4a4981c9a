//! Nodes that a client moves, from its request to the frames of other clients, with a real coordinator and a real worker.

use std::time::{Duration, Instant};

use argus_client::{Client, Node, RenderOptions, SetTransform, Space};
use argus_scene::{PlanRequest, View};
use glam::{DAffine3, DQuat, DVec3};

use crate::motion::{Mover, image, red_column, start, view, write_scene};
use crate::support::{Coordinator, json, run, stderr};

/// The bar on the time from a request to the first frame that shows it, milliseconds, on a machine that does nothing else.
const BAR_MS: f64 = 150.0;

fn red_at(x: f64) -> SetTransform {
    let (scale, at) = (DVec3::splat(0.8), DVec3::new(x, 1.0, 1.0));
    let matrix = DAffine3::from_scale_rotation_translation(scale, DQuat::IDENTITY, at);
    SetTransform { node: Node::Name("red".to_owned()), matrix: Some(matrix), space: Space::World }
}

/// All pebbles, and the red box.
fn a_hundred_nodes(x: f64) -> Vec<SetTransform> {
    let pebble = |i: u32| {
        let at = DVec3::new(f64::from(i % 10) - 4.5, 0.1, -5.0 + 0.1 * f64::from(i / 10) + 0.05 * x);
        let matrix = DAffine3::from_scale_rotation_translation(DVec3::splat(0.05), DQuat::IDENTITY, at);
        SetTransform { node: Node::Index(3 + i), matrix: Some(matrix), space: Space::Parent }
    };
    (0..99).map(pebble).chain([red_at(x)]).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hundred_moved_nodes_are_seen_in_the_next_frame_and_soon() {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), Mover::Client, &[]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let mover = Client::connect(&coordinator.url).await.unwrap();
    let viewer = Client::connect(&coordinator.url).await.unwrap();
    let (from_samples, open) = (view(), View { plan: PlanRequest::default(), ..view() });
    let names = mover.node_names().await.unwrap();
    assert_eq!((names.len(), names[2].as_str()), (103, "red"));
    let options = RenderOptions { deadline: Duration::from_secs(60), ..RenderOptions::default() };
    let mut columns = Vec::new();
    for view in [&open, &from_samples] {
        let frame = viewer.render(view, &options).await.unwrap().frame;
        assert_eq!(frame.provenance.state.revision, 0);
        columns.push(red_column(&image(&frame)));
    }
    let mut times = Vec::new();
    for step in 0..12 {
        let x = [3.0, -3.0][step % 2];
        let began = Instant::now();
        let moved = mover.set_transforms(&a_hundred_nodes(x), None).await.unwrap();
        let frame = viewer.render(&open, &options).await.unwrap().frame;
        times.push(began.elapsed().as_secs_f64() * 1e3);
        assert_eq!(frame.provenance.state.revision, moved.revision);
        let column = red_column(&image(&frame));
        let is_moved = (column - columns[0]).abs() > 20.0;
        assert_eq!(is_moved, x > 0.0, "step {step}: column {column}, at first {}", columns[0]);
        if step == 0 {
            assert!(moved.stale_samples > 0, "{moved:?}");
            let column = red_column(&image(&viewer.render(&from_samples, &options).await.unwrap().frame));
            assert!((column - columns[1]).abs() > 20.0, "samples show it as well: {column}, {columns:?}");
        }
    }
    // The first move makes 100 nodes movers.
    let mut later = times[1..].to_vec();
    later.sort_by(f64::total_cmp);
    let middle = later[later.len() / 2];
    println!(
        "from a request for 100 nodes to its frame: first {:.1} ms, then {later:.1?}, middle {middle:.1} ms",
        times[0]
    );
    // Tests run side by side, with a build or without; the bar itself is read from the line above.
    assert!(middle < 10.0 * BAR_MS, "{later:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn samples_keep_what_a_move_left_alone_and_show_what_a_fresh_service_shows() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), Mover::Client);
    let started = || {
        let coordinator = Coordinator::start(scene.to_str().unwrap(), &["--sample-size", "64x64"]);
        let worker = coordinator.worker(&[]);
        coordinator.wait_for_workers(1);
        coordinator.wait_for_full_light();
        (coordinator, worker)
    };
    let options = RenderOptions { deadline: Duration::from_secs(120), ..RenderOptions::default() };
    let (coordinator, _worker) = started();
    let client = Client::connect(&coordinator.url).await.unwrap();
    let shown_at = async |client: &Client, x: f64| {
        let moved = client.set_transforms(&[red_at(x)], None).await.unwrap();
        let frame = client.render(&view(), &options).await.unwrap().frame;
        assert_eq!(frame.provenance.state.revision, moved.revision);
        frame
    };
    // At the first move nothing is known of the faces that are there.
    let mut frames = Vec::new();
    for x in [3.0, -3.0, 2.5] {
        frames.push(shown_at(&client, x).await);
    }
    let status = client.status().await.unwrap();
    let cells = status.workers[0].light_cells.as_ref().unwrap();
    println!("{} faces kept, {} rendered again", cells.faces_kept, cells.faces_changed);
    assert!(cells.faces_kept > 0 && cells.faces_changed > 0, "{cells:?}");
    let (fresh, _worker) = started();
    let client = Client::connect(&fresh.url).await.unwrap();
    let frame = shown_at(&client, 2.5).await;
    assert!(
        image(&frame) == image(&frames[2]),
        "faces that were kept show what they would if they were rendered"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_joint_that_a_client_moves_takes_its_skin_along() {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), Mover::Joint, &[]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let options = RenderOptions { deadline: Duration::from_secs(60), ..RenderOptions::default() };
    let open = View { plan: PlanRequest::default(), ..view() };
    let mut columns = Vec::new();
    // The animation does not move it any more.
    for x in [3.0, -3.0, 3.0] {
        let joint = SetTransform { node: Node::Index(2), ..red_at(x) };
        let moved = client.set_transforms(&[joint], None).await.unwrap();
        let frame = client.render(&open, &options).await.unwrap().frame;
        assert_eq!(frame.provenance.state.revision, moved.revision);
        columns.push(red_column(&image(&frame)));
    }
    assert!(columns[0] - columns[1] > 40.0 && (columns[0] - columns[2]).abs() < 2.0, "{columns:?}");
}

#[test]
fn a_node_is_moved_on_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let coordinator = start(folder.path(), Mover::Client, &[]);
    let say = |more: &[&str]| json(&[&["move", "--server", &coordinator.url, "--json"], more].concat());
    assert_eq!(say(&["--list"])["nodes"][2], "red");
    let moved = say(&["--node", "red", "--translate=-1,1,2.5", "--scale", "0.5"]);
    assert!(moved["revision"].as_u64().unwrap() > 0 && moved["movers"] == 1, "{moved}");
    assert_eq!(say(&["--setters"])["setters"][0]["client"], "127.0.0.1");
    let reset = say(&["--node", "2", "--reset"]);
    assert!(reset["revision"].as_u64() > moved["revision"].as_u64() && reset["movers"] == 0, "{reset}");
    for (more, code, words) in [
        (&["--node", "rad", "--reset"][..], 2, ["nodes.name", "\"rad\""]),
        (&["--node", "red"], 2, ["--matrix", "--reset"]),
        (&["--node", "red", "--matrix", "1,2,3"], 2, ["--matrix", "3 numbers"]),
        (
            &["--node", "red", "--reset", "--expect", "7"],
            1,
            ["expected_revision", "another client was first"],
        ),
    ] {
        let output = run(&[&["move", "--server", &coordinator.url], more].concat());
        assert_eq!(output.status.code(), Some(code), "{more:?}: {}", stderr(&output));
        assert!(words.iter().all(|word| stderr(&output).contains(word)), "{}", stderr(&output));
    }
}
