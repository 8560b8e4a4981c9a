//! Views through a real cluster: all are answered, with the same bytes from any worker.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use argus_proto::v1;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::frame::{Decision, Reason};
use argus_scene::{Frame, Output, Outputs, Plan, View};
use futures::future::join_all;
use futures::stream::{FuturesUnordered, StreamExt};

use crate::common;
use crate::common::roles::Done;
use crate::common::{Cluster, answer_to, channel, direct, pinned, render, request, view};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_of_two_clients_share_samples_that_are_rendered_once() {
    let cluster = Cluster::start(3).await;
    cluster.settings.set(3000, 0);
    let frames = join_all((0..60).map(|i| {
        let cluster = &cluster;
        async move { cluster.render(&view(i)).await.unwrap() }
    }))
    .await;
    let workers: BTreeSet<&str> = frames.iter().map(|(_, meta)| meta.worker.as_str()).collect();
    assert_eq!(workers.len(), 2, "two compositors, and the sampler is none");
    for (frame, meta) in &frames {
        assert_eq!(meta.view_id, "a view");
        assert!(meta.age_ms > 0.0);
        let stages: Vec<&str> = frame.stages.iter().map(|stage| stage.name.as_str()).collect();
        assert_eq!(stages, ["samples", "queue", "render", "encode", "relay"]);
        assert_eq!(frame.provenance.device, common::roles::DEVICE);
    }
    assert!(cluster.settings.largest_batch.load(Ordering::SeqCst) > 4, "what waits is one batch");
    assert_eq!(cluster.settings.samples_rendered.load(Ordering::SeqCst), 4, "one tile, four corners, once");
    assert_eq!(cluster.settings.samples_read_back.load(Ordering::SeqCst), 4, "others need them");
    let status = cluster.wait_for(|s| s.workers.iter().any(|w| w.views_composed > 0)).await;
    assert_eq!(status.counters.unwrap().views_answered, 60);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_process_and_a_cluster_make_the_same_bytes() {
    let alone = Cluster::start(1).await;
    let many = Cluster::start(3).await;
    let outputs = Outputs::COLOR.with(Output::Range).with(Output::Mask).with(Output::Source);
    for i in 0..8 {
        let wanted = View { outputs, ..view(i) };
        let (frame, _) = alone.render(&wanted).await.unwrap();
        let again = View { outputs, ..pinned(i, frame.provenance.clone()) };
        let (same, _) = many.render(&again).await.unwrap();
        assert_eq!(same.provenance, frame.provenance);
        assert_eq!(
            (&same.images[Output::Color], &same.images[Output::Range]),
            (&frame.images[Output::Color], &frame.images[Output::Range])
        );
        assert_eq!(
            (&same.images[Output::Mask], &same.images[Output::Source]),
            (&frame.images[Output::Mask], &frame.images[Output::Source])
        );
    }
    assert_eq!(
        alone.settings.samples_read_back.load(Ordering::SeqCst),
        0,
        "alone, samples stay on the device"
    );
    let (frame, _) = alone.render(&direct(3)).await.unwrap();
    assert_eq!(frame.provenance.plan, Plan::direct(1));
    let (same, _) = many.render(&pinned(3, frame.provenance.clone())).await.unwrap();
    assert_eq!(same.images[Output::Color], frame.images[Output::Color]);
    let only_range = View { outputs: Outputs::only(Output::Range), ..view(1) };
    assert!(many.render(&only_range).await.unwrap().0.images[Output::Color].is_none());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_are_composed_between_slices_of_background_samples() {
    let cluster = Cluster::start(1).await;
    cluster.render(&view(0)).await.unwrap();
    // A refinement that views need takes more than a second.
    cluster.settings.sample_parts.store(30, Ordering::SeqCst);
    cluster.settings.sample_us.store(50_000, Ordering::SeqCst);
    cluster.settings.unresolved_percent.store(20, Ordering::SeqCst);
    let (began, mut longest) = (Instant::now(), Duration::ZERO);
    let ahead = || cluster.settings.samples_ahead.load(Ordering::SeqCst);
    let mut lost = false;
    for i in 0.. {
        assert!(began.elapsed() < Duration::from_secs(60), "{} refinements only", ahead());
        let (asked, already) = (Instant::now(), ahead());
        cluster.render(&view(i % 16)).await.unwrap();
        match already {
            0 | 1 => longest = longest.max(asked.elapsed()),
            // The device is lost between two slices: the sample is restarted, and views are answered from new
            // samples.
            2 if !lost => {
                cluster.settings.lose_device.store(1, Ordering::SeqCst);
                lost = true;
            }
            2 => {}
            _ => break,
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(longest < Duration::from_secs(1), "a view waited {longest:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_waiting_view_is_composed_between_two_slices_of_an_upload() {
    let cluster = Cluster::start(1).await;
    cluster.priced().await;
    cluster.render(&view(0)).await.unwrap();
    // Each refinement that views need takes a second and a half to upload.
    cluster.settings.hold_slices.store(30, Ordering::SeqCst);
    cluster.settings.hold_us.store(50_000, Ordering::SeqCst);
    cluster.settings.unresolved_percent.store(20, Ordering::SeqCst);
    let began = Instant::now();
    // Whether one of these was done between two slices of one sample.
    let between = |kind: Done| {
        let done = cluster.settings.done.lock();
        done.windows(3).any(|three| match three {
            [Done::Slice(before, i), one, Done::Slice(after, j)] => {
                before == after && i + 1 == *j && *one == kind
            }
            _ => false,
        })
    };
    let mut longest = Duration::ZERO;
    for i in 0.. {
        if between(Done::Warped) && between(Done::Direct) {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{:?}", cluster.settings.done.lock());
        for wanted in [view(i % 16), direct(i % 16)] {
            let asked = Instant::now();
            cluster.render(&wanted).await.unwrap();
            longest = longest.max(asked.elapsed());
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(longest < Duration::from_secs(1), "a view waited {longest:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_from_insufficient_samples_is_replaced_by_one_from_triangles() {
    let cluster = Cluster::start(1).await;
    let (warped, _) = cluster.render(&view(1)).await.unwrap();
    let (from_triangles, _) = cluster.render(&direct(1)).await.unwrap();
    // An order as the planner makes it.
    let decision = Decision { reason: Reason::Soonest, wait_ms: 0.0, render_ms: 1.0, excess: 0.01 };
    let order = v1::ViewOrder {
        term: cluster.status().await.term,
        plan: Some((&warped.provenance.plan).into()),
        decision: Some(decision.into()),
        fallback: Some(v1::Fallback { plan: Some((&Plan::direct(1)).into()), max_uncovered: 0.03 }),
        ..v1::ViewOrder::default()
    };
    let ordered = async || {
        let request = v1::RenderRequest { order: Some(order.clone()), ..request(&view(1), 0) };
        answer_to(ViewsClient::new(channel(&cluster.workers[0].url())), request).await.unwrap().0
    };
    let reason = |frame: &Frame| frame.decision.map(|decision| decision.reason);
    let good = ordered().await;
    assert_eq!(
        (reason(&good), &good.images[Output::Color]),
        (Some(Reason::Soonest), &warped.images[Output::Color])
    );
    assert!(
        good.images[Output::Range].is_none() && good.images[Output::Source].is_none(),
        "what it is judged by was not asked for"
    );
    cluster.settings.unresolved_percent.store(6, Ordering::SeqCst);
    let with_holes = ordered().await;
    assert_eq!(
        (reason(&with_holes), &with_holes.images[Output::Color]),
        (Some(Reason::FrameFellShort), &from_triangles.images[Output::Color])
    );
    assert_eq!(with_holes.provenance.plan, Plan::direct(1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_of_many_chunks_arrives_whole() {
    let cluster = Cluster::start(2).await;
    let large = View { width: 2048, height: 1024, ..view(1) };
    let (frame, _) = cluster.render(&large).await.unwrap();
    assert_eq!(frame.images[Output::Color].clone().unwrap().len(), 2048 * 1024 * 3);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn roles_follow_demand_and_every_view_is_answered() {
    let cluster = Cluster::start(3).await;
    cluster.settings.set(2000, 10_000);
    let client = cluster.views();
    // Sends views and direct views every 100 ms until the roles are as expected.
    let press = async |views: usize, directs: usize, wanted: (u32, u32)| {
        let one = |view: View| {
            let client = client.clone();
            async move { render(client, &view, 0).await.unwrap() }
        };
        let mut work: FuturesUnordered<_> = (0..views).map(view).map(one).collect();
        let mut tick = tokio::time::interval(Duration::from_millis(100));
        let began = tokio::time::Instant::now();
        loop {
            tokio::select! {
                Some(_answered) = work.next() => {}
                _ = tick.tick() => {
                    let status = cluster.status().await;
                    if (status.samplers, status.compositors) == wanted {
                        break;
                    }
                    assert!(began.elapsed() < common::LIMIT, "{wanted:?} was never reached: {status:#?}");
                    let asked = (0..views).map(view).chain((0..directs).map(direct));
                    work.extend(asked.map(one));
                }
            }
        }
        while work.next().await.is_some() {}
    };
    press(30, 0, (1, 2)).await;
    press(10, 16, (2, 1)).await;
    press(40, 2, (1, 2)).await;
    press(0, 8, (3, 0)).await;
    press(30, 0, (1, 2)).await;
    let counters = cluster.status().await.counters.unwrap();
    assert!(counters.roles_changed >= 4, "{counters:?}");
    assert_eq!((counters.views_failed, counters.views_rejected, counters.views_retried), (0, 0, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn status_reports_measurements() {
    let cluster = Cluster::start(3).await;
    cluster.settings.set(5000, 20_000);
    cluster.settings.sample_us.store(30_000, Ordering::SeqCst);
    for i in 0..40 {
        cluster.render(&view(i)).await.unwrap();
        if i % 4 == 0 {
            cluster.render(&direct(i)).await.unwrap();
        }
    }
    let status = cluster.wait_for(|s| s.view_ms > 0.0 && s.sample_ms > 0.0 && s.direct_ms > 0.0).await;
    // A sleep of 5 ms takes up to half as long again on a busy machine, and never less.
    assert!(status.view_ms >= 5.0 && status.view_ms < 40.0, "{}", status.view_ms);
    assert!(status.direct_ms >= 20.0 && status.direct_ms < 100.0, "{}", status.direct_ms);
    assert!(status.sample_ms >= 30.0 && status.sample_ms < 120.0, "{}", status.sample_ms);
    assert!(status.views_per_tick > 0.0 && status.tick_predicted_ms > 0.0 && status.tick_measured_ms > 0.0);
    assert_eq!(status.scene.unwrap().name, "test");
    assert_eq!((status.version, status.epoch), (0, 0));
    for worker in &status.workers {
        assert!(worker.pid == std::process::id() && !worker.id.is_empty());
        assert!([v1::Role::Sampler, v1::Role::Compositor].contains(&worker.role()));
        assert!(cluster.workers.iter().any(|w| w.url() == worker.address));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thousand_views_at_once_on_one_connection_are_all_answered() {
    // With adaptive windows, h2 takes this many requests for an attack and ends the connection.
    let cluster = Cluster::start(3).await;
    let frames = join_all((0..1000).map(|i| {
        let cluster = &cluster;
        async move { cluster.render(&view(i)).await }
    }))
    .await;
    for frame in frames {
        frame.unwrap();
    }
}
