//! Sessions against a slow or breaking server.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use crate::fake::{Fake, frame, view};
use argus_client::{ClientError, RenderOptions, Session, SessionEvent, SessionOptions};
use argus_scene::Output;
use tokio::time::{sleep, timeout};

async fn next(session: &mut Session) -> SessionEvent {
    timeout(Duration::from_secs(10), session.next()).await.expect("an event within 10 s").unwrap()
}

#[tokio::test]
async fn the_newest_camera_wins_and_every_frame_is_acknowledged() {
    let server = Fake { frame_time: Duration::from_millis(30), ..Fake::default() }.serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    let mut seen = Vec::new();
    for i in 0..100 {
        session.send(&view(f64::from(i % 10) + 1.0));
        if let Ok(event) = timeout(Duration::from_millis(3), session.next()).await {
            let SessionEvent::Frame { camera_seq, .. } = event.unwrap() else { panic!("a frame expected") };
            seen.push(camera_seq);
        }
    }
    while !session.is_idle() {
        let SessionEvent::Frame { camera_seq, frame: came, .. } = next(&mut session).await else {
            panic!("a frame expected")
        };
        seen.push(camera_seq);
        assert_eq!(*came, frame(&view(((camera_seq - 1) % 10) as f64 + 1.0)), "the frame of its camera");
    }
    assert_eq!(seen.last(), Some(&100), "the newest camera is always answered");
    assert!(seen.is_sorted_by(|a, b| a < b), "{seen:?}");
    assert_eq!(session.superseded() + seen.len() as u64, 100, "each camera is answered or superseded");
    assert!(seen.len() < 50, "a slow server sends fewer frames: {}", seen.len());
    // The last acknowledgement may still be on its way.
    timeout(Duration::from_secs(5), async {
        while server.fake.acks.load(Ordering::SeqCst) < seen.len() as u64 {
            sleep(Duration::from_millis(5)).await;
        }
    })
    .await
    .expect("every frame is acknowledged");
    assert_eq!(server.fake.session_frames.load(Ordering::SeqCst), seen.len() as u64);
}

#[tokio::test]
async fn a_session_opens_even_if_every_wait_is_shorter_than_opening() {
    let server = Fake { opening: Duration::from_millis(200), ..Fake::default() }.serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    let begin = Instant::now();
    session.send(&view(1.0));
    while !session.is_idle() {
        assert!(begin.elapsed() < Duration::from_secs(10), "it never opens: {session:?}");
        if let Ok(event) = timeout(Duration::from_millis(5), session.next()).await {
            assert!(matches!(event, Ok(SessionEvent::Frame { .. })), "{event:?}");
        }
    }
}

#[tokio::test]
async fn broken_or_damaged_sessions_are_reopened_and_lose_no_newest_camera() {
    let fake = Fake { end_sessions: AtomicU32::new(2), truncate: AtomicU32::new(1), ..Fake::default() };
    let server = fake.serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    for i in 1..=5 {
        let camera_seq = session.send(&view(f64::from(i)));
        match next(&mut session).await {
            SessionEvent::Frame { camera_seq: answered, .. } => assert_eq!(answered, camera_seq),
            SessionEvent::Failed { error, .. } => panic!("{error}"),
        }
        assert!(session.is_idle());
    }
}

#[tokio::test]
async fn an_invalid_view_fails_alone() {
    let server = Fake::default().serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    let mut bad = view(1.0);
    bad.camera.target = bad.camera.eye;
    session.send(&bad);
    match next(&mut session).await {
        SessionEvent::Failed { camera_seq: 1, error: ClientError::Invalid { field, reason } } => {
            assert_eq!((field.as_str(), reason.as_str()), ("camera.target", "must differ from camera.eye"));
        }
        other => panic!("{other:?}"),
    }
    session.send(&view(1.0));
    assert!(matches!(next(&mut session).await, SessionEvent::Frame { camera_seq: 2, .. }));
}

#[tokio::test]
async fn a_session_of_a_lost_server_fails_when_patience_ends() {
    let server = Fake::default().serve().await;
    let patience = Duration::from_millis(300);
    let mut session = server.client().await.session(SessionOptions { patience, ..SessionOptions::default() });
    session.send(&view(1.0));
    next(&mut session).await;
    server.kill().await;
    session.send(&view(2.0));
    let outcome = timeout(Duration::from_secs(10), session.next()).await.expect("an end to patience");
    assert!(matches!(outcome.unwrap_err(), ClientError::Deadline { .. }));
}

#[tokio::test]
async fn redirected_frames_are_fetched_and_acknowledged_with_the_receipt() {
    let worker = Fake::default().serve().await;
    let server = Fake { redirect: Mutex::new(Some(worker.url())), ..Fake::default() }.serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    for i in 1..=3 {
        session.send(&view(f64::from(i)));
        let SessionEvent::Frame { frame: came, meta, .. } = next(&mut session).await else {
            panic!("a frame")
        };
        assert_eq!(came.images[Output::Color], frame(&view(f64::from(i))).images[Output::Color]);
        let detour = came.stages.iter().find(|stage| stage.name == "detour").expect("the way to the worker");
        assert!(detour.ms > 990.0, "{detour:?}");
        // The server said that the request was one second old; the redirect adds to it.
        assert!(meta.age_ms > 1000.0 && meta.age_ms < 5000.0, "{}", meta.age_ms);
    }
    timeout(Duration::from_secs(5), async {
        while server.fake.receipts.load(Ordering::SeqCst) < 3 {
            sleep(Duration::from_millis(5)).await;
        }
    })
    .await
    .expect("each receipt is brought back");
    assert_eq!(server.fake.session_frames.load(Ordering::SeqCst), 0, "nothing was relayed");
    // A client that turns redirection off gets its frames relayed.
    let options = SessionOptions { redirect: false, ..SessionOptions::default() };
    let mut session = server.client().await.session(options);
    session.send(&view(1.0));
    assert!(matches!(next(&mut session).await, SessionEvent::Frame { camera_seq: 1, .. }));
    assert_eq!(server.fake.session_frames.load(Ordering::SeqCst), 1);
}

#[tokio::test]
async fn a_frame_that_cannot_be_fetched_is_relayed() {
    // An unused port, an invalid address, and a server that breaks off in the middle of a frame.
    let broken = Fake { truncate: AtomicU32::new(1), ..Fake::default() }.serve().await;
    for redirect in ["http://127.0.0.1:9".to_owned(), "nowhere".to_owned(), broken.url()] {
        let server = Fake { redirect: Mutex::new(Some(redirect.clone())), ..Fake::default() }.serve().await;
        let mut session = server.client().await.session(SessionOptions::default());
        session.send(&view(1.0));
        match next(&mut session).await {
            SessionEvent::Frame { camera_seq: 1, frame: came, .. } => assert_eq!(*came, frame(&view(1.0))),
            other => panic!("{redirect}: {other:?}"),
        }
        assert_eq!(server.fake.session_frames.load(Ordering::SeqCst), 1, "{redirect}");
    }
}

#[tokio::test]
async fn a_hung_worker_is_given_up_within_three_seconds_and_its_frame_relayed() {
    // The server accepts the connection but never sends a message.
    let hung = Fake { frame_time: Duration::from_secs(60), ..Fake::default() }.serve().await;
    let server = Fake { redirect: Mutex::new(Some(hung.url())), ..Fake::default() }.serve().await;
    let mut session = server.client().await.session(SessionOptions::default());
    session.send(&view(1.0));
    let began = Instant::now();
    // Short waits of the application do not prolong the limit.
    let answer = loop {
        if let Ok(event) = timeout(Duration::from_millis(50), session.next()).await {
            break event.unwrap();
        }
    };
    assert!(matches!(answer, SessionEvent::Frame { camera_seq: 1, .. }), "{answer:?}");
    assert!(began.elapsed() < Duration::from_secs(3), "it took {:?}", began.elapsed());
    assert_eq!(server.fake.session_frames.load(Ordering::SeqCst), 1);
}

#[tokio::test]
async fn the_age_of_a_frame_includes_its_reception() {
    let dawdle = Duration::from_millis(250);
    let server = Fake { dawdle, ..Fake::default() }.serve().await;
    let client = server.client().await;
    let answer = client.render(&view(1.0), &RenderOptions::default()).await.unwrap();
    let mut session = client.session(SessionOptions::default());
    session.send(&view(2.0));
    let SessionEvent::Frame { meta, .. } = next(&mut session).await else { panic!("a frame") };
    // The header says 1.5 ms.
    for age_ms in [answer.meta.age_ms, meta.age_ms] {
        assert!((200.0..5000.0).contains(&age_ms), "{age_ms}");
    }
}
