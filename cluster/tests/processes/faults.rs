//! Workers that die, devices that are lost, coordinators that restart: nothing is lost but time.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use argus_cluster::{core, worker};
use argus_proto::v1::Role;
use argus_scene::{Output, View};
use futures::future::join_all;
use tonic::Code;

use crate::common;
use crate::common::roles::Settings;
use crate::common::{
    Cluster, Opener, Source, direct, quick, scene, start_coordinator, start_coordinator_at, start_worker,
    start_worker_with, view,
};
use crate::watching::page;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_killed_worker_loses_no_view() {
    let mut cluster = Cluster::start(3).await;
    cluster.settings.set(10_000, 10_000);
    for victim in ["compositor", "sampler"] {
        let channel = cluster.views();
        let views = join_all((0..80).map(|i| {
            let (client, view) = (channel.clone(), if i % 8 == 0 { direct(i) } else { view(i) });
            tokio::spawn(async move { common::render(client, &view, 0).await })
        }));
        tokio::time::sleep(Duration::from_millis(60)).await;
        let status = cluster.status().await;
        let role =
            |w: &&argus_proto::v1::WorkerStatus| w.role().as_str_name().ends_with(&victim.to_uppercase());
        let address = status.workers.iter().find(role).unwrap().address.clone();
        cluster.worker_at(&address).kill();
        for answered in views.await {
            answered.unwrap().unwrap();
        }
        // A new worker replaces it.
        let replacement = start_worker(&cluster.coordinator.url(), &cluster.settings);
        cluster.workers.push(replacement);
        cluster.wait_for(|s| s.processes == 3 && s.samplers == 1).await;
    }
    let counters = cluster.status().await.counters.unwrap();
    assert_eq!((counters.views_answered, counters.views_failed, counters.workers_lost), (160, 0, 2));
    assert!(counters.views_retried > 0, "{counters:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn another_worker_continues_a_killed_ones_frame_byte_for_byte() {
    let mut cluster = Cluster::start(3).await;
    let large = View { width: 4096, height: 2048, ..view(1) };
    let (whole, _) = cluster.render(&large).await.unwrap();
    let mut client = cluster.views();
    let mut chunks = client.render(common::request(&large, 0)).await.unwrap().into_inner();
    let limits = argus_scene::Limits::default();
    let mut assembler = argus_proto::chunks::FrameAssembler::new(limits);
    let mut header = None;
    let mut frame = None;
    let mut received = 0;
    while let Some(chunk) = chunks.message().await.unwrap() {
        if let Some(argus_proto::v1::frame_chunk::Body::Header(h)) = &chunk.body {
            header = Some(h.clone());
        }
        received += 1;
        if received == 4 {
            let id = header.clone().unwrap().worker;
            let address = cluster.status().await.workers.into_iter().find(|w| w.id == id).unwrap().address;
            cluster.worker_at(&address).kill();
        }
        if let Some((complete, _)) = assembler.push(chunk).unwrap() {
            frame = Some(complete);
        }
    }
    assert_eq!(frame.unwrap().images[Output::Color], whole.images[Output::Color]);
    assert_eq!(cluster.status().await.counters.unwrap().views_retried, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_recovers_from_a_lost_device_and_from_a_panic() {
    let cluster = Cluster::start(1).await;
    let (expected, _) = cluster.render(&view(1)).await.unwrap();
    for misfortune in [&cluster.settings.lose_device, &cluster.settings.panics] {
        let made = cluster.settings.compositors_made.load(Ordering::SeqCst);
        misfortune.store(1, Ordering::SeqCst);
        let (frame, _) = cluster.render(&view(1)).await.unwrap();
        assert_eq!(frame.images[Output::Color], expected.images[Output::Color]);
        // A direct view that lost the device also lost the compositor, which is remade before this view or by it.
        let made_anew = cluster.settings.compositors_made.load(Ordering::SeqCst) - made;
        assert!((1..=2).contains(&made_anew), "{made_anew} compositors were made");
        misfortune.store(1, Ordering::SeqCst);
        cluster.render(&direct(1)).await.unwrap();
    }
    assert_eq!(cluster.status().await.counters.unwrap().views_retried, 0, "no other worker got it");
    // After repeated failures the view fails with a clear error, and the cluster continues. Samplers that are made meanwhile lose
    // their device as well, any number of times.
    cluster.settings.lose_device.store(usize::MAX / 2, Ordering::SeqCst);
    let status = cluster.render(&view(1)).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable);
    assert!(status.message().contains("device was lost"), "{status}");
    cluster.settings.lose_device.store(0, Ordering::SeqCst);
    assert_eq!(
        cluster.render(&view(1)).await.unwrap().0.images[Output::Color],
        expected.images[Output::Color]
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_last_worker_renders_samples_at_once() {
    let mut cluster = Cluster::start(2).await;
    let made = |cluster: &Cluster| cluster.settings.samplers_made.load(Ordering::SeqCst);
    assert_eq!(made(&cluster), 2, "each worker has made a sampler before it was ready");
    let sampler = |status: &argus_proto::v1::StatusResponse| {
        let samples = |w: &&argus_proto::v1::WorkerStatus| w.role() == argus_proto::v1::Role::Sampler;
        status.workers.iter().find(samples).map(|w| w.address.clone())
    };
    cluster.wait_for(|status| sampler(status).is_some()).await;
    let address = sampler(&cluster.status().await).unwrap();
    cluster.worker_at(&address).kill();
    cluster.render(&view(1)).await.unwrap();
    assert_eq!(made(&cluster), 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_from_held_samples_do_not_wait_for_a_new_sampler() {
    let mut cluster = Cluster::start(1).await;
    let (before, _) = cluster.render(&view(1)).await.unwrap();
    let making = Duration::from_secs(3);
    cluster.settings.sampler_us.store(making.as_micros() as u64, Ordering::SeqCst);
    let made_before = cluster.settings.samplers_made.load(Ordering::SeqCst);
    let began = Instant::now();
    cluster.workers.push(start_worker_with(
        worker::Config::new(cluster.coordinator.url()),
        &cluster.settings,
        Opener::default().into(),
    ));
    for _ in 0..5 {
        tokio::time::sleep(Duration::from_millis(50)).await;
        assert_eq!(
            cluster.render(&view(1)).await.unwrap().0.images[Output::Color],
            before.images[Output::Color]
        );
    }
    assert!(began.elapsed() < making, "views of what is held waited: {:?}", began.elapsed());
    cluster.wait_for(|status| status.processes == 2).await;
    assert!(began.elapsed() >= making);
    assert_eq!(cluster.settings.samplers_made.load(Ordering::SeqCst), made_before + 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_failing_view_does_not_fail_its_batch() {
    let cluster = Cluster::start(2).await;
    cluster.settings.set(5000, 0);
    cluster.settings.poisoned_width.store(13, Ordering::SeqCst);
    let views = (0..32).map(|i| if i == 7 { View { width: 13, ..view(i) } } else { view(i) });
    let views: Vec<View> = views.collect();
    let answers = join_all(views.iter().map(|view| cluster.render(view))).await;
    for (i, answer) in answers.into_iter().enumerate() {
        match i {
            7 => assert_eq!(answer.unwrap_err().code(), Code::Internal),
            _ => drop(answer.unwrap()),
        }
    }
    assert!(cluster.settings.largest_batch.load(Ordering::SeqCst) > 8);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn workers_rejoin_a_restarted_coordinator() {
    let mut cluster = Cluster::start(2).await;
    let (before, _) = cluster.render(&view(1)).await.unwrap();
    let address = cluster.coordinator.address;
    cluster.coordinator.kill();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let source = Source { scene: scene("test"), files: Vec::new() };
    cluster.coordinator = start_coordinator_at(quick(), Some(address), source);
    cluster.channel = common::channel(&cluster.coordinator.url());
    let status = cluster.wait_for(|s| s.processes == 2).await;
    assert_eq!(status.counters.unwrap().workers_joined, 2);
    let rendered = cluster.settings.samples_rendered.load(Ordering::SeqCst);
    let (after, _) = cluster.render(&view(1)).await.unwrap();
    assert_eq!(after.images[Output::Color], before.images[Output::Color]);
    assert_eq!(
        cluster.settings.samples_rendered.load(Ordering::SeqCst),
        rendered,
        "they still hold the samples"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stopped_worker_finishes_its_views() {
    let mut cluster = Cluster::start(3).await;
    cluster.settings.set(20_000, 20_000);
    let channel = cluster.views();
    let views = join_all((0..60).map(|i| {
        let (client, view) = (channel.clone(), view(i));
        tokio::spawn(async move { common::render(client, &view, 0).await })
    }));
    tokio::time::sleep(Duration::from_millis(100)).await;
    for worker in &mut cluster.workers[..2] {
        worker.stop().await.unwrap();
    }
    for answered in views.await {
        answered.unwrap().unwrap();
    }
    let counters = cluster.status().await.counters.unwrap();
    assert_eq!((counters.views_answered, counters.workers_lost), (60, 0), "{counters:?}");
    cluster.wait_for(|s| s.processes == 1 && s.samplers == 1 && s.compositors == 1).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stopped_coordinator_answers_its_views() {
    let mut cluster = Cluster::start(2).await;
    cluster.settings.set(100_000, 0);
    let channel = cluster.views();
    let views: Vec<_> = (0..4)
        .map(|i| tokio::spawn(common::render(channel.clone(), Box::leak(Box::new(view(i))), 0)))
        .collect();
    cluster.wait_for(|s| s.workers.iter().any(|w| w.queued_views > 0)).await;
    cluster.coordinator.stop().await.unwrap();
    for answered in views {
        answered.await.unwrap().unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_view_of_a_silent_worker_is_answered_by_another_one() {
    let config = {
        let mut config = quick();
        config.core.lease = Duration::from_millis(400);
        config
    };
    let mut cluster = Cluster::start_with(config, 2).await;
    cluster.settings.set(50_000, 0);
    let (_, meta) = cluster.render(&view(0)).await.unwrap();
    // A worker that hangs: its connections stay open, nothing moves. Stood in for by a proxy that swallows
    // everything it is given, announced as a worker by a hello of our own.
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let swallow = tokio::spawn(async move {
        let mut open = Vec::new();
        while let Ok((stream, _)) = listener.accept().await {
            open.push(stream);
        }
    });
    use argus_proto::v1::{Hello, Measurements, WorkerReport, worker_report::Body};
    let (reports, outgoing) = tokio::sync::mpsc::channel(8);
    let hello = Hello {
        public_address: String::new(),
        protocol_version: argus_proto::PROTOCOL_VERSION,
        worker_id: "hangs".to_owned(),
        pid: 1,
        address: address.clone(),
        device: common::roles::DEVICE.to_owned(),
        cores: 1,
        scene_hash: Default::default(),
    };
    reports.send(WorkerReport { body: Some(Body::Hello(hello)) }).await.unwrap();
    let mut client = argus_proto::v1::cluster_client::ClusterClient::new(cluster.channel.clone());
    let incoming = tokio_stream::wrappers::ReceiverStream::new(outgoing);
    let mut assignments = client.join(incoming).await.unwrap().into_inner();
    let first = assignments.message().await.unwrap().unwrap();
    let ready = Measurements { applied: first.sequence, ..Measurements::default() };
    reports.send(WorkerReport { body: Some(Body::Measurements(ready)) }).await.unwrap();
    cluster.wait_for(|s| s.processes == 3).await;
    let answers = join_all((0..40).map(|i| {
        let (client, view) = (cluster.views(), view(i));
        async move { common::render(client, &view, 0).await }
    }))
    .await;
    for answer in answers {
        assert_ne!(answer.unwrap().1.worker, "hangs");
    }
    assert!(!meta.worker.is_empty());
    cluster.wait_for(|s| s.counters.is_some_and(|counters| counters.workers_lost == 1)).await;
    let ended = loop {
        match assignments.message().await {
            Ok(Some(_)) => {}
            ended => break ended,
        }
    };
    assert_eq!(ended.unwrap_err().code(), Code::Aborted, "its stream was ended, with the reason");
    swallow.abort();
    cluster.workers.clear();
}

/// Starts workers, each with its own settings.
async fn with_settings_of_their_own(
    config: argus_cluster::coordinator::Config,
    count: usize,
) -> (Cluster, Vec<Arc<Settings>>) {
    let mut cluster = Cluster::start_with(config, 0).await;
    let settings: Vec<Arc<Settings>> = (0..count).map(|_| Arc::default()).collect();
    let url = cluster.coordinator.url();
    cluster.workers.extend(settings.iter().map(|own| start_worker(&url, own)));
    cluster.wait_for(|status| status.processes as usize == count).await;
    (cluster, settings)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stuck_worker_that_still_reports_loses_no_view() {
    for role in [Role::Compositor, Role::Sampler] {
        let mut config = quick();
        config.core.stuck_after = Duration::from_millis(500);
        // A lease far longer than the test, so that silence does not reveal it.
        config.core.lease = Duration::from_secs(600);
        config.rig.tiles = Some([4, 4]);
        let (cluster, settings) = with_settings_of_their_own(config, 3).await;
        cluster.priced().await;
        for i in 0..6 {
            cluster.render(&view(i)).await.unwrap();
            cluster.render(&direct(i)).await.unwrap();
        }
        let measured = cluster.wait_for(|s| s.view_ms > 0.0 && s.sample_ms > 0.0 && s.direct_ms > 0.0).await;
        let stuck = measured.workers.iter().find(|w| w.role() == role).unwrap();
        let at = cluster.workers.iter().position(|w| w.url() == stuck.address).unwrap();
        settings[at].stuck.store(true, Ordering::SeqCst);
        // Also of tiles without held samples, some of which samplers render.
        let answers = join_all((6..30).map(|i| {
            let (client, view) = (cluster.views(), if i % 4 == 0 { direct(i) } else { view(i) });
            async move { common::render(client, &view, 0).await }
        }))
        .await;
        for answer in answers {
            assert_ne!(answer.unwrap().1.worker, stuck.id);
        }
        let status = cluster.status().await;
        let counters = status.counters.unwrap();
        assert!(counters.views_retried > 0, "{role:?}: {counters:?}");
        assert_eq!((counters.views_failed, counters.workers_lost, status.processes), (0, 0, 3), "{role:?}");
        // A worker that was only slow gets views again.
        settings[at].stuck.store(false, Ordering::SeqCst);
        let back = async {
            for i in 0.. {
                let view = if role == Role::Sampler { direct(i) } else { view(i) };
                if cluster.render(&view).await.unwrap().1.worker == stuck.id {
                    return;
                }
            }
        };
        tokio::time::timeout(common::LIMIT, back).await.expect("it is given views again");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_without_a_device_attracts_no_views_and_is_not_ready() {
    let (cluster, settings) = with_settings_of_their_own(quick(), 3).await;
    for i in 0..6 {
        cluster.render(&view(i)).await.unwrap();
    }
    let status = cluster.status().await;
    let broken = status.workers.iter().find(|w| w.role() == Role::Compositor).unwrap();
    let at = cluster.workers.iter().position(|w| w.url() == broken.address).unwrap();
    assert_eq!(page(cluster.workers[at].address, "/readyz").await.0, 200);
    settings[at].lose_device.store(1, Ordering::SeqCst);
    settings[at].no_device.store(true, Ordering::SeqCst);
    // Enough views at once that it gets some, although it lost its samples with its device.
    let fails = async {
        loop {
            for answer in
                join_all((0..20).map(view).map(|view| async { cluster.render(&{ view }).await })).await
            {
                assert_ne!(answer.unwrap().1.worker, broken.id);
            }
            let (code, reason) = page(cluster.workers[at].address, "/readyz").await;
            if code == 503 {
                return reason;
            }
        }
    };
    let reason = tokio::time::timeout(common::LIMIT, fails).await.expect("it says so");
    // From then on it is tried now and then, although its queue is always the shortest.
    let retried = async || cluster.status().await.counters.unwrap().views_retried;
    let before = retried().await;
    for i in 0..40 {
        assert_ne!(cluster.render(&view(i)).await.unwrap().1.worker, broken.id);
    }
    let more = retried().await - before;
    assert!(more < 8, "{more} more views went there");
    assert!(reason.contains("in a row") && reason.contains("no device"), "{reason}");
    // It is tried now and then, and gets views again once it answers.
    settings[at].no_device.store(false, Ordering::SeqCst);
    settings[at].lose_device.store(0, Ordering::SeqCst);
    let back = async { while cluster.render(&view(1)).await.unwrap().1.worker != broken.id {} };
    tokio::time::timeout(common::LIMIT, back).await.expect("it is given views again");
    assert_eq!(page(cluster.workers[at].address, "/readyz").await.0, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_unused_sampler_is_dropped_after_a_while() {
    let mut cluster = Cluster::start(0).await;
    let rest_after = Duration::from_millis(400);
    let config = worker::Config { rest_after, ..worker::Config::new(cluster.coordinator.url()) };
    for _ in 0..2 {
        cluster.workers.push(start_worker_with(config.clone(), &cluster.settings, Opener::default().into()));
        // The first worker alone plays both roles, and later gives one up.
        let count = cluster.workers.len() as u32;
        cluster.wait_for(|status| status.processes == count).await;
        cluster.render(&view(1)).await.unwrap();
    }
    let count = |count: &std::sync::atomic::AtomicUsize| count.load(Ordering::SeqCst);
    // The first worker finishes its old role's work first.
    let plays =
        |status: &argus_proto::v1::StatusResponse| status.workers.iter().any(|w| w.role() == Role::Sampler);
    cluster.wait_for(plays).await;
    let status = cluster.status().await;
    let sampler = status.workers.iter().find(|w| w.role() == Role::Sampler).unwrap().address.clone();
    cluster.worker_at(&sampler).kill();
    cluster.wait_for(|status| status.processes == 1).await;
    cluster.render(&direct(1)).await.unwrap();
    let made = count(&cluster.settings.samplers_made);
    // Another worker joins, and one of the two has an unused sampler.
    cluster.workers.push(start_worker_with(config, &cluster.settings, Opener::default().into()));
    cluster.wait_for(|status| status.processes == 2 && status.samplers == 1).await;
    let dropped = async {
        while count(&cluster.settings.samplers_dropped) < made - 1 {
            cluster.render(&view(1)).await.unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(common::LIMIT, dropped).await.expect("an unused sampler is dropped");
    cluster.render(&view(2)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_waits_for_a_coordinator_to_start() {
    let address = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let settings = Arc::new(Settings::default());
    let short = Duration::from_millis(50);
    let config = worker::Config {
        join_timeout: short,
        connect_timeout: short,
        ..worker::Config::new(format!("http://{address}"))
    };
    let worker = start_worker_with(config, &settings, Opener::default().into());
    tokio::time::sleep(short * 10).await;
    assert!(page(worker.address, "/readyz").await.1.contains("no coordinator"));
    let source = Source { scene: scene("test"), files: Vec::new() };
    let coordinator = start_coordinator_at(quick(), Some(address), source);
    let client = argus_proto::v1::views_client::ViewsClient::new(common::channel(&coordinator.url()));
    common::render(client, &view(0), 0).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_reports_in_one_line_why_it_cannot_start() {
    let settings = Arc::new(Settings::default());
    let opener = || Arc::new(Opener::default());
    let config = |url: &str| worker::Config {
        join_timeout: Duration::from_millis(300),
        give_up_after: Some(Duration::from_millis(300)),
        connect_timeout: Duration::from_millis(200),
        ..worker::Config::new(url)
    };
    let error = async |config| {
        let mut worker = start_worker_with(config, &settings, opener());
        worker.ended().await.unwrap_err().to_string()
    };
    let unused = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let unanswered = error(config(&format!("http://{unused}"))).await;
    assert!(
        unanswered.contains("no coordinator answers at") && unanswered.contains("argus coordinator"),
        "{unanswered}"
    );
    let mute = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let silent = error(config(&format!("http://{}", mute.local_addr().unwrap()))).await;
    assert!(silent.contains("no coordinator answers at"), "{silent}");
    for url in ["not a url", "https://127.0.0.1:1", "127.0.0.1:7400"] {
        let wrong = error(config(url)).await;
        assert!(wrong.contains("coordinator's URL"), "{wrong}");
    }
    let advertised = worker::Config { advertise: Some("nowhere".to_owned()), ..config("http://127.0.0.1:1") };
    assert!(error(advertised).await.contains("advertised address"));
    settings.no_device.store(true, Ordering::SeqCst);
    let device = error(config("http://127.0.0.1:1")).await;
    assert!(device.contains("cannot render") && device.contains("no device"), "{device}");
    for line in [unanswered, silent, device] {
        assert_eq!(line.lines().count(), 1);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_of_disconnected_clients_are_cancelled() {
    let cluster = Cluster::start(1).await;
    cluster.render(&view(0)).await.unwrap();
    cluster.settings.set(20_000_000, 0);
    let cancelled = || cluster.settings.cancelled.load(Ordering::SeqCst) > 0;
    // On a busy machine a client may be gone before its view is in work, and then there is nothing to cancel.
    for _ in 0..20 {
        let mut client = cluster.views();
        let impatient = client.render(common::request(&view(1), 0));
        let answered = tokio::time::timeout(Duration::from_millis(200), async {
            let mut chunks = impatient.await.unwrap().into_inner();
            chunks.message().await
        });
        assert!(answered.await.is_err());
        let begin = tokio::time::Instant::now();
        while !cancelled() && begin.elapsed() < Duration::from_secs(2) {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        if cancelled() {
            break;
        }
    }
    assert!(cancelled());
    let late = common::render(cluster.views(), &view(2), 150).await.unwrap_err();
    assert_eq!(late.code(), Code::DeadlineExceeded);
    cluster.settings.set(0, 0);
    cluster.render(&view(3)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn overload_is_refused_at_once_and_passes() {
    let mut config = quick();
    config.core = core::Config { max_views: 8, ..config.core };
    let cluster = Cluster::start_with(config, 1).await;
    cluster.render(&view(0)).await.unwrap();
    cluster.settings.set(100_000, 0);
    let answers = join_all((0..20).map(|i| {
        let (client, view) = (cluster.views(), view(i));
        async move {
            let began = tokio::time::Instant::now();
            (common::render(client, &view, 0).await, began.elapsed())
        }
    }))
    .await;
    let (mut answered, mut rejected) = (0, 0);
    for (answer, took) in answers {
        match answer {
            Ok(_) => answered += 1,
            Err(status) => {
                assert_eq!(status.code(), Code::ResourceExhausted);
                assert!(argus_proto::status::retry_after(&status).is_some());
                assert!(took < Duration::from_millis(500), "{took:?}");
                rejected += 1;
            }
        }
    }
    assert_eq!((answered, rejected), (8, 12));
    cluster.settings.set(0, 0);
    cluster.render(&view(1)).await.unwrap();
    assert_eq!(cluster.status().await.counters.unwrap().views_rejected, 12);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_without_the_scene_fetches_it_by_hash() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, vec![7; 3_000_000]).unwrap();
        (name.to_owned(), path)
    };
    let files = vec![place("scene.gltf"), place("data.bin")];
    let settings = Arc::new(Settings::default());
    for files in [files, Vec::new()] {
        let source = Source { scene: scene("bundle"), files: files.clone() };
        let coordinator = start_coordinator_at(quick(), None, source);
        let opener = Arc::new(Opener { has_nothing: true, ..Opener::default() });
        let config = worker::Config::new(coordinator.url());
        let _worker = start_worker_with(config, &settings, opener.clone());
        let client = argus_proto::v1::views_client::ViewsClient::new(common::channel(&coordinator.url()));
        common::render(client, &view(0), 0).await.unwrap();
        let fetched = opener.fetched.lock().clone();
        let names: Vec<&str> = fetched.iter().map(|file| file.name.as_str()).collect();
        match files.is_empty() {
            true => assert_eq!((opener.generated.load(Ordering::SeqCst), fetched.len()), (1, 0)),
            false => {
                assert_eq!(names, ["scene.gltf", "data.bin"], "the one to open comes first");
                assert!(fetched.iter().all(|file| file.bytes.len() == 3_000_000));
            }
        }
    }
    // Files with another hash are refused.
    let wrong = Source {
        scene: Arc::new(argus_scene::Scene { name: "other".into(), ..(*scene("x")).clone() }),
        files: Vec::new(),
    };
    let coordinator = start_coordinator_at(quick(), None, wrong);
    let opener = Arc::new(Opener { has_nothing: true, ..Opener::default() });
    let mut worker = start_worker_with(worker::Config::new(coordinator.url()), &settings, opener);
    let error = worker.ended().await.unwrap_err().to_string();
    assert!(error.contains("scene other") && error.contains("hash"), "{error}");
    drop(start_coordinator(quick()));
}
