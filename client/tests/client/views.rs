//! Connecting and single views, against a server that misbehaves.

use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::time::{Duration, Instant};

use crate::fake::{Fake, frame, lock, serve_at, view};
use argus_client::{Client, ClientError, RenderOptions};
use argus_proto::WireError;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

#[tokio::test]
async fn a_port_without_a_server_is_reported_at_once_in_one_line() {
    // A port that was free a moment ago.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    drop(listener);
    let begin = Instant::now();
    let error = Client::connect(&url).await.unwrap_err();
    assert!(begin.elapsed() < Duration::from_secs(2));
    let text = error.to_string();
    assert!(matches!(error, ClientError::Unreachable { .. }), "{error:?}");
    assert!(text.contains(&url) && text.contains("argus serve") && !text.contains('\n'), "{text}");
    assert!(text.contains("refused"), "{text}");
}

#[tokio::test]
async fn an_invalid_address_is_reported_with_an_example() {
    for url in ["127.0.0.1:7400", "localhost", "ftp://127.0.0.1", "http://", "", "not an url"] {
        let error = Client::connect(url).await.unwrap_err();
        assert!(matches!(error, ClientError::Address { .. }), "{url}: {error:?}");
        assert!(error.to_string().contains("http://127.0.0.1:7400"));
    }
}

#[tokio::test]
async fn a_server_that_is_not_argus_is_reported() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(async move {
        while let Ok((mut socket, _)) = listener.accept().await {
            let _ = socket.read(&mut [0; 64]).await;
            let _ = socket.write_all(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n").await;
        }
    });
    let error = Client::connect(&url).await.unwrap_err();
    let is_told = matches!(error, ClientError::NotArgus { .. } | ClientError::Unreachable { .. });
    assert!(is_told, "{error:?}");
}

#[tokio::test]
async fn a_server_of_another_version_is_rejected_with_both_numbers() {
    let server = Fake { version: Some(99), ..Fake::default() }.serve().await;
    let error = Client::connect(&server.url()).await.unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, ClientError::Version { theirs: 99, .. }), "{text}");
    let ours = format!("version {}", argus_proto::PROTOCOL_VERSION);
    assert!(text.contains("version 99") && text.contains(&ours), "{text}");
}

#[tokio::test]
async fn a_view_is_answered_with_its_frame_and_worker() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    assert_eq!(client.description().scene_name, "fake");
    assert_eq!(&client.describe().await.unwrap(), client.description());
    let options = RenderOptions { view_id: Some("mine".to_owned()), ..RenderOptions::default() };
    let answer = client.render(&view(3.0), &options).await.unwrap();
    assert_eq!(answer.frame, frame(&view(3.0)));
    assert_eq!((answer.meta.view_id.as_str(), answer.meta.worker.as_str()), ("mine", "fake"));
    assert_eq!(answer.attempts, 1);
}

#[tokio::test]
async fn an_unavailable_service_is_retried_under_the_same_view_id() {
    let server = Fake { unavailable: AtomicU32::new(2), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let answer = client.render(&view(1.0), &RenderOptions::default()).await.unwrap();
    assert_eq!(answer.attempts, 3);
    let ids = lock(&server.fake.view_ids).clone();
    assert!(ids.len() == 3 && ids.iter().all(|id| *id == ids[0] && !id.is_empty()), "{ids:?}");
    client.render(&view(1.0), &RenderOptions::default()).await.unwrap();
    assert_ne!(lock(&server.fake.view_ids)[3], ids[0], "another view has another id");
}

#[tokio::test]
async fn a_service_that_stays_unavailable_ends_with_the_deadline_and_its_reason() {
    let server = Fake { unavailable: AtomicU32::new(u32::MAX), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let deadline = Duration::from_millis(200);
    let error =
        client.render(&view(1.0), &RenderOptions { deadline, ..Default::default() }).await.unwrap_err();
    assert!(matches!(error, ClientError::Deadline { .. }), "{error:?}");
    assert!(error.to_string().contains("no compositor yet"), "{error}");
}

#[tokio::test]
async fn a_stalled_server_costs_no_more_than_the_deadline() {
    let server = Fake { frame_time: Duration::from_secs(60), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let deadline = Duration::from_millis(150);
    let begin = Instant::now();
    let error =
        client.render(&view(1.0), &RenderOptions { deadline, ..Default::default() }).await.unwrap_err();
    assert!(matches!(error, ClientError::Deadline { .. }), "{error:?}");
    assert!(begin.elapsed() >= deadline && begin.elapsed() < Duration::from_secs(5));
}

#[tokio::test]
async fn a_truncated_frame_is_retried_and_a_faulty_server_is_given_up() {
    let server = Fake { truncate: AtomicU32::new(1), ..Fake::default() }.serve().await;
    let answer = server.client().await.render(&view(2.0), &RenderOptions::default()).await.unwrap();
    assert_eq!((answer.attempts, answer.frame), (2, frame(&view(2.0))));

    let server = Fake { truncate: AtomicU32::new(u32::MAX), ..Fake::default() }.serve().await;
    let error = server.client().await.render(&view(2.0), &RenderOptions::default()).await.unwrap_err();
    assert!(matches!(error, ClientError::Damaged(WireError::Truncated { .. })), "{error:?}");
    assert_eq!(lock(&server.fake.view_ids).len(), 3);
}

#[tokio::test]
async fn invalid_views_and_overload_are_reported_without_a_retry() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    let mut bad = view(1.0);
    bad.camera.fov_deg = f64::NAN;
    match client.render(&bad, &RenderOptions::default()).await.unwrap_err() {
        ClientError::Invalid { field, .. } => assert_eq!(field, "camera.fov_deg"),
        other => panic!("{other:?}"),
    }
    let server = Fake { overloaded: true, ..Fake::default() }.serve().await;
    let impatient = RenderOptions { wait_for_room: false, ..RenderOptions::default() };
    match server.client().await.render(&view(1.0), &impatient).await.unwrap_err() {
        ClientError::Overloaded { retry_after, .. } => {
            assert_eq!(retry_after, Some(Duration::from_millis(100)));
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(lock(&server.fake.view_ids).len(), 1);
}

#[tokio::test]
async fn a_client_that_waits_for_capacity_retries_no_sooner_than_told() {
    let server = Fake { overloaded: true, ..Fake::default() }.serve().await;
    let client = server.client().await;
    let begin = Instant::now();
    let options = RenderOptions { deadline: Duration::from_millis(450), ..RenderOptions::default() };
    let error = client.render(&view(1.0), &options).await.unwrap_err();
    assert!(matches!(error, ClientError::Overloaded { .. }), "{error:?}");
    // The hint is 100 ms; up to 50% is added.
    let asked = lock(&server.fake.view_ids).len();
    assert!((2..=5).contains(&asked), "asked {asked} times in {:?}", begin.elapsed());
    // An attempt that began in time may end a little later; a further wait takes 100 ms at least.
    assert!(begin.elapsed() < Duration::from_millis(540), "it waited though no time was left to ask again");
}

#[tokio::test]
async fn a_killed_and_replaced_server_costs_latency_but_no_view() {
    let server = Fake { frame_time: Duration::from_millis(200), ..Fake::default() }.serve().await;
    let (client, address) = (server.client().await, server.address);
    let rendering = tokio::spawn({
        let client = client.clone();
        async move { client.render(&view(4.0), &RenderOptions::default()).await }
    });
    tokio::time::sleep(Duration::from_millis(50)).await;
    let first = Arc::clone(&server.fake);
    server.kill().await;
    let again = serve_at(Arc::new(Fake::default()), address).await;
    let answer = rendering.await.unwrap().unwrap();
    assert_eq!(answer.frame, frame(&view(4.0)));
    assert!(answer.attempts > 1);
    let ids = |fake: &Fake| lock(&fake.view_ids).clone();
    assert_eq!(ids(&first)[0], ids(&again.fake)[0]);
}

#[tokio::test]
async fn status_has_the_keys_that_scripts_rely_on() {
    let server = Fake::default().serve().await;
    let status = server.client().await.status().await.unwrap();
    assert_eq!((status.workers[0].role_name(), status.workers[1].role_name()), ("sampler", "unknown"));
    let json = serde_json::to_value(&status).unwrap();
    for key in [
        "processes",
        "samplers",
        "compositors",
        "samples_per_tick",
        "sample_ms",
        "views_per_tick",
        "view_ms",
        "tick_predicted_ms",
        "tick_measured_ms",
    ] {
        assert!(json[key].is_number(), "{key}");
    }
    for key in ["id", "pid", "role", "address"] {
        assert!(!json["workers"][0][key].is_null(), "{key}");
    }
    assert_eq!(json["workers"][0]["role"], "sampler");
    assert_eq!(json["workers"][1]["role"], "unknown");
    assert_eq!(json["scene"], "");
    assert_eq!(json["visibility"], "");
    assert_eq!(json["tick_measured_ms"], 0.0);
    assert_eq!(json["counters"]["views_answered"], 0);
    assert_eq!(json["refinements"]["usable"], 0);
}
