//! Bursts: many views at once, as in the cluster paper.

use std::time::{Duration, Instant};

use argus_proto::Description;
use argus_scene::{PlanRequest, View};
use futures::StreamExt;
use serde::{Deserialize, Serialize};

use super::path::CameraPath;
use super::report::{Latencies, LatencyMs};
use crate::{Answer, Client, ClientError, RenderOptions};

/// Views in flight at once: enough for full batches on every worker, few enough that none is rejected.
pub const IN_FLIGHT: usize = 128;

/// Render options with a deadline of ten minutes: the last view of a burst waits for all the rest.
pub fn patient() -> RenderOptions {
    RenderOptions { deadline: Duration::from_secs(600), ..RenderOptions::default() }
}

/// The result of a burst.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BurstReport {
    /// Views requested.
    pub views: u64,
    /// Views that ended in an error.
    pub failed: u64,
    /// Milliseconds from the first request to the last answer.
    pub total_ms: f64,
    /// Answered views per second of that time.
    pub views_per_sec: f64,
    /// Latency of each view from its own request.
    pub latency_ms: LatencyMs,
    /// The first failure's message.
    pub first_error: Option<String>,
}

/// Renders all `views`, at most `concurrency` at once. Calls `receive` with each view's index and answer as they arrive.
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
    // One task per view, so that answers are unpacked on all cores.
    let mut answers = futures::stream::iter(views.into_iter().enumerate())
        .map(|(i, view)| {
            // A shared id would make all of them the same view.
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

/// The first view of each of `count` clients' paths. Equal scenes give equal lists.
pub fn path_views(description: &Description, count: u32, size: [u32; 2], plan: PlanRequest) -> Vec<View> {
    let view = |index| View::new(CameraPath::new(description, index).camera(0.0), size, plan);
    (0..count).map(view).collect()
}
