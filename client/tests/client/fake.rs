//! A server that answers with made-up frames and misbehaves on demand.

use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use argus_client::{Client, ConnectOptions};
use argus_proto::chunks::{FrameMeta, frame_chunks};
use argus_proto::v1::cluster_server::{Cluster, ClusterServer};
use argus_proto::v1::redeem_response::Body as Redeemed;
use argus_proto::v1::render_batch_response::Body as Batched;
use argus_proto::v1::session_response::Body;
use argus_proto::v1::views_server::{Views, ViewsServer};
use argus_proto::v1::{self, Encoding};
use argus_proto::{Description, Fault, status};
use argus_scene::scene::NamedCamera;
use argus_scene::{
    Bounds, Camera, Frame, Images, Limits, Output, Outputs, Plan, PlanRequest, Provenance, Rig, SampleId,
    SceneHash, SceneState, View, Warp,
};
use futures::{Stream, StreamExt};
use glam::DVec3;
use prost::Message as _;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{mpsc, oneshot, watch};

use tokio::time::sleep;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::transport::Server;
use tonic::{Request, Response, Status, Streaming};

/// The server's misbehaviour.
#[derive(Debug, Default)]
pub(crate) struct Fake {
    /// Protocol version in `Describe`; `None`: the current one.
    pub(crate) version: Option<u32>,
    /// Number of first renders rejected with `UNAVAILABLE`.
    pub(crate) unavailable: AtomicU32,
    /// Number of first frames of batches that fail since all workers were lost.
    pub(crate) lost: AtomicU32,
    /// Number of first frames that lose their last chunk.
    pub(crate) truncate: AtomicU32,
    /// Number of first sessions that end in the middle of a frame.
    pub(crate) end_sessions: AtomicU32,
    /// Whether every render is rejected because of overload.
    pub(crate) overloaded: bool,
    /// Time that a session takes to open.
    pub(crate) opening: Duration,
    /// Time that each frame takes.
    pub(crate) frame_time: Duration,
    /// Pause between a frame's header and the rest of it.
    pub(crate) dawdle: Duration,
    /// A time span after the first render in which no render is answered.
    pub(crate) stall: Option<(Duration, Duration)>,
    /// When the first render arrived.
    pub(crate) first_render: Mutex<Option<Instant>>,
    /// View ids of all renders, in order.
    pub(crate) view_ids: Mutex<Vec<String>>,
    /// Acknowledgements received from sessions.
    pub(crate) acks: AtomicU64,
    /// Acknowledgements with a worker's receipt.
    pub(crate) receipts: AtomicU64,
    /// The worker to which sessions are redirected.
    pub(crate) redirect: Mutex<Option<String>>,
    /// Frames that sessions sent completely.
    pub(crate) session_frames: AtomicU64,
}

/// A running fake server. It stops when dropped.
pub(crate) struct Running {
    pub(crate) fake: Arc<Fake>,
    pub(crate) address: SocketAddr,
    /// A runtime of its own, so that all tasks of the server end with it.
    runtime: Option<Runtime>,
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

impl Running {
    /// Breaks all connections and frees the port, like a killed process.
    pub(crate) async fn kill(mut self) {
        self.runtime.take().expect("runs until it is killed").shutdown_background();
        while TcpListener::bind(self.address).await.is_err() {
            sleep(Duration::from_millis(1)).await;
        }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    pub(crate) async fn client(&self) -> Client {
        let options = ConnectOptions { connections: 2, ..ConnectOptions::default() };
        Client::connect_with(&self.url(), &options).await.unwrap()
    }
}

impl Fake {
    pub(crate) async fn serve(self) -> Running {
        serve_at(Arc::new(self), "127.0.0.1:0".parse().unwrap()).await
    }

    /// Answers or rejects a view, as the fields say.
    async fn chunks(&self, view: &View, view_id: &str, encoding: i32) -> Result<Vec<v1::FrameChunk>, Status> {
        view.validate(&Limits::default()).map_err(status::invalid)?;
        let first = *lock(&self.first_render).get_or_insert_with(Instant::now);
        if let Some((begin, end)) = self.stall
            && (begin..end).contains(&first.elapsed())
        {
            sleep(end - first.elapsed()).await;
        }
        sleep(self.frame_time).await;
        let meta = FrameMeta {
            view_id: view_id.to_owned(),
            worker: "fake".to_owned(),
            age_ms: 1.5,
            ..FrameMeta::default()
        };
        let encoding = Encoding::try_from(encoding).unwrap();
        let mut chunks = frame_chunks(&frame(view), &meta, encoding).unwrap();
        if take_one(&self.truncate) {
            chunks.pop();
        }
        Ok(chunks)
    }
}

pub(crate) async fn serve_at(fake: Arc<Fake>, address: SocketAddr) -> Running {
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let router = Server::builder()
        .add_service(ViewsServer::new(Handler(Arc::clone(&fake))))
        .add_service(ClusterServer::new(Handler(Arc::clone(&fake))));
    let (bound, is_bound) = oneshot::channel();
    runtime.spawn(async move {
        let listener = TcpListener::bind(address).await.unwrap();
        bound.send(listener.local_addr().unwrap()).unwrap();
        router.serve_with_incoming(TcpListenerStream::new(listener)).await.unwrap();
    });
    let address = is_bound.await.unwrap();
    Running { fake, address, runtime: Some(runtime) }
}

pub(crate) fn view(x: f64) -> View {
    View {
        camera: Camera::look_at(DVec3::new(x, 2.0, 3.0), DVec3::ZERO),
        width: 40,
        height: 30,
        outputs: Outputs::COLOR.with(Output::Range),
        plan: PlanRequest::default(),
        pin: None,
        flow_to: None,
        rays: None,
    }
}

/// A frame that depends on the view, so that tests notice mix-ups.
pub(crate) fn frame(view: &View) -> Frame {
    let pixels = (view.width * view.height) as usize;
    let shade = (view.camera.eye.x * 16.0) as u8;
    let plan =
        Plan::Warp(Warp { steps: 16, samples: vec![SampleId { version: 0, camera: 2 }], ..Warp::default() });
    let provenance = Provenance {
        device: "none".to_owned(),
        ..Provenance::of_plan(SceneHash([7; 32]), SceneState::default(), plan)
    };
    Frame {
        images: Images::default()
            .with(Output::Color, view.outputs.has(Output::Color).then(|| vec![shade; 3 * pixels].into()))
            .with(
                Output::Range,
                view.outputs.has(Output::Range).then(|| 2.5f32.to_le_bytes().repeat(pixels).into()),
            ),
        ..Frame::without_images(view.width, view.height, provenance)
    }
}

fn description() -> Description {
    let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
    Description {
        scene_name: "fake".to_owned(),
        scene_hash: SceneHash([7; 32]),
        bounds,
        triangles: 12,
        effects: Vec::new(),
        effect_plan: argus_scene::EffectPlan::default(),
        cameras: vec![NamedCamera { name: "front".to_owned(), camera: view(1.0).camera }],
        limits: Limits::default(),
        rig: Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 },
        defaults: PlanRequest::default(),
        epoch_secs: 0.0,
        first_light: argus_scene::LightLevel::Full,
        light: String::new(),
        scenes: Vec::new(),
    }
}

struct Handler(Arc<Fake>);

type Chunks<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// Names that the fake server has.
pub(crate) const NAMES: u32 = 7;

#[tonic::async_trait]
impl Views for Handler {
    async fn describe(
        &self,
        _: Request<v1::DescribeRequest>,
    ) -> Result<Response<v1::DescribeResponse>, Status> {
        let mut response = v1::DescribeResponse::from(&description());
        response.protocol_version = self.0.version.unwrap_or(response.protocol_version);
        Ok(Response::new(response))
    }

    async fn names(&self, request: Request<v1::NamesRequest>) -> Result<Response<v1::NamesResponse>, Status> {
        let first = request.get_ref().first;
        let names = (first..NAMES.min(first + 3)).map(|id| format!("name {id}")).collect();
        Ok(Response::new(v1::NamesResponse { names, total: NAMES }))
    }

    /// Answers with the number of nodes as the revision.
    async fn set_transforms(
        &self,
        request: Request<v1::SetTransformsRequest>,
    ) -> Result<Response<v1::SetTransformsResponse>, Status> {
        let revision = request.get_ref().nodes.len() as u64;
        Ok(Response::new(v1::SetTransformsResponse { revision, ..v1::SetTransformsResponse::default() }))
    }

    type RenderStream = Chunks<v1::FrameChunk>;

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let request = request.into_inner();
        lock(&self.0.view_ids).push(request.view_id.clone());
        assert!(request.deadline_ms > 0, "a client always sends its timeout");
        if self.0.overloaded {
            let (what, retry_after) = ("64 views wait".to_owned(), Duration::from_millis(100));
            return Err(Fault::Overloaded { what, retry_after }.into());
        }
        if take_one(&self.0.unavailable) {
            return Err(Fault::Unavailable("no compositor yet".to_owned()).into());
        }
        let view: View = request.view.unwrap_or_default().try_into().map_err(status::invalid)?;
        let chunks = self.0.chunks(&view, &request.view_id, request.encoding).await?;
        let dawdle = self.0.dawdle;
        let chunks =
            futures::stream::iter(chunks.into_iter().enumerate()).then(move |(i, chunk)| async move {
                sleep(if i == 1 { dawdle } else { Duration::ZERO }).await;
                Ok(chunk)
            });
        Ok(Response::new(Box::pin(chunks)))
    }

    type RenderBatchStream = Chunks<v1::RenderBatchResponse>;

    /// Sends the frames in reverse order with alternating chunks. If the server is to be unavailable, the stream
    /// breaks after two thirds of them.
    async fn render_batch(
        &self,
        request: Request<v1::RenderBatchRequest>,
    ) -> Result<Response<Self::RenderBatchStream>, Status> {
        let v1::RenderBatchRequest { cameras, width, height, outputs, plan, batch_id, encoding } =
            request.into_inner();
        lock(&self.0.view_ids).push(batch_id);
        let mut said = Vec::new();
        for (index, camera) in cameras.into_iter().enumerate().rev() {
            let view = v1::View {
                camera: Some(camera),
                width,
                height,
                outputs: outputs.clone(),
                plan,
                pin: None,
                flow_to: None,
                rays: Default::default(),
            };
            let (view, index) = (View::try_from(view).map_err(status::invalid)?, index as u32);
            if take_one(&self.0.lost) {
                let failure = v1::SessionFailure {
                    code: tonic::Code::Unavailable as i32,
                    ..v1::SessionFailure::default()
                };
                said.push((0, index, Batched::Failure(failure)));
                continue;
            }
            let chunks = self.0.chunks(&view, "", encoding).await?.into_iter().map(Batched::Chunk);
            said.extend(chunks.enumerate().map(|(at, body)| (at, index, body)));
        }
        said.sort_by_key(|(at, ..)| *at);
        let breaks = take_one(&self.0.unavailable);
        let kept = if breaks { said.len() * 2 / 3 } else { said.len() };
        let said = said.into_iter().take(kept);
        let answers = said.map(|(_, index, body)| Ok(v1::RenderBatchResponse { index, body: Some(body) }));
        let end = breaks.then(|| Err(Fault::Unavailable("no compositor left".to_owned()).into()));
        Ok(Response::new(Box::pin(futures::stream::iter(answers.chain(end).collect::<Vec<_>>()))))
    }

    type RedeemStream = Chunks<v1::RedeemResponse>;

    async fn redeem(
        &self,
        request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        // The tickets are the encoded requests.
        let ticket = request.into_inner().ticket.unwrap_or_default();
        let request = v1::RenderRequest::decode(ticket.body).map_err(|e| Status::internal(e.to_string()))?;
        let view: View = request.view.unwrap_or_default().try_into().map_err(status::invalid)?;
        let chunks = self.0.chunks(&view, "", request.encoding).await?.into_iter();
        let receipt = v1::Sealed { body: "a receipt".into(), seal: Default::default() };
        let bodies = chunks.map(Redeemed::Chunk).chain([Redeemed::Receipt(receipt)]);
        let answers = bodies.map(|body| Ok(v1::RedeemResponse { body: Some(body) }));
        Ok(Response::new(Box::pin(futures::stream::iter(answers))))
    }

    type SessionStream = Chunks<v1::SessionResponse>;

    async fn session(
        &self,
        request: Request<Streaming<v1::SessionRequest>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        sleep(self.0.opening).await;
        let (newest, mut cameras) = watch::channel(None);
        let (acked, mut acks) = watch::channel((0, true));
        let received = Arc::new(AtomicU64::new(0));
        let mut incoming = request.into_inner();
        let (fake, arrived) = (Arc::clone(&self.0), Arc::clone(&received));
        tokio::spawn(async move {
            while let Some(Ok(request)) = incoming.next().await {
                match request.body.unwrap() {
                    v1::session_request::Body::View(view) => {
                        arrived.fetch_add(1, Ordering::SeqCst);
                        newest.send_replace(Some((request.camera_seq, view)));
                    }
                    v1::session_request::Body::Ack(ack) => {
                        fake.acks.fetch_add(1, Ordering::SeqCst);
                        fake.receipts.fetch_add(ack.receipt.is_some().into(), Ordering::SeqCst);
                        acked.send_replace((request.camera_seq, true));
                    }
                    v1::session_request::Body::Missed(_) => {
                        acked.send_replace((request.camera_seq, false));
                    }
                }
            }
        });
        let (responses, stream) = mpsc::channel(1);
        let fake = Arc::clone(&self.0);
        tokio::spawn(async move {
            let mut taken = 0;
            while cameras.changed().await.is_ok() {
                let Some((camera_seq, view)) = cameras.borrow_and_update().clone() else { continue };
                taken += 1;
                let superseded = received.load(Ordering::SeqCst) - taken;
                let respond = |body| v1::SessionResponse { camera_seq, superseded, body: Some(body) };
                let encoding = view.encoding;
                let redirect = lock(&fake.redirect).clone().filter(|_| view.redirectable);
                if let Some(address) = redirect {
                    let request =
                        v1::RenderRequest { view: view.view.clone(), encoding, ..Default::default() };
                    let ticket =
                        v1::Sealed { body: request.encode_to_vec().into(), seal: Default::default() };
                    let redirect = v1::Redirect { address, ticket: Some(ticket), age_ms: 1000.0, serial: 1 };
                    if responses.send(Ok(respond(Body::Redirect(redirect)))).await.is_err() {
                        return;
                    }
                    match acks.wait_for(|(seq, _)| *seq >= camera_seq).await.map(|word| word.1) {
                        Ok(true) => continue,
                        Ok(false) => {}
                        Err(_) => return,
                    }
                }
                let view = view.view.unwrap_or_default().try_into().map_err(status::invalid);
                let chunks = match view {
                    Ok(view) => fake.chunks(&view, "", encoding).await,
                    Err(status) => Err(status),
                };
                let chunks = match chunks {
                    Ok(chunks) => chunks,
                    Err(status) => {
                        let field = status::invalid_field(&status).unwrap_or_default().0;
                        let (code, message) = (status.code() as i32, status.message().to_owned());
                        let failure = v1::SessionFailure { code, message, field, retry_after_ms: 0 };
                        let _ = responses.send(Ok(respond(Body::Failure(failure)))).await;
                        continue;
                    }
                };
                let end_early = take_one(&fake.end_sessions);
                for (i, chunk) in chunks.into_iter().enumerate() {
                    sleep(if i == 1 { fake.dawdle } else { Duration::ZERO }).await;
                    if responses.send(Ok(respond(Body::Chunk(chunk)))).await.is_err() || end_early {
                        return;
                    }
                }
                fake.session_frames.fetch_add(1, Ordering::SeqCst);
                if acks.wait_for(|(seq, arrived)| *arrived && *seq >= camera_seq).await.is_err() {
                    return;
                }
            }
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }
}

#[tonic::async_trait]
impl Cluster for Handler {
    type JoinStream = Chunks<v1::Assignment>;

    async fn join(
        &self,
        _: Request<Streaming<v1::WorkerReport>>,
    ) -> Result<Response<Self::JoinStream>, Status> {
        Err(Status::unimplemented("a fake has no workers"))
    }

    async fn status(&self, _: Request<v1::StatusRequest>) -> Result<Response<v1::StatusResponse>, Status> {
        let worker = |id: &str, role| v1::WorkerStatus {
            id: id.to_owned(),
            pid: 17,
            role,
            address: "http://127.0.0.1:7401".to_owned(),
            ..Default::default()
        };
        Ok(Response::new(v1::StatusResponse {
            processes: 2,
            samplers: 1,
            compositors: 1,
            view_ms: 1.25,
            tick_measured_ms: f64::NAN,
            workers: vec![worker("a", v1::Role::Sampler as i32), worker("b", 99)],
            ..Default::default()
        }))
    }
}

/// Decrements a counter unless it is 0. Returns whether it did.
fn take_one(counter: &AtomicU32) -> bool {
    counter.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1)).is_ok()
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
