//! Nodes that clients move: what is shown after it, who was first, and what is refused.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use argus_proto::v1;
use argus_proto::v1::set_transform::Node;
use argus_scene::{Output, Plan};
use futures::future::join_all;
use tonic::{Code, Status};

use crate::common::{Cluster, channel, direct, pinned, quick, start_coordinator_at, start_worker, view};
use crate::common::{Source, scene};

/// A matrix that moves a node along x, as 4x4 row by row.
fn along_x(x: f64) -> Vec<f64> {
    vec![1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
}

fn named(name: &str, matrix: Vec<f64>) -> v1::SetTransform {
    v1::SetTransform { node: Some(Node::Name(name.to_owned())), matrix, space: 0 }
}

fn at(index: u32, matrix: Vec<f64>) -> v1::SetTransform {
    v1::SetTransform { node: Some(Node::Index(index)), matrix, space: 0 }
}

fn request(nodes: Vec<v1::SetTransform>) -> v1::SetTransformsRequest {
    v1::SetTransformsRequest { nodes, ..v1::SetTransformsRequest::default() }
}

impl Cluster {
    async fn set(&self, request: v1::SetTransformsRequest) -> Result<v1::SetTransformsResponse, Status> {
        Ok(self.views().set_transforms(request).await?.into_inner())
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_after_the_answer_show_the_new_transforms_and_pins_show_those_of_their_frames() {
    let cluster = Cluster::start(3).await;
    let mut before = Vec::new();
    for view in [direct(0), view(0)] {
        before.push((view.clone(), cluster.render(&view).await.unwrap().0));
    }
    let moved = cluster.set(request(vec![named("box", along_x(2.0))])).await.unwrap();
    assert!(moved.revision > 0 && moved.movers == 1 && moved.stale_samples > 0, "{moved:?}");
    for (view, earlier) in &before {
        assert_eq!(earlier.provenance.state.revision, 0);
        let (later, _) = cluster.render(view).await.unwrap();
        assert_eq!(later.provenance.state.revision, moved.revision);
        assert_ne!(later.images[Output::Color], earlier.images[Output::Color]);
        for frame in [&later, earlier] {
            let (again, _) = cluster.render(&pinned(0, frame.provenance.clone())).await.unwrap();
            assert_eq!(again.images[Output::Color], frame.images[Output::Color]);
            assert_eq!(again.provenance.state, frame.provenance.state);
        }
    }
    // What the client set is the file's again: a state of its own, and none that was there before.
    let reset = cluster.set(request(vec![named("box", Vec::new())])).await.unwrap();
    assert!(reset.revision > moved.revision && reset.movers == 0, "{reset:?}");
    // Samples of one version alone are in a plan.
    let mut mixed = before[1].1.provenance.clone();
    mixed.state.revision = moved.revision;
    assert!(matches!(mixed.plan, Plan::Warp(_)));
    assert!(cluster.render(&pinned(0, mixed)).await.is_err());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_later_of_two_clients_wins_and_can_be_asked_for() {
    let cluster = Cluster::start(1).await;
    let first =
        cluster.set(request(vec![named("box", along_x(1.0)), named("lid", along_x(1.0))])).await.unwrap();
    let expecting = |revision| v1::SetTransformsRequest {
        expected_revision: Some(revision),
        ..request(vec![at(0, along_x(2.0))])
    };
    let second = cluster.set(expecting(first.revision)).await.unwrap();
    // The first client does not know of it.
    let refused = cluster.set(expecting(first.revision)).await.unwrap_err();
    assert_eq!(refused.code(), Code::FailedPrecondition);
    for word in ["expected_revision", &first.revision.to_string(), &second.revision.to_string()] {
        assert!(refused.message().contains(word), "{refused}");
    }
    let asked = v1::SetTransformsRequest { list_setters: true, ..request(Vec::new()) };
    let present = cluster.set(asked.clone()).await.unwrap();
    assert_eq!((present.revision, present.movers), (second.revision, 2), "asking moves nothing");
    let setters: Vec<(u32, u64)> = present.setters.iter().map(|by| (by.node, by.revision)).collect();
    assert_eq!(setters, [(0, second.revision), (1, first.revision)]);
    assert_eq!(present.setters[0].client, "127.0.0.1");
    let rest = cluster.set(v1::SetTransformsRequest { first_setter: 1, ..asked }).await.unwrap();
    assert_eq!(rest.setters.len(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn workers_that_join_later_show_the_transforms() {
    let mut cluster = Cluster::start(2).await;
    let moved = cluster.set(request(vec![named("box", along_x(2.0))])).await.unwrap();
    let (before, _) = cluster.render(&direct(3)).await.unwrap();
    for worker in &mut cluster.workers {
        worker.kill();
    }
    cluster.wait_for(|status| status.processes == 0).await;
    cluster.workers.push(start_worker(&cluster.coordinator.url(), &cluster.settings));
    let (after, _) = cluster.render(&direct(3)).await.unwrap();
    assert_eq!(after.provenance.state.revision, moved.revision);
    assert_eq!(after.images[Output::Color], before.images[Output::Color]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_that_restarts_shows_the_file_and_refuses_pins_of_before() {
    let mut cluster = Cluster::start(1).await;
    let moved = cluster.set(request(vec![named("box", along_x(2.0))])).await.unwrap();
    let (frame, _) = cluster.render(&direct(0)).await.unwrap();
    let address = cluster.coordinator.address;
    cluster.coordinator.kill();
    tokio::time::sleep(Duration::from_millis(100)).await;
    let source = Source { scene: scene("test"), files: Vec::new() };
    cluster.coordinator = start_coordinator_at(quick(), Some(address), source);
    cluster.channel = channel(&cluster.coordinator.url());
    cluster.wait_for(|status| status.processes == 1).await;
    let (fresh, _) = cluster.render(&direct(0)).await.unwrap();
    assert_eq!(fresh.provenance.state.revision, 0);
    assert_ne!(fresh.images[Output::Color], frame.images[Output::Color]);
    let refused = cluster.render(&pinned(0, frame.provenance)).await.unwrap_err();
    assert_eq!(refused.code(), Code::FailedPrecondition);
    assert!(refused.message().contains(&format!("revision {}", moved.revision)), "{refused}");
    let again = cluster.set(request(vec![named("box", along_x(3.0))])).await.unwrap();
    assert!(again.revision > moved.revision, "no revision is given twice");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bad_request_is_refused_by_field_and_moves_nothing() {
    let cluster = Cluster::start(1).await;
    let mut nan = along_x(1.0);
    nan[7] = f64::NAN;
    let mut flat = along_x(1.0);
    flat[5] = 0.0;
    let mut columns = along_x(0.0);
    columns[12] = 5.0;
    let in_space = |space| v1::SetTransform { space, ..named("box", along_x(1.0)) };
    let good = || named("lid", along_x(1.0));
    for (nodes, field, words) in [
        (vec![good(), named("bix", along_x(1.0))], "nodes.name", ["\"bix\"", "Names lists"]),
        (vec![good(), named("twin", along_x(1.0))], "nodes.name", ["2 nodes", "give the index"]),
        (vec![good(), at(99, along_x(1.0))], "nodes.index", ["no node 99", "0 to 3"]),
        (vec![v1::SetTransform { node: None, ..good() }], "nodes.node", ["index", "name"]),
        (vec![named("box", nan)], "nodes.matrix", ["0 \"box\"", "row 1, column 3"]),
        (vec![named("box", flat)], "nodes.matrix", ["0 \"box\"", "singular"]),
        (vec![named("box", vec![1.0; 9])], "nodes.matrix", ["9 numbers", "16 (4x4)"]),
        (vec![named("box", columns)], "nodes.matrix", ["last row", "row by row"]),
        (vec![good(), at(1, along_x(2.0))], "nodes", ["1 \"lid\"", "twice"]),
        (vec![in_space(7)], "nodes.space", ["7", "known"]),
        ((0..3000).map(|i| at(i, Vec::new())).collect(), "nodes", ["at most 2048", "further requests"]),
    ] {
        let refused = cluster.set(request(nodes)).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        let (found, reason) = argus_proto::status::invalid_field(&refused).unwrap();
        assert_eq!(found, field, "{reason}");
        assert!(words.iter().all(|word| reason.contains(word)), "{reason}");
    }
    // A message of a million nodes is larger than the service reads.
    let million =
        cluster.set(request((0..1_000_000).map(|i| at(i, Vec::new())).collect())).await.unwrap_err();
    assert!(matches!(million.code(), Code::OutOfRange | Code::ResourceExhausted), "{million}");
    let present = cluster.set(request(Vec::new())).await.unwrap();
    assert_eq!((present.revision, present.movers), (0, 0));
    cluster.render(&direct(0)).await.unwrap();
    assert_eq!(cluster.status().await.counters.unwrap().workers_lost, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_view_is_lost_while_nodes_move_as_fast_as_a_client_can() {
    let cluster = Cluster::start(3).await;
    cluster.settings.set(2000, 2000);
    let (moves, full) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let running = Arc::new(());
    let moving = async {
        while Arc::strong_count(&running) > 1 {
            let x = moves.load(Ordering::SeqCst) as f64;
            match cluster.set(request(vec![named("box", along_x(x)), named("lid", along_x(-x))])).await {
                Ok(_) => moves.fetch_add(1, Ordering::SeqCst),
                // It says when to come again.
                Err(busy) if busy.code() == Code::ResourceExhausted => full.fetch_add(1, Ordering::SeqCst),
                Err(error) => panic!("{error}"),
            };
        }
    };
    let held = running.clone();
    let viewing = async {
        let views = (0..200).map(|i| if i % 2 == 0 { direct(i) } else { view(i) });
        let frames = join_all(views.map(|view| {
            let cluster = &cluster;
            async move { cluster.render(&view).await.map(|(frame, _)| frame.provenance.state.revision) }
        }))
        .await;
        drop(held);
        frames
    };
    let ((), frames) = tokio::join!(moving, viewing);
    let revisions: Vec<u64> = frames.into_iter().map(|frame| frame.unwrap()).collect();
    println!("{} moves, {} refused", moves.load(Ordering::SeqCst), full.load(Ordering::SeqCst));
    assert!(moves.load(Ordering::SeqCst) > 20);
    assert!(revisions.iter().any(|revision| *revision > 0));
    let status = cluster.status().await;
    assert_eq!(status.counters.unwrap().workers_lost, 0, "no worker is expelled");
}
