//! Batches over gRPC: every camera is answered by one plan, and failures are independent.

use std::collections::BTreeMap;

use argus_client::{Batch, Client, ClientError, Encoding};
use argus_proto::v1;
use argus_scene::{Frame, FrameDigest, Output, Outputs, Plan, PlanRequest, View};
use futures::StreamExt;

use crate::common::{Cluster, direct, quick, view};

/// A batch of the test's viewpoints.
fn batch(count: usize, plan: PlanRequest) -> Batch {
    let cameras = (0..count).map(|i| view(i).camera).collect();
    Batch { cameras, width: 32, height: 24, outputs: Outputs::COLOR, plan }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_batch_answers_every_camera_once_with_the_bytes_of_a_single_view() {
    let mut config = quick();
    // A limit below the batch's size: its views wait instead of being refused.
    config.core.max_views_per_client = 4;
    let cluster = Cluster::start_with(config, 2).await;
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    let frames: Vec<_> =
        client.render_batch(batch(40, PlanRequest::default()), Encoding::Unspecified).collect().await;
    assert_eq!(frames.len(), 40);
    let frames: BTreeMap<usize, _> = frames.into_iter().collect();
    assert!(frames.keys().copied().eq(0..40));
    for (index, result) in &frames {
        let (frame, _) = result.as_ref().unwrap();
        assert_eq!(frame.provenance.plan, Plan::direct(1), "one plan for all");
        if index % 8 == 0 {
            let (alone, _) = cluster.render(&direct(*index)).await.unwrap();
            assert_eq!(frame.images[Output::Color], alone.images[Output::Color], "camera {index}");
        }
    }
    let samples = client.render_batch(batch(3, PlanRequest::from_samples()), Encoding::Raw);
    let warped = samples.filter(|(_, result)| {
        let plan = result.as_ref().map(|(frame, _)| frame.provenance.plan.clone());
        std::future::ready(matches!(plan, Ok(Plan::Warp(_))))
    });
    assert_eq!(warped.count().await, 3, "as it asks");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_invalid_camera_fails_alone_and_an_invalid_common_field_fails_the_batch() {
    let cluster = Cluster::start(1).await;
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    let mut wrong = batch(5, PlanRequest::default());
    wrong.cameras[2].fov_deg = f64::NAN;
    let mut failed = Vec::new();
    let mut frames = std::pin::pin!(client.render_batch(wrong, Encoding::Unspecified));
    while let Some((index, result)) = frames.next().await {
        if let Err(error) = result {
            assert!(matches!(error, ClientError::Invalid { .. }), "{error}");
            failed.push(index);
        }
    }
    assert_eq!(failed, [2]);
    let flat = Batch { height: 0, ..batch(3, PlanRequest::default()) };
    let results: Vec<_> = client.render_batch(flat, Encoding::Unspecified).collect().await;
    assert_eq!(results.len(), 3);
    assert!(results.iter().all(|(_, result)| matches!(result, Err(ClientError::Invalid { .. }))));
    let none = client.render_batch(batch(0, PlanRequest::default()), Encoding::Unspecified);
    assert_eq!(none.count().await, 0);
    // The wire itself, without the client's checks.
    for cameras in [Vec::new(), vec![v1::Camera::default(); 5000]] {
        let request =
            v1::RenderBatchRequest { cameras, width: 8, height: 8, outputs: vec![1], ..Default::default() };
        let status = cluster.views().render_batch(request).await.unwrap_err();
        assert_eq!(status.code(), tonic::Code::InvalidArgument);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_killed_worker_costs_a_batch_no_frame() {
    let mut cluster = Cluster::start(2).await;
    cluster.settings.set(0, 20_000);
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    let mut frames =
        std::pin::pin!(client.render_batch(batch(30, PlanRequest::default()), Encoding::Unspecified));
    let mut answered = 0;
    while let Some((index, result)) = frames.next().await {
        result.unwrap_or_else(|error| panic!("camera {index}: {error}"));
        answered += 1;
        if answered == 3 {
            cluster.workers[0].kill();
        }
    }
    assert_eq!(answered, 30);
}

/// Digests of single direct views of the batch's cameras, each pinned to the provenance of the batch's frame.
async fn repeated(cluster: &Cluster, frames: &BTreeMap<usize, Frame>) -> BTreeMap<usize, FrameDigest> {
    let mut found = BTreeMap::new();
    for (index, frame) in frames {
        let pinned = View {
            width: 32,
            height: 24,
            outputs: all(),
            plan: PlanRequest::default(),
            pin: Some(frame.provenance.clone()),
            ..view(*index)
        };
        found.insert(*index, cluster.render(&pinned).await.unwrap().0.images.digest());
    }
    found
}

/// Outputs of triangles and of samples.
fn all() -> Outputs {
    Outputs::COLOR.with(Output::Range).with(Output::Depth).with(Output::Instance).with(Output::Radiance)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn frames_of_a_batch_equal_pinned_single_views_under_load_while_a_worker_dies() {
    let mut cluster = Cluster::start(3).await;
    cluster.settings.set(0, 10_000);
    let client = Client::connect(&cluster.coordinator.url()).await.unwrap();
    for plan in [PlanRequest::default(), PlanRequest::from_samples()] {
        // Others ask for as much meanwhile.
        let others = (0..24).map(|i| {
            let (channel, view) = (cluster.views(), if i % 2 == 0 { direct(i) } else { view(i) });
            tokio::spawn(async move { crate::common::render(channel, &view, 0).await })
        });
        let others: Vec<_> = others.collect();
        let asked = Batch { outputs: all(), ..batch(24, plan) };
        let mut frames = BTreeMap::new();
        let mut answers = std::pin::pin!(client.render_batch(asked, Encoding::Unspecified));
        while let Some((index, result)) = answers.next().await {
            let (frame, meta) = result.unwrap_or_else(|error| panic!("camera {index}: {error}"));
            assert_eq!(meta.digest, frame.images.digest());
            frames.insert(index, frame);
            if frames.len() == 4 {
                cluster.workers.pop().unwrap().kill();
            }
        }
        for other in others {
            other.await.unwrap().unwrap();
        }
        assert_eq!(frames.len(), 24);
        let digests = frames.iter().map(|(index, frame)| (*index, frame.images.digest())).collect();
        assert_eq!(repeated(&cluster, &frames).await, digests);
    }
}
