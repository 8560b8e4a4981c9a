//! A restart of all workers in turn, under load by single views and by sessions, loses no view.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::support::{Coordinator, SMALL};
use argus_client::load::path_views;
use argus_client::{Client, RenderOptions, SessionEvent, SessionOptions};
use argus_scene::{PlanRequest, Stage, View};
use tokio::task::JoinSet;

/// Single views in flight at all times.
const VIEWS: usize = 16;

/// Sessions of each kind.
const SESSIONS: usize = 2;

/// Whether the load shall end.
type Done = Arc<AtomicBool>;

/// The kind of load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    View,
    /// A session whose frames pass the coordinator.
    Relayed,
    /// A session that fetches its frames from the workers.
    Redirected,
}

/// Counts of one source of load.
#[derive(Debug, Clone, Copy, Default)]
struct Got {
    answered: u64,
    /// Frames that were fetched from a worker.
    fetched: u64,
}

/// Requests one view after the other.
async fn views(client: Client, views: Vec<View>, done: Done) -> Got {
    let options = RenderOptions { deadline: Duration::from_secs(60), ..RenderOptions::default() };
    let mut got = Got::default();
    for view in views.iter().cycle() {
        if done.load(Ordering::SeqCst) {
            break;
        }
        let answer = client.render(view, &options).await.unwrap();
        assert_eq!(answer.attempts, 1, "the client had to ask again");
        got.answered += 1;
    }
    got
}

/// Moves a camera whenever a frame has arrived: each move must be answered by a frame.
async fn session(client: Client, views: Vec<View>, redirect: bool, done: Done) -> Got {
    let mut session = client.session(SessionOptions { redirect, ..SessionOptions::default() });
    let mut got = Got::default();
    for view in views.iter().cycle() {
        if done.load(Ordering::SeqCst) {
            break;
        }
        let sent = session.send(view);
        let next = tokio::time::timeout(Duration::from_secs(60), session.next());
        match next.await.expect("a session hears nothing").unwrap() {
            SessionEvent::Frame { camera_seq, frame, .. } => {
                assert_eq!(camera_seq, sent);
                got.answered += 1;
                got.fetched += u64::from(frame.stages.iter().any(|stage| stage.name == Stage::DETOUR));
            }
            SessionEvent::Failed { error, .. } => panic!("a session's camera failed: {error}"),
        }
    }
    got
}

#[test]
fn a_rolling_restart_of_all_workers_loses_no_frame_and_repeats_none() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let worker = || coordinator.worker(&["--public-address", "advertised"]);
    let mut workers: Vec<_> = (0..3).map(|_| worker()).collect();
    coordinator.wait_for_workers(3);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let done = Done::default();
    let mut asking = JoinSet::new();
    runtime.block_on(async {
        let client = Client::connect(&coordinator.url).await.unwrap();
        let all = path_views(client.description(), 50, [96, 72], PlanRequest::default());
        for i in 0..VIEWS + 2 * SESSIONS {
            // Each source begins with another view.
            let mut mine = all.clone();
            mine.rotate_left(3 * i % all.len());
            let (client, done) = (client.clone(), done.clone());
            let kind = match i {
                i if i < VIEWS => Kind::View,
                i if i < VIEWS + SESSIONS => Kind::Relayed,
                _ => Kind::Redirected,
            };
            asking.spawn(async move {
                let got = match kind {
                    Kind::View => views(client, mine, done).await,
                    Kind::Relayed => session(client, mine, false, done).await,
                    Kind::Redirected => session(client, mine, true, done).await,
                };
                (kind, got)
            });
        }
    });
    for place in &mut workers {
        // The new worker starts first, so that every role always has a worker.
        let newcomer = worker();
        coordinator.wait_for_workers(4);
        let mut old = std::mem::replace(place, newcomer);
        assert!(old.stop().success());
        coordinator.wait_for_workers(3);
    }
    done.store(true, Ordering::SeqCst);
    let got = runtime.block_on(asking.join_all());
    assert_eq!(got.len(), VIEWS + 2 * SESSIONS);
    for (kind, got) in &got {
        assert!(got.answered > 0, "{kind:?}: {got:?}");
        assert_eq!(got.fetched > 0, *kind == Kind::Redirected, "{kind:?}: {got:?}");
    }
    let counters = coordinator.status()["counters"].clone();
    assert_eq!(
        (counters["workers_lost"].as_u64(), counters["views_failed"].as_u64()),
        (Some(0), Some(0)),
        "{counters:#}"
    );
}
