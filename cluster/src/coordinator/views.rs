//! The `Views` service, which clients call.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::status::{check_version, invalid};
use argus_proto::trace::{TARGET, continued};
use argus_proto::v1::views_server::Views;
use argus_proto::{Description, v1};
use argus_scene::InvalidField;
use futures::{Stream, StreamExt};
use tokio::time::Instant;
use tonic::{Request, Response, Status, Streaming};
use tracing::debug_span;

use super::batch::{self, Batch};
use super::checks::checked_request;
use super::drive::{Answer, answer};
use super::names;
use super::scene_table::SceneTable;
use super::served_scene::ServedScene;
use super::session;
use super::set_transforms::set_transforms;
use super::view_request::ViewRequest;
use crate::core::Core;
use crate::security::guard::Caller;
use crate::send_timeout::with_send_timeout;

/// The gRPC service.
pub(super) struct ViewsService {
    pub(super) scenes: Arc<SceneTable>,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl Views for ViewsService {
    type RenderStream = Streamed<v1::FrameChunk>;
    type RenderBatchStream = Streamed<v1::RenderBatchResponse>;
    type SessionStream = Streamed<v1::SessionResponse>;
    type RedeemStream = Streamed<v1::RedeemResponse>;

    async fn describe(
        &self,
        request: Request<v1::DescribeRequest>,
    ) -> Result<Response<v1::DescribeResponse>, Status> {
        match request.get_ref().protocol_version {
            0 => {}
            theirs => check_version(theirs)?,
        }
        let ServedScene { shared, description, .. } = self.scenes.of(request.metadata())?;
        let costs = shared.read(Core::effect_costs);
        let effect_plan = description.effect_plan.clone().with_costs(&costs);
        Ok(Response::new((&Description { effect_plan, ..description.clone() }).into()))
    }

    async fn names(&self, request: Request<v1::NamesRequest>) -> Result<Response<v1::NamesResponse>, Status> {
        let scene = self.scenes.of(request.metadata())?.shared.source.scene();
        Ok(Response::new(names::part(scene, request.into_inner()).map_err(invalid)?))
    }

    async fn set_transforms(
        &self,
        request: Request<v1::SetTransformsRequest>,
    ) -> Result<Response<v1::SetTransformsResponse>, Status> {
        let client = Caller::of(&request).name;
        let ServedScene { shared, nodes, .. } = self.scenes.of(request.metadata())?;
        Ok(Response::new(set_transforms(shared, nodes, client, request.get_ref())?))
    }

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let arrived = Instant::now();
        let span = debug_span!(target: TARGET, "relay", view = request.get_ref().view_id);
        continued(&span, request.metadata());
        let shared = &self.scenes.of(request.metadata())?.shared;
        let client = Caller::of(&request).name;
        let request = request.into_inner();
        let view = checked_request(shared, &request).map_err(invalid)?;
        let view_request = ViewRequest {
            client,
            view,
            wire: request.view.unwrap_or_default(),
            view_id: request.view_id,
            deadline: (request.deadline_ms > 0).then(|| Duration::from_millis(request.deadline_ms.into())),
            encoding: request.encoding,
            history: String::new(),
            arrived,
            span,
        };
        let frame = answer(shared.clone(), view_request, None).filter_map(async |answer| match answer {
            Ok(Answer::Chunk(chunk)) => Some(Ok(chunk)),
            // Single views are never redirected.
            Ok(Answer::Redirect(_)) => None,
            Err(status) => Some(Err(status)),
        });
        Ok(Response::new(Box::pin(with_send_timeout(frame, shared.read_within))))
    }

    async fn render_batch(
        &self,
        request: Request<v1::RenderBatchRequest>,
    ) -> Result<Response<Self::RenderBatchStream>, Status> {
        let span = debug_span!(target: TARGET, "batch", batch = request.get_ref().batch_id);
        continued(&span, request.metadata());
        let shared = &self.scenes.of(request.metadata())?.shared;
        shared.check_leading()?;
        let client = Caller::of(&request).name;
        let batch = Batch::checked(shared, client, request.into_inner(), span).map_err(invalid)?;
        let answers = batch::answers(shared.clone(), batch).map(Ok);
        Ok(Response::new(Box::pin(with_send_timeout(answers, shared.read_within))))
    }

    async fn redeem(
        &self,
        _request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        Err(invalid(InvalidField::new("ticket", "must be redeemed at the worker whose address came with it")))
    }

    async fn session(
        &self,
        request: Request<Streaming<v1::SessionRequest>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        let shared = &self.scenes.of(request.metadata())?.shared;
        let open = session::Open::new(shared.clone(), Caller::of(&request).name)?;
        let answers = session::run(open, request.into_inner());
        Ok(Response::new(Box::pin(with_send_timeout(answers, shared.read_within))))
    }
}
