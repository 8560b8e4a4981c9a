//! The `Views` service, which clients call.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::status::{check_version, invalid};
use argus_proto::trace::{TARGET, continued};
use argus_proto::v1::views_server::Views;
use argus_proto::{Description, v1};
use argus_scene::scene::NamedCamera;
use argus_scene::{EffectPlan, InvalidField, PlanRequest, Search};
use futures::{Stream, StreamExt};
use tokio::time::Instant;
use tonic::{Request, Response, Status, Streaming};
use tracing::debug_span;

use super::batch::{self, Batch};
use super::checks::checked_request;
use super::drive::{Answer, answer};
use super::names;
use super::node_names::NodeNames;
use super::session;
use super::set_transforms::set_transforms;
use super::shared_core::SharedCore;
use super::view_request::ViewRequest;
use crate::core::Core;
use crate::security::guard::Caller;
use crate::send_timeout::with_send_timeout;

/// The gRPC service.
pub(super) struct ViewsService {
    pub(super) shared: Arc<SharedCore>,
    /// The description before anything was measured.
    description: Description,
    nodes: NodeNames,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

impl ViewsService {
    pub(super) fn new(shared: Arc<SharedCore>, effect_plan: EffectPlan) -> Self {
        let scene = shared.source.scene();
        let (config, set) = shared.read(|core| (core.config().clone(), core.set().clone()));
        let mut cameras: Vec<NamedCamera> =
            scene.cameras.iter().filter(|named| named.camera.validate().is_ok()).cloned().collect();
        if cameras.is_empty() {
            cameras.push(NamedCamera { name: "default".to_owned(), camera: scene.default_camera() });
        }
        let search = Search::default();
        let description = Description {
            scene_name: scene.name.clone(),
            scene_hash: scene.hash,
            bounds: set.extent,
            triangles: scene.triangles() as u64,
            effects: scene.effects(),
            effect_plan,
            cameras,
            limits: config.limits,
            rig: set.rig,
            epoch_secs: set.epoch_secs,
            first_light: set.first_light(),
            light: shared.source.light().unwrap_or_default(),
            defaults: PlanRequest {
                direct: false,
                search: Some(search),
                steps: Some(config.steps_of(search)),
                supersampling: Some(1),
                samples: Some(config.samples_per_view),
                ..PlanRequest::default()
            },
        };
        let nodes = NodeNames::new(scene);
        Self { shared, description, nodes }
    }
}

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
        let costs = self.shared.read(Core::effect_costs);
        let effect_plan = self.description.effect_plan.clone().with_costs(&costs);
        Ok(Response::new((&Description { effect_plan, ..self.description.clone() }).into()))
    }

    async fn names(&self, request: Request<v1::NamesRequest>) -> Result<Response<v1::NamesResponse>, Status> {
        let scene = self.shared.source.scene();
        Ok(Response::new(names::part(scene, request.into_inner()).map_err(invalid)?))
    }

    async fn set_transforms(
        &self,
        request: Request<v1::SetTransformsRequest>,
    ) -> Result<Response<v1::SetTransformsResponse>, Status> {
        let client = Caller::of(&request).name;
        Ok(Response::new(set_transforms(&self.shared, &self.nodes, client, request.get_ref())?))
    }

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let arrived = Instant::now();
        let span = debug_span!(target: TARGET, "relay", view = request.get_ref().view_id);
        continued(&span, request.metadata());
        let client = Caller::of(&request).name;
        let request = request.into_inner();
        let view = checked_request(&self.shared, &request).map_err(invalid)?;
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
        let frame = answer(self.shared.clone(), view_request, None).filter_map(async |answer| match answer {
            Ok(Answer::Chunk(chunk)) => Some(Ok(chunk)),
            // Single views are never redirected.
            Ok(Answer::Redirect(_)) => None,
            Err(status) => Some(Err(status)),
        });
        Ok(Response::new(Box::pin(with_send_timeout(frame, self.shared.read_within))))
    }

    async fn render_batch(
        &self,
        request: Request<v1::RenderBatchRequest>,
    ) -> Result<Response<Self::RenderBatchStream>, Status> {
        let span = debug_span!(target: TARGET, "batch", batch = request.get_ref().batch_id);
        continued(&span, request.metadata());
        self.shared.check_leading()?;
        let client = Caller::of(&request).name;
        let batch = Batch::checked(&self.shared, client, request.into_inner(), span).map_err(invalid)?;
        let answers = batch::answers(self.shared.clone(), batch).map(Ok);
        Ok(Response::new(Box::pin(with_send_timeout(answers, self.shared.read_within))))
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
        let open = session::Open::new(self.shared.clone(), Caller::of(&request).name)?;
        let answers = session::run(open, request.into_inner());
        Ok(Response::new(Box::pin(with_send_timeout(answers, self.shared.read_within))))
    }
}
