//! Sessions remember their last frame, relayed or fetched from the worker.

use argus_client::{Client, Session, SessionEvent, SessionOptions};
use argus_cluster::worker::{Config, Public};
use argus_scene::frame::Reason;
use argus_scene::{Frame, Output, Plan, PlanRequest, View};

use crate::common::{Cluster, LIMIT, quick, start_worker_with, view};

/// A view whose request leaves the way open.
fn open(i: usize) -> View {
    View { plan: PlanRequest::default(), ..view(i) }
}

async fn next(session: &mut Session, view: &View) -> Frame {
    session.send(view);
    match tokio::time::timeout(LIMIT, session.next()).await.expect("a session must answer").unwrap() {
        SessionEvent::Frame { frame, .. } => *frame,
        SessionEvent::Failed { error, .. } => panic!("{error}"),
    }
}

fn is_direct(frame: &Frame) -> bool {
    matches!(frame.provenance.plan, Plan::Direct { .. })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_viewer_at_rest_keeps_its_frame_relayed_or_fetched() {
    for redirect in [false, true] {
        let mut cluster = Cluster::start_with(quick(), 0).await;
        cluster.settings.set(0, 60_000);
        let config = Config { public: Some(Public::AsAdvertised), ..Config::new(cluster.coordinator.url()) };
        cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
        cluster.wait_for(|status| status.processes == 1).await;
        let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
        let mut session = client.session(SessionOptions { redirect, ..SessionOptions::default() });
        let first = next(&mut session, &open(1)).await;
        assert!(is_direct(&first), "no worker holds a source");
        for _ in 0..3 {
            let again = next(&mut session, &open(1)).await;
            let decision = again.decision.unwrap();
            assert_eq!(decision.reason, Reason::Kept, "redirected: {redirect}, {decision:?}");
            assert_eq!(
                (&again.provenance, &again.images[Output::Color]),
                (&first.provenance, &first.images[Output::Color])
            );
        }
    }
}
