//! `Views`: what clients call.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::status::{check_version, invalid};
use argus_proto::trace::{TARGET, continued};
use argus_proto::v1::views_server::Views;
use argus_proto::{Description, v1};
use argus_scene::scene::NamedCamera;
use argus_scene::{InvalidField, PlanRequest, Search, View};
use futures::Stream;
use tokio::time::Instant;
use tonic::{Request, Response, Status, Streaming};
use tracing::debug_span;

use super::hub::Hub;
use super::relay::{Wanted, relay};
use super::session;
use crate::security::guard::Caller;
use crate::send_timeout::in_time;

/// The longest `view_id` that is carried around.
const MAX_VIEW_ID: usize = 128;

/// The service.
pub(super) struct ViewsService {
    pub(super) hub: Arc<Hub>,
    description: Description,
}

type Streamed<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

impl ViewsService {
    pub(super) fn new(hub: Arc<Hub>) -> Self {
        let scene = hub.source.scene();
        let (config, set) = hub.look(|core| (core.config().clone(), core.set().clone()));
        let mut cameras: Vec<NamedCamera> =
            scene.cameras.iter().filter(|named| named.camera.validate().is_ok()).cloned().collect();
        if cameras.is_empty() {
            cameras.push(NamedCamera { name: "default".to_owned(), camera: scene.default_camera() });
        }
        let search = Search::default();
        let description = Description {
            scene_name: scene.name.clone(),
            scene_hash: scene.hash,
            bounds: set.bounds,
            triangles: scene.triangles() as u64,
            effects: scene.effects(),
            cameras,
            limits: config.limits,
            rig: set.rig,
            epoch_secs: set.epoch_secs,
            defaults: PlanRequest {
                direct: false,
                search: Some(search),
                steps: Some(config.steps_of(search)),
                supersampling: Some(1),
                samples: Some(config.samples_per_view),
                ..PlanRequest::default()
            },
        };
        Self { hub, description }
    }
}

/// Checks a view as it came.
pub(super) fn checked(hub: &Hub, wire: Option<&v1::View>) -> Result<View, InvalidField> {
    let wire = wire.cloned().ok_or_else(|| InvalidField::new("view", "must be given"))?;
    let view = View::try_from(wire)?;
    view.validate(&hub.standing.limits)?;
    Ok(view)
}

/// Checks how the images of a frame shall be packed.
pub(super) fn checked_encoding(encoding: i32) -> Result<i32, InvalidField> {
    match v1::Encoding::try_from(encoding) {
        Ok(_) => Ok(encoding),
        Err(_) => Err(InvalidField::new("encoding", format!("{encoding} is not a known value"))),
    }
}

#[tonic::async_trait]
impl Views for ViewsService {
    type RenderStream = Streamed<v1::FrameChunk>;
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
        Ok(Response::new((&self.description).into()))
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
        let view = checked(&self.hub, request.view.as_ref()).map_err(invalid)?;
        let encoding = checked_encoding(request.encoding).map_err(invalid)?;
        if request.view_id.len() > MAX_VIEW_ID {
            let reason = format!("must be at most {MAX_VIEW_ID} bytes, not {}", request.view_id.len());
            return Err(invalid(InvalidField::new("view_id", reason)));
        }
        if request.order.is_some() {
            return Err(invalid(InvalidField::new(
                "order",
                "must be absent: only a coordinator gives orders",
            )));
        }
        let wanted = Wanted {
            client,
            view,
            wire: request.view.unwrap_or_default(),
            view_id: request.view_id,
            deadline: (request.deadline_ms > 0).then(|| Duration::from_millis(request.deadline_ms.into())),
            encoding,
            history: String::new(),
            arrived,
            span,
        };
        let frame = relay(self.hub.clone(), wanted);
        Ok(Response::new(Box::pin(in_time(frame, self.hub.read_within))))
    }

    async fn redeem(
        &self,
        _request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        Err(invalid(InvalidField::new("ticket", "is for the worker at the address that it came with")))
    }

    async fn session(
        &self,
        request: Request<Streaming<v1::SessionRequest>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        let open = session::Open::new(self.hub.clone(), Caller::of(&request).name)?;
        let answers = session::run(open, request.into_inner());
        Ok(Response::new(Box::pin(in_time(answers, self.hub.read_within))))
    }
}
