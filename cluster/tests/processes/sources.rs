//! Sources: ordered, rendered between views, reported, and sent from worker to worker.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use argus_cluster::worker;
use argus_proto::v1;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::{Frame, FrameSource, Output, Plan, SceneState, View, Warp};

use crate::common::leader::Leader;
use crate::common::roles::Settings;
use crate::common::{Opener, Worker, answer_to, channel, direct, request, start_worker_with, view};

fn started(leader: &Leader, name: &str, settings: &Arc<Settings>) -> Worker {
    let config = worker::Config { id: Some(name.to_owned()), ..worker::Config::new(leader.url()) };
    start_worker_with(config, settings, Arc::new(Opener::default()))
}

fn source(i: usize) -> FrameSource {
    let View { camera, width, height, .. } = view(i);
    FrameSource {
        camera,
        width: 2 * width,
        height: 2 * height,
        samples_per_pixel: 4,
        band_rows: 0,
        light: None,
    }
}

fn purchase(i: usize) -> v1::Purchase {
    v1::Purchase { source: Some((&source(i)).into()), state: Some(SceneState::default().into()) }
}

/// Has workers render a source, and returns it as the worker that rendered it first reports it.
async fn bought(leader: &Leader, i: usize) -> v1::HeldSource {
    leader.assign(|assignment| assignment.purchases = vec![purchase(i)]);
    let held = leader.report(|_, measured| measured.sources.as_ref()?.added.first().cloned()).await;
    leader.assign(|assignment| assignment.purchases.clear());
    assert!(held.bought && held.render_ms > 0.0 && held.ranges.len() == 108);
    held
}

/// A view that is warped from a source at a worker; from triangles if nobody has it.
async fn warped(worker: &Worker, held: &v1::HeldSource, holders: Vec<String>) -> Frame {
    let frames = vec![FrameSource::try_from(held.source.unwrap()).unwrap()];
    let plan = Plan::Warp(Warp { frames, ..Warp::default() });
    let fallback = v1::Fallback { plan: Some((&Plan::direct(1)).into()), max_uncovered: 1.0 };
    let order = v1::ViewOrder {
        term: 1,
        state: held.state,
        plan: Some((&plan).into()),
        sources: vec![v1::SampleSource { id: held.id, addresses: holders, ..v1::SampleSource::default() }],
        fallback: Some(fallback),
        ..v1::ViewOrder::default()
    };
    let request = v1::RenderRequest { order: Some(order), ..request(&view(1), 0) };
    answer_to(ViewsClient::new(channel(&worker.url())), request).await.unwrap().0
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_are_answered_between_the_slices_of_a_source() {
    let (leader, settings) = (Leader::start().await, Arc::new(Settings::default()));
    let worker = started(&leader, "one", &settings);
    leader.report(|_, measured| measured.direct_cost.map(drop)).await;
    // 50 slices of 20 ms.
    settings.sample_us.store(20_000, Ordering::SeqCst);
    settings.sample_parts.store(50, Ordering::SeqCst);
    leader.assign(|assignment| assignment.purchases = vec![purchase(1)]);
    let client = ViewsClient::new(channel(&worker.url()));
    let (began, mut answered, mut longest) = (Instant::now(), 0, Duration::ZERO);
    let held = leader.report(|_, measured| measured.sources.as_ref()?.added.first().cloned());
    tokio::pin!(held);
    let held = loop {
        let asked = Instant::now();
        let order = v1::ViewOrder {
            term: 1,
            state: Some(SceneState::default().into()),
            plan: Some((&Plan::direct(1)).into()),
            ..v1::ViewOrder::default()
        };
        let request = v1::RenderRequest { order: Some(order), ..request(&direct(answered), 0) };
        tokio::select! {
            held = &mut held => break held,
            frame = answer_to(client.clone(), request) => {
                frame.unwrap();
                (answered, longest) = (answered + 1, longest.max(asked.elapsed()));
            }
        }
    };
    assert!(began.elapsed() > Duration::from_millis(900), "it has 50 slices");
    assert!(answered > 50, "{answered} views were answered meanwhile");
    assert!(
        longest < Duration::from_millis(500),
        "a view waits for a slice, not for the source: {longest:?}"
    );
    assert!(held.bought);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_renders_each_ordered_source_once_and_reports_all_when_it_joins_again() {
    let (leader, settings) = (Leader::start().await, Arc::new(Settings::default()));
    let _worker = started(&leader, "one", &settings);
    let whole = leader.report(|_, measured| measured.sources.clone()).await;
    assert!(whole.whole && whole.added.is_empty());
    let (first, second) = (bought(&leader, 1).await, bought(&leader, 2).await);
    assert_ne!(first.id, second.id);
    // They are held: nothing is rendered for the same order.
    leader.assign(|assignment| assignment.purchases = vec![purchase(2), purchase(1), purchase(3)]);
    let third = leader.report(|_, measured| measured.sources.clone()).await;
    assert_eq!((third.whole, third.added.len(), third.dropped.len()), (false, 1, 0));
    leader.step_down();
    let again = leader.report(|_, measured| measured.sources.clone()).await;
    let mut ids: Vec<_> = again.added.iter().map(|held| held.id.unwrap().camera).collect();
    ids.sort_unstable();
    let mut held: Vec<_> =
        [&first, &second, &third.added[0]].iter().map(|held| held.id.unwrap().camera).collect();
    held.sort_unstable();
    assert_eq!((again.whole, ids), (true, held));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_source_of_another_worker_is_fetched_and_gives_equal_bytes() {
    let (leader, settings) = (Leader::start().await, Arc::new(Settings::default()));
    let mut holder = started(&leader, "holder", &settings);
    let held = bought(&leader, 1).await;
    let other = started(&leader, "other", &settings);
    leader.report(|name, measured| (name == "other" && measured.applied > 0).then_some(())).await;
    let own = warped(&holder, &held, Vec::new()).await;
    assert_eq!(own.provenance.plan.frames().len(), 1, "it is warped from the source");
    let fetched = warped(&other, &held, vec![holder.url()]).await;
    assert_eq!(fetched.images[Output::Color], own.images[Output::Color]);
    let news = leader.report(|name, measured| measured.sources.clone().filter(|_| name == "other")).await;
    assert_eq!(
        news.added.iter().map(|added| (added.id, added.bought)).collect::<Vec<_>>(),
        [(held.id, false)]
    );
    assert_eq!(news.added[0].ranges, held.ranges);
    // Without its holder, it is still here; another one is not, and the view is rendered from triangles.
    let second = bought(&leader, 2).await;
    holder.kill();
    let still = warped(&other, &held, vec![holder.url()]).await;
    assert_eq!(still.images[Output::Color], own.images[Output::Color]);
    let third = started(&leader, "third", &settings);
    leader.report(|name, measured| (name == "third" && measured.applied > 0).then_some(())).await;
    let lost = warped(&third, &second, vec![holder.url()]).await;
    assert_eq!(lost.provenance.plan, Plan::direct(1));
}
