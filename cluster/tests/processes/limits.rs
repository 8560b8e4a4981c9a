//! Limits of clients: requests beyond them are refused at once, with a hint when to retry.

use std::sync::atomic::Ordering;
use std::time::Duration;

use argus_cluster::{coordinator, core, worker};
use argus_proto::status::retry_after;
use argus_proto::v1::frame_chunk::Body;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::{Output, PlanRequest, View};
use futures::future::join_all;
use tokio::time::Instant;
use tonic::Code;

use crate::common;
use crate::common::session::Session;
use crate::common::{Cluster, direct, quick, render, request, start_worker_with, view};
use crate::watching::{page, value};

fn with(limits: impl FnOnce(&mut core::Config)) -> coordinator::Config {
    let mut config = quick();
    limits(&mut config.core);
    config
}

/// Far less than any wait for room.
const AT_ONCE: Duration = Duration::from_secs(5);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_clients_views_in_flight_are_limited() {
    let cluster = Cluster::start_with(with(|core| core.max_views_per_client = 3), 1).await;
    cluster.render(&view(0)).await.unwrap();
    cluster.settings.set(400_000, 0);
    let began = Instant::now();
    let all = join_all((0..8).map(|i| {
        let cluster = &cluster;
        async move { (cluster.render(&view(i)).await, began.elapsed()) }
    }));
    let (refused, answered): (Vec<_>, Vec<_>) =
        all.await.into_iter().partition(|(result, _)| result.is_err());
    assert_eq!((answered.len(), refused.len()), (3, 5));
    for (result, took) in refused {
        let status = result.unwrap_err();
        assert_eq!(status.code(), Code::ResourceExhausted, "{status}");
        assert!(status.message().contains("3 views of 127.0.0.1"), "{status}");
        assert!(retry_after(&status).is_some_and(|hint| hint >= Duration::from_millis(50)), "{status}");
        assert!(took < AT_ONCE);
    }
    cluster.settings.set(0, 0);
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pixels_per_second_are_limited_with_sub_pixels() {
    // A view has 768 pixels, and four times as many sub-pixels.
    let cluster = Cluster::start_with(with(|core| core.pixels_per_sec_per_client = Some(800.0)), 1).await;
    let plan = PlanRequest { supersampling: Some(2), ..PlanRequest::default() };
    cluster.render(&View { plan, ..view(0) }).await.unwrap();
    let status = cluster.render(&view(1)).await.unwrap_err();
    assert_eq!(status.code(), Code::ResourceExhausted);
    assert!(status.message().contains("800 pixels a second"), "{status}");
    let hint = retry_after(&status).unwrap();
    assert!(hint > Duration::from_secs(1) && hint <= Duration::from_secs(5), "{hint:?}");
    tokio::time::sleep(hint).await;
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_are_limited_and_a_closed_one_makes_room() {
    let limits = |core: &mut core::Config| (core.max_sessions, core.max_sessions_per_client) = (8, 2);
    let cluster = Cluster::start_with(with(limits), 1).await;
    let first = Session::open(&cluster).await;
    let mut second = Session::open(&cluster).await;
    let refused = cluster.views().session(futures::stream::pending()).await.err().unwrap();
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
    assert!(
        refused.message().contains("2 sessions of 127.0.0.1") && retry_after(&refused).is_some(),
        "{refused}"
    );
    drop(first);
    cluster.wait_for(|status| status.counters.is_some_and(|counters| counters.sessions_open == 1)).await;
    let _third = Session::open(&cluster).await;
    second.ask(1, &view(0)).await;
    assert!(matches!(second.answer().await, Some((1, 0, Ok(())))));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_overloaded_session_is_told_when_to_retry() {
    let cluster = Cluster::start_with(with(|core| core.pixels_per_sec = Some(100.0)), 1).await;
    let mut session = Session::open(&cluster).await;
    // More than the bucket's capacity, and admitted: the bucket is overdrawn for half a minute.
    session.ask(1, &View { width: 64, height: 48, ..view(0) }).await;
    assert!(matches!(session.answer().await, Some((1, 0, Ok(())))));
    session.acknowledge(1).await;
    session.ask(2, &view(0)).await;
    let failure = session.answer().await.unwrap().2.unwrap_err();
    assert_eq!(Code::from_i32(failure.code), Code::ResourceExhausted);
    assert!(failure.message.contains("all clients ask for more than 100 pixels"), "{failure:?}");
    assert!(failure.retry_after_ms > 0, "{failure:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_oversized_request_is_refused_unread() {
    let config = coordinator::Config { max_request_bytes: 4096, ..quick() };
    let cluster = Cluster::start_with(config, 1).await;
    let mut large = request(&view(0), 0);
    large.view_id = "x".repeat(5000);
    let status = cluster.views().render(large).await.err().unwrap();
    assert_eq!(status.code(), Code::OutOfRange, "{status}");
    cluster.render(&view(0)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_view_whose_deadline_passes_in_the_queue_is_not_rendered() {
    // The cost of a direct view is not measured yet, so all are admitted.
    let cluster = Cluster::start_with(with(|core| core.max_views_per_worker = 1), 1).await;
    cluster.settings.set(0, 600_000);
    let views = cluster.views();
    let long = tokio::spawn(async move { render(views, &direct(0), 0).await });
    cluster.wait_for(|status| status.workers.iter().any(|worker| worker.queued_views > 0)).await;
    let began = Instant::now();
    let status = render(cluster.views(), &direct(1), 100).await.unwrap_err();
    assert_eq!(status.code(), Code::DeadlineExceeded, "{status}");
    assert!(began.elapsed() < Duration::from_millis(500), "{:?}", began.elapsed());
    long.await.unwrap().unwrap();
    let status =
        cluster.wait_for(|status| status.workers.iter().all(|worker| worker.views_direct == 1)).await;
    assert_eq!(status.counters.unwrap().views_failed, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_full_compositor_drops_the_least_recently_used_samples() {
    let several_tiles = || {
        let mut config = quick();
        config.rig.tiles = Some([4, 4]);
        config
    };
    let (free, full) =
        (Cluster::start_with(several_tiles(), 1).await, Cluster::start_with(several_tiles(), 1).await);
    full.settings.compositor_holds.store(6, Ordering::SeqCst);
    for i in 0..24 {
        let (expected, _) = free.render(&view(i)).await.unwrap();
        let (frame, _) = full.render(&common::pinned(i, expected.provenance.clone())).await.unwrap();
        assert_eq!(frame.images[Output::Color], expected.images[Output::Color], "view {i}");
    }
    let most = |cluster: &Cluster| cluster.settings.most_held.load(Ordering::SeqCst);
    assert!(most(&free) > 6, "{} samples are too few to show anything", most(&free));
    assert!(most(&full) <= 6);
}

/// A frame larger than all windows together.
const LARGE: [u32; 2] = [2048, 2048];

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_that_do_not_read_relayed_frames_block_no_other_client() {
    let config = coordinator::Config { read_within: Duration::from_secs(1), ..quick() };
    let mut cluster = Cluster::start_with(config, 0).await;
    let url = cluster.coordinator.url();
    // Memory for only those frames: while they are held, no other one is rendered.
    let frame_bytes = 10 * u64::from(LARGE[0] * LARGE[1]) * 3;
    let config = worker::Config { frame_bytes, ..worker::Config::new(&url) };
    cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    cluster.wait_for(|status| status.processes == 1).await;
    let large = View { width: LARGE[0], height: LARGE[1], ..view(1) };
    let (mut frames, mut sessions) = (Vec::new(), Vec::new());
    for i in 0..10 {
        let mut client = ViewsClient::new(common::channel(&url));
        if i % 3 == 0 {
            let session = Session::open_by(client).await;
            session.ask(1, &large).await;
            sessions.push(session);
        } else {
            frames.push(client.render(request(&large, 0)).await.unwrap().into_inner());
        }
    }
    let held = async |least: f64| {
        let (_, metrics) = page(cluster.workers[0].address, "/metrics").await;
        value(&metrics, "argus_worker_frame_bytes") > least
    };
    while !held(0.0).await {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // Through the channel whose windows those frames fill.
    cluster.render(&large).await.unwrap();
    cluster.render(&view(3)).await.unwrap();
    let began = Instant::now();
    while held(0.0).await {
        assert!(began.elapsed() < common::LIMIT, "unread frames stay with their worker");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    // A client that resumes reading gets an error, and may retry.
    let mut unread = frames.pop().unwrap();
    let ended = loop {
        match unread.message().await {
            Ok(chunk) => assert!(chunk.is_some(), "half a frame is not all of it"),
            Err(status) => break status,
        }
    };
    assert_eq!(ended.code(), Code::Unavailable, "{ended}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_with_unread_frames_serves_other_clients() {
    let cluster = Cluster::start(1).await;
    let url = cluster.coordinator.url();
    let large = View { width: LARGE[0], height: LARGE[1], ..view(1) };
    cluster.render(&large).await.unwrap();
    // Each on its own connection, of which only the header is read.
    let mut slow = Vec::new();
    for i in 0..8 {
        let began = Instant::now();
        let mut client = ViewsClient::new(common::channel(&url));
        let mut frame = client.render(request(&large, 0)).await.unwrap().into_inner();
        assert!(frame.message().await.unwrap().is_some());
        slow.push(frame);
        assert!(began.elapsed() < AT_ONCE, "client {i} waited {:?} for others", began.elapsed());
    }
    let began = Instant::now();
    for frame in [cluster.render(&large).await, cluster.render(&view(3)).await] {
        frame.unwrap();
    }
    assert!(began.elapsed() < AT_ONCE, "a reading client waited {:?} for others", began.elapsed());
    // Their frames are still available.
    for mut frame in slow {
        let mut bytes = 0;
        while let Some(chunk) = frame.message().await.unwrap() {
            bytes += chunk.body.map_or(0, |body| match body {
                Body::Data(data) => data.bytes.len(),
                Body::Header(_) | Body::Trailer(_) => 0,
            });
        }
        assert_eq!(bytes, (LARGE[0] * LARGE[1] * 3) as usize);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_wait_for_frame_memory_and_are_all_answered() {
    let mut cluster = Cluster::start_with(quick(), 0).await;
    let wanted = View { width: 64, height: 48, ..view(1) };
    // Memory for two frames, each raw and packed.
    let frame_bytes = 2 * u64::from(wanted.width * wanted.height) * 3 * 2;
    let config = worker::Config { frame_bytes, ..worker::Config::new(cluster.coordinator.url()) };
    cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    cluster.wait_for(|status| status.processes == 1).await;
    cluster.settings.set(20_000, 0);
    for answer in join_all((0..12).map(|_| cluster.render(&wanted))).await {
        answer.unwrap();
    }
    assert!(cluster.settings.largest_batch.load(Ordering::SeqCst) <= 2);
    // A frame larger than the whole memory is rendered alone.
    cluster.render(&View { width: 256, height: 256, ..view(2) }).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_that_take_all_slots_of_a_worker_do_not_block_its_coordinator() {
    let mut cluster = Cluster::start_with(quick(), 0).await;
    let config = worker::Config { max_connections: 8, ..worker::Config::new(cluster.coordinator.url()) };
    cluster.workers.push(start_worker_with(config, &cluster.settings, Default::default()));
    cluster.wait_for(|status| status.processes == 1).await;
    // Silent connections from several addresses, since one address may not take all slots.
    let mut clients = Vec::new();
    for i in 0..9 {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.bind(([127, 0, 0, 2 + i / 3], 0).into()).unwrap();
        clients.push(socket.connect(cluster.workers[0].address).await.unwrap());
    }
    cluster.render(&view(1)).await.unwrap();
    cluster.render(&view(2)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_of_unauthenticated_services_are_small() {
    let cluster = Cluster::start(1).await;
    for url in [cluster.coordinator.url(), cluster.workers[0].url()] {
        let mut health = tonic_health::pb::health_client::HealthClient::new(common::channel(&url));
        let ask = |service: String| tonic_health::pb::HealthCheckRequest { service };
        let refused = health.check(ask("x".repeat(5000))).await.unwrap_err();
        assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
        health.check(ask(String::new())).await.unwrap();
    }
}
