//! A number of views at once, as a whole: the cluster paper's measure.

use std::time::Instant;

use argus_proto::Description;
use argus_scene::{Outputs, PlanRequest, View};
use futures::StreamExt;
use serde::{Deserialize, Serialize};

use super::path::CameraPath;
use super::report::{Latencies, LatencyMs};
use crate::{Answer, Client, ClientError, RenderOptions};

/// What a burst took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BurstReport {
    /// Views asked for.
    pub views: u64,
    /// Views that ended in an error.
    pub failed: u64,
    /// From the first request to the last answer, milliseconds.
    pub total_ms: f64,
    /// Answered views by that time.
    pub views_per_sec: f64,
    /// Of each view, from its own request on.
    pub latency_ms: LatencyMs,
    /// The first failure, for its words.
    pub first_error: Option<String>,
}

/// Renders all `views`, at most `concurrency` at once, and hands each answer to `receive` with the view's
/// position in the list, in the order in which they arrive.
pub async fn burst(
    client: &Client,
    views: Vec<View>,
    concurrency: usize,
    options: &RenderOptions,
    mut receive: impl FnMut(usize, Answer),
) -> BurstReport {
    let total = views.len() as u64;
    let mut latencies = Latencies::new();
    let (mut failed, mut first_error) = (0, None);
    let begin = Instant::now();
    // A task each, so that answers are unpacked on all cores.
    let mut answers = futures::stream::iter(views.into_iter().enumerate())
        .map(|(i, view)| {
            // One id for all would make them one view.
            let (client, options) = (client.clone(), RenderOptions { view_id: None, ..options.clone() });
            let render = tokio::spawn(async move { client.render(&view, &options).await });
            async move { (i, render.await) }
        })
        .buffer_unordered(concurrency.max(1));
    let mut fail = |error: ClientError| {
        failed += 1;
        first_error.get_or_insert_with(|| error.to_string());
    };
    while let Some((i, outcome)) = answers.next().await {
        match outcome {
            Ok(Ok(answer)) => {
                latencies.record(answer.latency);
                receive(i, answer);
            }
            Ok(Err(error)) => fail(error),
            Err(error) => std::panic::resume_unwind(error.into_panic()),
        }
    }
    let elapsed = begin.elapsed().as_secs_f64();
    BurstReport {
        views: total,
        failed,
        total_ms: elapsed * 1e3,
        views_per_sec: if elapsed > 0.0 { (total - failed) as f64 / elapsed } else { 0.0 },
        latency_ms: latencies.ms(),
        first_error,
    }
}

/// The first view of each of `count` clients' paths: the same list for the same scene.
pub fn path_views(description: &Description, count: u32, size: [u32; 2], plan: PlanRequest) -> Vec<View> {
    let view = |index| View {
        camera: CameraPath::new(description, index).camera(0.0),
        width: size[0],
        height: size[1],
        outputs: Outputs::COLOR,
        plan,
        pin: None,
    };
    (0..count).map(view).collect()
}
