//! The load generator and bursts, against a server that stalls, rejects or supersedes.

use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

use crate::fake::{Fake, frame, view};
use argus_client::load::Ended;
use argus_client::load::{self, LoadOptions, Mode};
use argus_client::{ClientError, Encoding, RenderOptions};
use argus_scene::{Camera, PlanRequest};
use glam::DVec3;

fn options() -> LoadOptions {
    LoadOptions {
        clients: 4,
        duration: Duration::from_millis(1000),
        rate: 20.0,
        size: [16, 12],
        deadline: Duration::from_secs(5),
        ..LoadOptions::default()
    }
}

#[tokio::test]
async fn a_load_sends_its_whole_schedule_and_counts_every_view() {
    let server = Fake::default().serve().await;
    let report = load::run(&server.client().await, &options()).await.unwrap();
    assert_eq!((report.sent, report.answered, report.failed), (80, 80, 0), "{report:?}");
    assert!(report.latency_ms.max < 500.0, "{report:?}");
    assert!(report.views_per_sec > 60.0 && report.views_per_sec <= 80.0, "{report:?}");
    let json = serde_json::to_value(&report).unwrap();
    for key in ["sent", "answered", "failed", "rejected", "superseded", "views_per_sec"] {
        assert!(json[key].is_number(), "{key}");
    }
    for key in ["p50", "p90", "p99", "max"] {
        assert!(json["latency_ms"][key].is_number(), "{key}");
    }
}

#[tokio::test]
async fn a_stall_delays_every_view_that_was_due_during_it() {
    let stall = (Duration::from_millis(200), Duration::from_millis(800));
    let server = Fake { stall: Some(stall), ..Fake::default() }.serve().await;
    let report = load::run(&server.client().await, &options()).await.unwrap();
    // A closed loop would have counted one slow view per client and sent 32 views instead of 80.
    assert_eq!((report.sent, report.answered), (80, 80));
    assert!(report.latency_ms.max >= 550.0, "{report:?}");
    assert!(report.latency_ms.p90 >= 400.0, "{report:?}");
    assert!(report.latency_ms.p50 >= 20.0, "more than half were due during the stall: {report:?}");
}

#[tokio::test]
async fn rejections_and_failures_are_counted_apart() {
    let server = Fake { overloaded: true, ..Fake::default() }.serve().await;
    let report = load::run(&server.client().await, &options()).await.unwrap();
    assert_eq!((report.sent, report.rejected, report.answered, report.failed), (80, 80, 0, 0));
    assert_eq!(report.latency_ms.max, 0.0);

    let server = Fake { unavailable: AtomicU32::new(u32::MAX), ..Fake::default() }.serve().await;
    let short = LoadOptions { deadline: Duration::from_millis(100), ..options() };
    let report = load::run(&server.client().await, &short).await.unwrap();
    assert_eq!((report.sent, report.failed, report.rejected), (80, 80, 0));
    assert!(report.first_error.unwrap().contains("no compositor yet"));
}

#[tokio::test]
async fn sessions_under_load_supersede_cameras_and_lose_none() {
    let fake =
        Fake { frame_time: Duration::from_millis(120), end_sessions: AtomicU32::new(1), ..Fake::default() };
    let server = fake.serve().await;
    let sessions = LoadOptions { mode: Mode::Sessions, ..options() };
    let report = load::run(&server.client().await, &sessions).await.unwrap();
    assert_eq!((report.sent, report.failed, report.rejected), (80, 0, 0), "{report:?}");
    assert_eq!(report.answered + report.superseded, 80, "{report:?}");
    assert!(report.answered >= 4 && report.superseded >= 20, "{report:?}");
}

#[tokio::test]
async fn sessions_without_answers_lose_exactly_their_newest_camera() {
    let server = Fake { frame_time: Duration::from_secs(60), ..Fake::default() }.serve().await;
    let sessions = LoadOptions { mode: Mode::Sessions, deadline: Duration::from_millis(300), ..options() };
    let report = load::run(&server.client().await, &sessions).await.unwrap();
    assert_eq!((report.sent, report.answered, report.failed), (80, 0, 4), "{report:?}");
    assert_eq!(report.superseded, 76, "{report:?}");
}

/// A camera that encodes the client and the time.
fn telling(client: u32, secs: f64) -> Camera {
    Camera::look_at(DVec3::new(1.0 + f64::from(client), secs, 20.0), DVec3::ZERO)
}

async fn endings(fake: Fake, options: &LoadOptions) -> (load::LoadReport, Vec<Ended>) {
    let server = fake.serve().await;
    let mut endings = Vec::new();
    let client = server.client().await;
    let report = load::run_along(&client, options, Arc::new(telling), |ended| endings.push(ended));
    (report.await.unwrap(), endings)
}

#[tokio::test]
async fn every_view_of_a_load_is_reported_once_with_its_camera_and_times() {
    let stall = Some((Duration::from_millis(200), Duration::from_millis(400)));
    let (report, mut endings) = endings(Fake { stall, ..Fake::default() }, &options()).await;
    assert_eq!((report.answered, endings.len()), (80, 80));
    endings.sort_by_key(|ended| (ended.client, ended.index));
    for (i, ended) in endings.iter().enumerate() {
        assert_eq!((u64::from(ended.client), ended.index), (i as u64 / 20, i as u64 % 20));
        assert_eq!(ended.view.camera, telling(ended.client, ended.index as f64 / 20.0));
        assert_eq!(*ended.outcome.as_ref().unwrap(), frame(&ended.view));
        assert!(ended.at >= ended.due, "{ended:?}");
    }
    let slowest = endings.iter().map(|ended| ended.at - ended.due).max().unwrap().as_secs_f64() * 1e3;
    assert!((slowest - report.latency_ms.max).abs() <= 0.01 * slowest, "{slowest} {report:?}");
}

#[tokio::test]
async fn failed_views_are_reported_with_their_error() {
    let (report, endings) = endings(Fake { overloaded: true, ..Fake::default() }, &options()).await;
    assert_eq!((report.rejected, endings.len()), (80, 80));
    assert!(endings.iter().all(|e| matches!(e.outcome, Err(ClientError::Overloaded { .. }))), "{endings:?}");
}

#[tokio::test]
async fn answered_and_failed_session_cameras_are_reported() {
    let sessions = LoadOptions { mode: Mode::Sessions, ..options() };
    let slow = Fake { frame_time: Duration::from_millis(120), ..Fake::default() };
    let (report, answered) = endings(slow, &sessions).await;
    assert_eq!(answered.len() as u64, report.answered, "{report:?}");
    for ended in &answered {
        assert_eq!(ended.view.camera, telling(ended.client, ended.index as f64 / 20.0));
        assert_eq!(*ended.outcome.as_ref().unwrap(), frame(&ended.view));
    }
    let never = Fake { frame_time: Duration::from_secs(60), ..Fake::default() };
    let impatient = LoadOptions { deadline: Duration::from_millis(300), ..sessions };
    let (report, failed) = endings(never, &impatient).await;
    assert_eq!((report.failed, failed.len()), (4, 4), "{report:?}");
    assert!(failed.iter().all(|ended| ended.index == 19 && ended.outcome.is_err()), "{failed:?}");
}

#[tokio::test]
async fn invalid_load_options_are_rejected_by_name() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    let field = async |options: LoadOptions| match load::run(&client, &options).await.unwrap_err() {
        ClientError::Invalid { field, .. } => field,
        other => panic!("{other:?}"),
    };
    assert_eq!(field(LoadOptions { clients: 0, ..options() }).await, "clients");
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(field(LoadOptions { rate, ..options() }).await, "rate");
    }
    assert_eq!(field(LoadOptions { size: [0, 10], ..options() }).await, "width");
}

#[tokio::test]
async fn a_burst_returns_every_frame_at_its_index() {
    let server = Fake { unavailable: AtomicU32::new(3), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let views: Vec<_> = (0..40).map(|i| view(f64::from(i % 12) + 1.0)).collect();
    let mut came = vec![None; views.len()];
    let report = load::burst(&client, views.clone(), 8, &RenderOptions::default(), |i, answer| {
        came[i] = Some(answer.frame);
    })
    .await;
    assert_eq!((report.views, report.failed), (40, 0), "{report:?}");
    assert!(report.total_ms > 0.0 && report.views_per_sec > 0.0);
    for (view, came) in views.iter().zip(came) {
        assert_eq!(came.unwrap(), frame(view));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_cost_of_the_wire_for_290_views_is_printed() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    let plan = PlanRequest::default();
    let views = load::path_views(client.description(), 290, [200, 150], plan);
    assert_eq!(views, load::path_views(client.description(), 290, [200, 150], plan));
    for encoding in [Encoding::Raw, Encoding::Zstd] {
        let options = RenderOptions { encoding, ..RenderOptions::default() };
        let report = load::burst(&client, views.clone(), 16, &options, |_, _| ()).await;
        assert_eq!(report.failed, 0, "{report:?}");
        println!("290 empty views of 200×150, {encoding:?}: {:.1} ms", report.total_ms);
    }
}
