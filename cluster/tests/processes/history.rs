//! Reprojection in sessions: requests for it, the workers that can do it, and the fallback without an earlier frame.

use argus_client::{Client, Session as Moving, SessionEvent, SessionOptions};
use argus_cluster::worker::{Config, Public};
use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::status::invalid_field;
use argus_proto::v1::frame_chunk::Body;
use argus_scene::{Frame, Limits, Output, Outputs, Plan, PlanRequest, Provenance, Search, View};

use crate::common::session::Session;
use crate::common::{Cluster, LIMIT, quick, start_worker_with, view};

async fn moving(cluster: &Cluster, redirect: bool) -> Moving {
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    client.session(SessionOptions { redirect, history: true, ..SessionOptions::default() })
}

async fn next(session: &mut Moving, view: &View) -> (Frame, FrameMeta) {
    session.send(view);
    match tokio::time::timeout(LIMIT, session.next()).await.expect("a session must answer").unwrap() {
        SessionEvent::Frame { frame, meta, .. } => (*frame, meta),
        SessionEvent::Failed { error, .. } => panic!("{error}"),
    }
}

fn search_of(frame: &Frame) -> Search {
    let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a view from samples") };
    warp.search
}

/// A view that may be reprojected.
fn begun(i: usize) -> View {
    View { plan: PlanRequest::default(), ..view(i) }
}

async fn cluster_of(count: usize) -> Cluster {
    let mut cluster = Cluster::start_with(quick(), 0).await;
    for _ in 0..count {
        let config = Config { public: Some(Public::AsAdvertised), ..Config::new(cluster.coordinator.url()) };
        cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    }
    cluster.wait_for(|status| status.processes as usize == count).await;
    cluster
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_with_history_reprojects_its_last_frame() {
    let cluster = cluster_of(1).await;
    for redirect in [false, true] {
        let mut session = moving(&cluster, redirect).await;
        for i in 0..4 {
            let (frame, _) = next(&mut session, &begun(i)).await;
            assert_eq!(frame.provenance.history, i > 0, "frame {i}, redirected: {redirect}");
            assert_eq!(search_of(&frame), Search::Seeded);
            let kept = [
                &frame.images[Output::Range],
                &frame.images[Output::Source],
                &frame.images[Output::Mask],
                &frame.images[Output::Confidence],
            ];
            assert!(kept.iter().all(|image| image.is_none()), "only colour was requested");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_without_history_reprojects_nothing() {
    let cluster = cluster_of(1).await;
    let mut moved = moving(&cluster, false).await;
    next(&mut moved, &begun(1)).await;
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    let mut plain = client.session(SessionOptions::default());
    for i in 1..4 {
        let (frame, _) = next(&mut plain, &view(i)).await;
        let (asked, _) = cluster.render(&view(i)).await.unwrap();
        assert_eq!((search_of(&frame), frame.provenance.history), (Search::Splat, false));
        assert_eq!(
            (&frame.images[Output::Color], &frame.provenance),
            (&asked.images[Output::Color], &asked.provenance)
        );
    }
    // A frame without reprojection can be pinned, in a session with history or not.
    let seeded = PlanRequest { search: Some(Search::Seeded), ..PlanRequest::default() };
    let (first, _) = next(&mut moving(&cluster, false).await, &begun(7)).await;
    let (asked, _) = cluster.render(&View { plan: seeded, ..view(7) }).await.unwrap();
    assert_eq!(
        (&first.images[Output::Color], &first.provenance),
        (&asked.images[Output::Color], &asked.provenance)
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_that_cannot_be_reprojected_are_refused_by_field() {
    let cluster = cluster_of(1).await;
    let mut session = Session::open(&cluster).await;
    session.history = true;
    let (frame, _) = cluster.render(&view(1)).await.unwrap();
    let plan = |plan| View { plan, ..view(1) };
    let others = Search::ALL.into_iter().filter(|search| *search != Search::Seeded);
    let searches = others.map(|search| plan(PlanRequest { search: Some(search), ..PlanRequest::default() }));
    let direct = plan(PlanRequest { direct: true, ..PlanRequest::default() });
    let pinned = View { pin: Some(frame.provenance.clone()), ..view(1) };
    for (i, view) in searches.chain([direct, pinned]).enumerate() {
        session.ask(i as u64 + 1, &view).await;
        let (_, _, answer) = session.answer().await.unwrap();
        assert_eq!(answer.unwrap_err().field, "history", "{view:?}");
    }
    let wish = PlanRequest { search: Some(Search::Seeded), ..PlanRequest::default() };
    session.ask(99, &plan(wish)).await;
    assert!(session.answer().await.unwrap().2.is_ok(), "the session goes on");
    let begun = Provenance { history: true, ..frame.provenance };
    let status = cluster.render(&View { pin: Some(begun), ..view(1) }).await.unwrap_err();
    assert_eq!(invalid_field(&status).unwrap().0, "pin.history");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_its_worker_a_session_starts_from_samples_again() {
    for redirect in [false, true] {
        let mut cluster = cluster_of(2).await;
        let mut session = moving(&cluster, redirect).await;
        let mut last = next(&mut session, &begun(0)).await;
        for i in 1..50 {
            last = next(&mut session, &begun(i)).await;
            if last.0.provenance.history {
                break;
            }
        }
        assert!(last.0.provenance.history, "its last frame's worker is chosen now and then");
        let workers = cluster.status().await.workers;
        let lost = workers.iter().find(|worker| worker.id == last.1.worker).unwrap();
        cluster.worker_at(&lost.address).kill();
        let mut has_begun = false;
        for i in 50..60 {
            let (frame, meta) = next(&mut session, &begun(i)).await;
            assert_ne!(meta.worker, lost.id);
            has_begun |= frame.provenance.history;
        }
        assert!(has_begun, "from the frames of the worker that is left");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_reprojected_frame_is_sent_anew_if_its_worker_dies_within_it() {
    let mut cluster = cluster_of(2).await;
    let mut session = Session::open(&cluster).await;
    session.history = true;
    let large = View { width: 2048, height: 2048, outputs: Outputs::COLOR, ..begun(1) };
    let mut assembler = FrameAssembler::new(Limits::default());
    let (mut seq, mut killed) = (1, false);
    session.ask(seq, &large).await;
    let (mut received, mut headers) = (0, Vec::new());
    let frame = loop {
        let chunk = session.chunk().await;
        received += 1;
        if let Some(Body::Header(header)) = &chunk.body {
            assembler.abandon();
            headers.push(header.clone());
            received = 0;
        }
        let header = headers.last().unwrap();
        let begun = header.provenance.as_ref().unwrap().history;
        if !killed && begun && received == 3 {
            let workers = cluster.status().await.workers;
            let address = workers.into_iter().find(|worker| worker.id == header.worker).unwrap().address;
            cluster.worker_at(&address).kill();
            killed = true;
        }
        match assembler.push(chunk).unwrap() {
            Some((frame, _)) if killed => break frame,
            Some(_) => {
                assert!(seq < 50, "its last frame's worker is chosen now and then");
                session.acknowledge(seq).await;
                seq += 1;
                session.ask(seq, &large).await;
            }
            None => {}
        }
    };
    let [.., lost, whole] = &headers[..] else { panic!("a header before the worker died, and one after") };
    assert_ne!(lost.worker, whole.worker);
    let plan = PlanRequest { search: Some(Search::Seeded), ..PlanRequest::default() };
    if !frame.provenance.history {
        let (fresh, _) = cluster.render(&View { plan, ..large }).await.unwrap();
        assert_eq!(
            (&frame.images[Output::Color], &frame.provenance),
            (&fresh.images[Output::Color], &fresh.provenance)
        );
    }
}
