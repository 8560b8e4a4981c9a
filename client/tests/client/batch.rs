//! Batches: missing frames are requested again, and every camera is reported once.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

use argus_client::{Batch, ClientError, Encoding};
use argus_scene::{Output, View};
use futures::StreamExt;

use crate::fake::{Fake, frame, view};

fn batch(count: usize) -> Batch {
    let View { width, height, outputs, plan, .. } = view(0.0);
    let cameras = (0..count).map(|i| view(i as f64 * 0.5).camera).collect();
    Batch { cameras, width, height, outputs, plan }
}

#[tokio::test]
async fn frames_missing_after_a_broken_stream_are_requested_again_and_arrive_once() {
    let server = Fake { unavailable: 1.into(), truncate: 2.into(), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let frames: Vec<_> = client.render_batch(batch(9), Encoding::Zstd).collect().await;
    assert_eq!(frames.len(), 9);
    let frames: BTreeMap<usize, _> = frames.into_iter().collect();
    for i in 0..9 {
        let (came, _) = frames[&i].as_ref().unwrap();
        assert_eq!(
            came.images[Output::Color],
            frame(&view(i as f64 * 0.5)).images[Output::Color],
            "camera {i}"
        );
    }
    assert_eq!(server.fake.unavailable.load(Ordering::SeqCst), 0);
    let requests = server.fake.view_ids.lock().unwrap().len();
    assert!((2..=3).contains(&requests), "{requests} requests");
}

#[tokio::test]
async fn frames_that_fail_since_workers_were_lost_are_requested_again() {
    let server = Fake { lost: 5.into(), ..Fake::default() }.serve().await;
    let client = server.client().await;
    let frames: Vec<_> = client.render_batch(batch(3), Encoding::Zstd).collect().await;
    let mut came: Vec<usize> = frames.iter().filter(|(_, frame)| frame.is_ok()).map(|(i, _)| *i).collect();
    came.sort_unstable();
    assert_eq!((came, frames.len()), (vec![0, 1, 2], 3), "{frames:?}");
}

#[tokio::test]
async fn frames_that_fail_for_half_a_minute_are_reported() {
    let server = Fake { lost: u32::MAX.into(), ..Fake::default() }.serve().await;
    let client = server.client().await;
    tokio::time::pause();
    let frames: Vec<_> = client.render_batch(batch(2), Encoding::Zstd).collect().await;
    assert_eq!(frames.len(), 2);
    assert!(
        frames.iter().all(|(_, frame)| frame.as_ref().is_err_and(ClientError::is_transient)),
        "{frames:?}"
    );
}

#[tokio::test]
async fn a_lost_server_fails_every_remaining_camera() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    server.kill().await;
    tokio::time::pause();
    let results: Vec<_> = client.render_batch(batch(4), Encoding::Unspecified).collect().await;
    let mut failed: Vec<usize> =
        results.iter().filter(|(_, result)| result.is_err()).map(|(i, _)| *i).collect();
    failed.sort_unstable();
    assert_eq!(failed, [0, 1, 2, 3]);
}

#[tokio::test]
async fn a_field_that_is_invalid_for_all_cameras_is_not_retried() {
    let server = Fake::default().serve().await;
    let client = server.client().await;
    let results: Vec<_> =
        client.render_batch(Batch { width: 0, ..batch(2) }, Encoding::Unspecified).collect().await;
    assert!(results.iter().all(|(_, result)| matches!(result, Err(ClientError::Invalid { .. }))));
    assert_eq!((results.len(), server.fake.view_ids.lock().unwrap().len()), (2, 1));
}
