//! Batches: one request with many cameras, whose frames are sent as they are done.
//!
//! The plans of a batch are fixed when it is accepted, so that its frames can be repeated. A request that leaves the way open gets
//! frames from triangles in full: one plan for all, whatever the load is and what workers hold. A view that finds no room waits here,
//! and keeps its index in the batch.

use std::sync::Arc;

use argus_proto::status::{invalid, retry_after};
use argus_proto::trace::TARGET;
use argus_proto::v1;
use argus_proto::v1::render_batch_response::Body;
use argus_scene::{Camera, InvalidField, PlanRequest};
use futures::{Stream, StreamExt, stream};
use glam::DVec3;
use tokio::time::{Instant, sleep};
use tracing::{Span, debug_span};

use super::checks::{checked, checked_encoding, checked_view_id};
use super::drive::{Answer, answer};
use super::failure::failure;
use super::shared_core::SharedCore;
use super::view_request::ViewRequest;
use crate::core::Client;

/// Most cameras of a batch. More do not fit into a request of the usual size.
const MOST_CAMERAS: usize = 2048;

/// Most views of a batch that are in flight at once: enough for a large cluster, and few enough that their frames are
/// read in time.
const MOST_AT_ONCE: usize = 64;

/// A batch whose fields were checked, except its cameras. Wrong cameras fail one by one.
pub(super) struct Batch {
    client: Client,
    id: String,
    cameras: Vec<v1::Camera>,
    /// A view without its camera.
    view: v1::View,
    encoding: i32,
    /// Its tracing span in this process.
    span: Span,
}

impl Batch {
    /// # Errors
    /// The invalid field, if it concerns all views.
    pub(super) fn checked(
        shared: &SharedCore,
        client: Client,
        request: v1::RenderBatchRequest,
        span: Span,
    ) -> Result<Self, InvalidField> {
        let v1::RenderBatchRequest { batch_id, cameras, width, height, outputs, plan, encoding } = request;
        checked_view_id("batch_id", &batch_id)?;
        InvalidField::within("cameras", cameras.len(), 1..=MOST_CAMERAS)?;
        let plan = PlanRequest::try_from(plan.unwrap_or_default())?;
        let plan = fixed(plan);
        let view = v1::View {
            camera: None,
            width,
            height,
            outputs,
            plan: Some((&plan).into()),
            pin: None,
            flow_to: None,
            rays: Default::default(),
        };
        // Checks the other fields with a valid camera.
        let some = Camera::look_at(DVec3::ZERO, DVec3::X);
        checked(shared, Some(&v1::View { camera: Some((&some).into()), ..view.clone() }))?;
        let encoding = checked_encoding(encoding)?;
        Ok(Self { client, id: batch_id, cameras, view, encoding, span })
    }

    /// The request for the view of one camera.
    fn view_request(&self, shared: &SharedCore, index: usize) -> Result<ViewRequest, InvalidField> {
        let wire = v1::View { camera: self.cameras.get(index).cloned(), ..self.view.clone() };
        let view_id = format!("{}:{index}", self.id);
        Ok(ViewRequest {
            client: self.client.clone(),
            view: checked(shared, Some(&wire))?,
            wire,
            deadline: None,
            encoding: self.encoding,
            history: String::new(),
            arrived: Instant::now(),
            span: debug_span!(target: TARGET, parent: &self.span, "relay", view = view_id),
            view_id,
        })
    }
}

/// Fixes the plan of all views of a batch: triangles, where the request leaves the way open.
fn fixed(plan: PlanRequest) -> PlanRequest {
    PlanRequest { direct: plan.direct || plan.leaves_way_open(), ..plan }
}

/// The frames and failures of a batch, as they are done.
pub(super) fn answers(shared: Arc<SharedCore>, batch: Batch) -> impl Stream<Item = v1::RenderBatchResponse> {
    // Half of the client's limit of views in flight, so that its other requests are not refused.
    let at_once = (shared.read(|core| core.config().max_views_per_client) / 2).clamp(1, MOST_AT_ONCE);
    let batch = Arc::new(batch);
    let count = batch.cameras.len();
    let frame = move |index: usize| {
        let bodies = frame(shared.clone(), batch.clone(), index);
        let said = move |body| v1::RenderBatchResponse { index: index as u32, body: Some(body) };
        bodies.map(said).boxed()
    };
    stream::iter(0..count).map(frame).flatten_unordered(at_once)
}

/// The chunks of one camera's frame, or its failure.
fn frame(shared: Arc<SharedCore>, batch: Arc<Batch>, index: usize) -> impl Stream<Item = Body> {
    async_stream::stream! {
        loop {
            let request = match batch.view_request(&shared, index) {
                Ok(request) => request,
                Err(at) => {
                    yield Body::Failure(failure(&invalid(at)));
                    return;
                }
            };
            let (mut begun, mut room_after) = (false, None);
            for await answer in answer(shared.clone(), request, None) {
                match answer {
                    Ok(Answer::Chunk(chunk)) => {
                        begun = true;
                        yield Body::Chunk(chunk);
                    }
                    // Only sessions are redirected.
                    Ok(Answer::Redirect(_)) => {}
                    Err(status) => match retry_after(&status).filter(|_| !begun) {
                        Some(after) => room_after = Some(after),
                        None => yield Body::Failure(failure(&status)),
                    },
                }
            }
            let Some(after) = room_after else { return };
            sleep(after).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::Preset;

    use super::*;

    #[test]
    fn a_batch_that_leaves_the_way_open_is_rendered_from_triangles() {
        let open = PlanRequest { preset: Some(Preset::Interactive), ..PlanRequest::default() };
        assert!(fixed(open).direct && fixed(PlanRequest::default()).direct);
        let samples = PlanRequest::from_samples();
        assert_eq!(fixed(samples), samples);
    }
}
