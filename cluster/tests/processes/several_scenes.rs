//! Several scenes in one service: workers move between them, and nothing of one scene shows in another.

use std::sync::Arc;
use std::time::Duration;

use argus_client::{Client, ConnectOptions, Node, RenderOptions, SetTransform, Space};
use argus_cluster::coordinator::{SceneToServe, ServeError, prepare, serve_prepared};
use argus_cluster::leadership::{LocalRegistry, Registry};
use argus_cluster::worker::Config;
use argus_proto::v1;
use glam::{DAffine3, DVec3};
use tokio_util::sync::CancellationToken;

use crate::common::roles::Settings;
use crate::common::{
    Coordinator, LIMIT, Opener, Process, Source, direct, quick, scene, start_worker, start_worker_with, view,
};

const NAMES: [&str; 2] = ["east", "west"];

fn to_serve(names: &[(&str, &str)]) -> Vec<SceneToServe> {
    let one = |(name, of): &(&str, &str)| {
        let source = Arc::new(Source { scene: scene(of), files: Vec::new() });
        let prepared = prepare(&quick(), source.as_ref()).unwrap();
        SceneToServe { name: (*name).to_owned(), source, prepared }
    };
    names.iter().map(one).collect()
}

fn coordinator_of(names: &[(&str, &str)], registry: Arc<dyn Registry>) -> Coordinator {
    let scenes = to_serve(names);
    Process::start(None, |listener, shutdown| {
        serve_prepared(quick(), scenes, listener, registry, shutdown, CancellationToken::new())
    })
}

fn coordinator(registry: Arc<dyn Registry>) -> Coordinator {
    coordinator_of(&[("east", "test"), ("west", "tests")], registry)
}

async fn client(url: &str, scene: &str) -> Client {
    let options = ConnectOptions { scene: Some(scene.to_owned()), ..ConnectOptions::default() };
    Client::connect_with(url, &options).await.unwrap()
}

async fn both(url: &str) -> [Client; 2] {
    [client(url, NAMES[0]).await, client(url, NAMES[1]).await]
}

/// Waits until the status is in a state.
async fn wait_for(client: &Client, state: impl Fn(&v1::StatusResponse) -> bool) -> v1::StatusResponse {
    let reached = async {
        loop {
            match client.status().await {
                Ok(status) if state(&status) => return status,
                _ => tokio::time::sleep(Duration::from_millis(20)).await,
            }
        }
    };
    tokio::time::timeout(LIMIT, reached).await.expect("the state is reached")
}

fn answering(status: &v1::StatusResponse) -> Vec<u32> {
    status.scenes.iter().map(|scene| scene.answering).collect()
}

fn workers(status: &v1::StatusResponse) -> Vec<Vec<String>> {
    status.scenes.iter().map(|scene| scene.workers.clone()).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn after_a_takeover_each_worker_returns_to_the_scene_that_it_has_open() {
    let registry = LocalRegistry::shared(7, Duration::from_millis(600));
    let mut first = coordinator(Arc::new(registry.clone()));
    let here = client(&first.url(), NAMES[1]).await;
    wait_for(&here, |status| status.term > 0).await;
    let second = coordinator(Arc::new(registry));
    let url = format!("{},{}", first.url(), second.url());
    let _workers: Vec<_> = (0..4)
        .map(|_| start_worker_with(Config::new(&url), &Default::default(), Opener::default().into()))
        .collect();
    let before = wait_for(&here, |status| answering(status) == [2, 2]).await;
    first.kill();
    let clients = both(&second.url()).await;
    let after = wait_for(&clients[0], |status| answering(status) == [2, 2]).await;
    assert!(after.term > before.term);
    let sorted = |status| {
        workers(status)
            .into_iter()
            .map(|mut of| {
                of.sort();
                of
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(sorted(&after), sorted(&before), "no worker opened another scene");
    for (client, name) in clients.iter().zip(["test", "tests"]) {
        let frame = client.render(&view(1), &RenderOptions::default()).await.unwrap().frame;
        assert_eq!(frame.provenance.scene, scene(name).hash);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_comes_back_shows_what_was_moved_in_this_scene_and_nothing_of_the_other() {
    let coordinator = coordinator(Arc::new(LocalRegistry::alone()));
    let settings = Arc::new(Settings::default());
    let _worker = start_worker(&coordinator.url(), &settings);
    let clients = both(&coordinator.url()).await;
    let options = RenderOptions { deadline: LIMIT, ..RenderOptions::default() };
    let mut revisions = [0, 0];
    for round in 0..2 {
        for (at, client) in clients.iter().enumerate() {
            let matrix = Some(DAffine3::from_translation(DVec3::X * (1.0 + f64::from(round))));
            let set = SetTransform { node: Node::Name("box".to_owned()), matrix, space: Space::Parent };
            revisions[at] = client.set_transforms(&[set], None).await.unwrap().revision;
        }
        for (client, revision) in clients.iter().zip(revisions) {
            let frame = client.render(&direct(1), &options).await.unwrap().frame;
            assert_eq!(frame.provenance.state.revision, revision);
            assert_eq!(frame.provenance.scene, client.description().scene_hash);
            let from_samples = client.render(&view(1), &options).await.unwrap().frame;
            assert_eq!(from_samples.provenance.state.revision, revision);
        }
    }
    let status = clients[0].status().await.unwrap();
    let moved: Vec<u64> = status.scenes.iter().map(|scene| scene.workers_moved).collect();
    assert!(moved[0] >= 2 && moved[1] >= 1, "{moved:?}");
    assert_eq!(status.counts().workers_lost, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn viewers_of_two_scenes_share_one_worker_and_none_waits_for_ever() {
    let coordinator = coordinator(Arc::new(LocalRegistry::alone()));
    let settings = Arc::new(Settings::default());
    let _worker = start_worker(&coordinator.url(), &settings);
    let clients = both(&coordinator.url()).await;
    let options = RenderOptions { deadline: LIMIT, ..RenderOptions::default() };
    // Neither stops asking, until the other was answered after it.
    let answers = clients.each_ref().map(|client| async {
        let mut answered = 0;
        for i in 0..160 {
            client.render(&direct(i), &options).await.unwrap();
            answered += 1;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        answered
    });
    let [east, west] = answers;
    assert_eq!(tokio::join!(east, west), (160, 160));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn scenes_have_different_names_and_differ() {
    for (names, word) in [
        (&[][..], "at least one"),
        (&[("east", "test"), ("east", "tests")], "two scenes are named east"),
        (&[("east", "test"), ("west", "test")], "same scene"),
        (&[("the east", "test")], "no name of a scene"),
    ] {
        let mut refused = coordinator_of(names, Arc::new(LocalRegistry::alone()));
        let error = refused.ended().await.unwrap_err();
        assert!(matches!(&error, ServeError::Scene(at) if at.to_string().contains(word)), "{error}");
    }
}
