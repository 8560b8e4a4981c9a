//! A batch: many cameras in one request, whose frames come as they are done.
//!
//! One plan is fixed for all of a batch's frames, so that they do not differ by how they were made. Where the request leaves
//! the way open, that is from triangles: cameras far apart share no samples, and a batch waits for its last frame, not for
//! its first. A view of a batch that finds no room at the moment waits for it here, and its place in the batch is kept.

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

/// Cameras of a batch, at most: more do not fit into a request of the usual size.
const MOST_CAMERAS: usize = 2048;

/// Views of a batch that are under way at once, at most: enough for a large cluster, and few enough to be read in time.
const MOST_AT_ONCE: usize = 64;

/// A batch that was checked but for its cameras, which fail one by one.
pub(super) struct Batch {
    client: Client,
    id: String,
    cameras: Vec<v1::Camera>,
    /// A view without its camera.
    view: v1::View,
    encoding: i32,
    /// Its way through this process.
    span: Span,
}

impl Batch {
    /// # Errors
    /// A field that is wrong for all of its views.
    pub(super) fn checked(
        shared: &SharedCore,
        client: Client,
        request: v1::RenderBatchRequest,
        span: Span,
    ) -> Result<Self, InvalidField> {
        let v1::RenderBatchRequest { batch_id, cameras, width, height, outputs, plan, encoding } = request;
        checked_view_id("batch_id", &batch_id)?;
        if !(1..=MOST_CAMERAS).contains(&cameras.len()) {
            let reason = format!("must be 1 to {MOST_CAMERAS}, not {}", cameras.len());
            return Err(InvalidField::new("cameras", reason));
        }
        let plan = fixed(PlanRequest::try_from(plan.unwrap_or_default())?);
        let view = v1::View { camera: None, width, height, outputs, plan: Some((&plan).into()), pin: None };
        // With a camera that nothing is wrong with.
        let some = Camera::look_at(DVec3::ZERO, DVec3::X);
        checked(shared, Some(&v1::View { camera: Some((&some).into()), ..view.clone() }))?;
        Ok(Self { client, id: batch_id, cameras, view, encoding: checked_encoding(encoding)?, span })
    }

    /// The view of one of its cameras.
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

/// The plan of all of a batch's views.
fn fixed(plan: PlanRequest) -> PlanRequest {
    PlanRequest { direct: plan.direct || plan.leaves_way_open(), ..plan }
}

/// The frames of a batch, and what became of the others, as they are done.
pub(super) fn answers(shared: Arc<SharedCore>, batch: Batch) -> impl Stream<Item = v1::RenderBatchResponse> {
    // Half of what a client may have in work, so that it is not turned away meanwhile with what else it asks for.
    let at_once = (shared.read(|core| core.config().max_views_per_client) / 2).clamp(1, MOST_AT_ONCE);
    let (count, batch) = (batch.cameras.len(), Arc::new(batch));
    let frame = move |index: usize| {
        let bodies = frame(shared.clone(), batch.clone(), index);
        let said = move |body| v1::RenderBatchResponse { index: index as u32, body: Some(body) };
        bodies.map(said).boxed()
    };
    stream::iter(0..count).map(frame).flatten_unordered(at_once)
}

/// The frame of one camera in chunks, or why there is none.
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
                    // Only the client of a session is sent elsewhere.
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
    fn a_batch_whose_way_is_open_comes_from_triangles_and_another_one_as_it_asks() {
        let open = PlanRequest { preset: Some(Preset::Interactive), ..PlanRequest::default() };
        assert!(fixed(open).direct && fixed(PlanRequest::default()).direct);
        let samples = PlanRequest::from_samples();
        assert_eq!(fixed(samples), samples);
    }
}
