//! Simulated workers for a real coordinator: they join, report and answer over real gRPC, and render nothing.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use argus_cluster::sealed::{Kind, SealKey};
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::frame_chunk::Body;
use argus_proto::v1::redeem_response::Body as Redeemed;
use argus_proto::v1::views_server::{Views, ViewsServer};
use argus_proto::{PROTOCOL_VERSION, v1};
use argus_scene::{Images, Output};
use bytes::Bytes;
use futures::StreamExt as _;
use futures::stream::{self, BoxStream};
use parking_lot::Mutex;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::transport::server::TcpConnectInfo;
use tonic::transport::{Endpoint, Server};
use tonic::{Request, Response, Status, Streaming};

/// Interval between a worker's reports, as the coordinator requests it.
const REPORT: Duration = Duration::from_millis(250);

/// State that all simulated workers share.
#[derive(Debug, Default)]
pub(super) struct PeerState {
    pub(super) answered: AtomicU64,
    /// Answers that clients fetched with a redirect ticket.
    pub(super) redeemed: AtomicU64,
    silence: Mutex<Silence>,
    /// Each worker's key for redirect tickets, by the worker's number.
    keys: Mutex<HashMap<usize, SealKey>>,
    /// Random pixels, which no codec can pack.
    pixels: Bytes,
}

/// A worker that stopped answering, and where its views went.
#[derive(Debug, Default)]
struct Silence {
    who: Silent,
    /// Whether the worker also stopped reporting to the coordinator.
    hangs: bool,
    /// The views that it holds, and when each reached another worker.
    kept: HashMap<String, Option<Instant>>,
}

/// Which worker answers nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Silent {
    #[default]
    None,
    /// The worker that gets the next order.
    Next,
    /// The worker with this number.
    Worker(usize),
}

impl Silence {
    /// Whether a worker answers an order for a view. Records views of the silent worker.
    fn answers(&mut self, worker: usize, view_id: &str) -> bool {
        if self.who == Silent::Next {
            self.who = Silent::Worker(worker);
        }
        match self.who {
            Silent::Worker(silent) if silent == worker => {
                self.kept.insert(view_id.to_owned(), None);
                false
            }
            _ => {
                if let Some(moved) = self.kept.get_mut(view_id) {
                    moved.get_or_insert_with(Instant::now);
                }
                true
            }
        }
    }
}

impl PeerState {
    pub(super) fn new(pixels: Vec<u8>) -> Arc<Self> {
        Arc::new(Self { pixels: pixels.into(), ..Self::default() })
    }

    /// The worker that gets the next order stops answering.
    pub(super) fn silence_next(&self) {
        *self.silence.lock() = Silence { who: Silent::Next, ..Silence::default() };
    }

    /// The silent worker's number, once there is one.
    pub(super) fn silent(&self) -> Option<usize> {
        match self.silence.lock().who {
            Silent::Worker(worker) => Some(worker),
            Silent::None | Silent::Next => None,
        }
    }

    /// The silent worker stops reporting; its stream stays open.
    pub(super) fn hang(&self) {
        self.silence.lock().hangs = true;
    }

    fn hangs(&self, worker: usize) -> bool {
        let silence = self.silence.lock();
        silence.hangs && silence.who == Silent::Worker(worker)
    }

    /// All workers answer again.
    pub(super) fn end_silence(&self) {
        *self.silence.lock() = Silence::default();
    }

    /// When the last of the silent worker's views reached another worker; `None` while one has not.
    pub(super) fn moved(&self) -> Option<Instant> {
        let silence = self.silence.lock();
        let all: Option<Vec<Instant>> = silence.kept.values().copied().collect();
        all?.into_iter().max()
    }

    /// The chunks of a frame: the header, then all pixels.
    fn frame(
        &self,
        worker: usize,
        request: v1::RenderRequest,
    ) -> impl Iterator<Item = v1::FrameChunk> + use<> {
        let (view, order) = (request.view.unwrap_or_default(), request.order.unwrap_or_default());
        let bytes = self.pixels.slice(..(view.width * view.height * 3) as usize);
        let image = v1::ImageHeader {
            output: v1::Output::Color as i32,
            encoding: v1::Encoding::Raw as i32,
            packed_bytes: bytes.len() as u64,
        };
        let header = v1::FrameHeader {
            width: view.width,
            height: view.height,
            images: vec![image],
            served: Some(v1::Served::default()),
            provenance: Some(v1::Provenance {
                scene_hash: Bytes::from_static(&[0; 32]),
                epoch: order.state.unwrap_or_default().epoch,
                plan: order.plan,
                device: "simulated".to_owned(),
                ..v1::Provenance::default()
            }),
            view_id: request.view_id,
            worker: format!("peer-{worker}"),
            age_ms: order.age_ms,
            ..v1::FrameHeader::default()
        };
        self.answered.fetch_add(1, Ordering::Relaxed);
        let digest = Images::from([(Output::Color, bytes.clone())]).digest();
        let digest = Bytes::copy_from_slice(&digest.0);
        let chunks = [
            Body::Header(header),
            Body::Data(v1::FrameData { offset: 0, bytes }),
            Body::Trailer(v1::FrameTrailer { digest }),
        ];
        chunks.map(|body| v1::FrameChunk { body: Some(body) }).into_iter()
    }
}

/// The address of a worker. Each has its own in 127.0.0.0/8; all lead to one listener.
fn address(worker: usize, port: u16) -> SocketAddr {
    let [high, low] = (worker as u16).to_be_bytes();
    ([127, 1, high, low], port).into()
}

fn number(local: SocketAddr) -> usize {
    match local {
        SocketAddr::V4(v4) => usize::from(u16::from_be_bytes([v4.ip().octets()[2], v4.ip().octets()[3]])),
        SocketAddr::V6(_) => usize::MAX,
    }
}

/// The worker to which a request was sent, by its local address.
fn worker_of<T>(request: &Request<T>) -> usize {
    let local = request.extensions().get::<TcpConnectInfo>().and_then(TcpConnectInfo::local_addr);
    local.map_or(usize::MAX, number)
}

/// Serves views for all simulated workers. Returns the port.
pub(super) async fn serve(shared: Arc<PeerState>) -> Result<(u16, AbortHandle)> {
    let listener = TcpListener::bind(("0.0.0.0", 0)).await.context("cannot listen for simulated workers")?;
    let port = listener.local_addr()?.port();
    let service = ViewsServer::new(Answering { shared });
    let serving = Server::builder()
        .initial_connection_window_size(16 << 20)
        .add_service(service)
        .serve_with_incoming(TcpListenerStream::new(listener));
    Ok((port, tokio::spawn(async move { drop(serving.await) }).abort_handle()))
}

struct Answering {
    shared: Arc<PeerState>,
}

#[tonic::async_trait]
impl Views for Answering {
    type RenderStream = BoxStream<'static, Result<v1::FrameChunk, Status>>;
    type SessionStream = BoxStream<'static, Result<v1::SessionResponse, Status>>;
    type RenderBatchStream = BoxStream<'static, Result<v1::RenderBatchResponse, Status>>;
    type RedeemStream = BoxStream<'static, Result<v1::RedeemResponse, Status>>;

    async fn describe(
        &self,
        _request: Request<v1::DescribeRequest>,
    ) -> Result<Response<v1::DescribeResponse>, Status> {
        Err(Status::unimplemented("simulated"))
    }

    async fn names(
        &self,
        _request: Request<v1::NamesRequest>,
    ) -> Result<Response<v1::NamesResponse>, Status> {
        Err(Status::unimplemented("simulated"))
    }

    async fn set_transforms(
        &self,
        _request: Request<v1::SetTransformsRequest>,
    ) -> Result<Response<v1::SetTransformsResponse>, Status> {
        Err(Status::unimplemented("simulated"))
    }

    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<Self::RenderStream>, Status> {
        let worker = worker_of(&request);
        let request = request.into_inner();
        if !self.shared.silence.lock().answers(worker, &request.view_id) {
            std::future::pending::<()>().await;
        }
        let chunks = self.shared.frame(worker, request).map(Ok);
        Ok(Response::new(stream::iter(chunks).boxed()))
    }

    async fn render_batch(
        &self,
        _request: Request<v1::RenderBatchRequest>,
    ) -> Result<Response<Self::RenderBatchStream>, Status> {
        Err(Status::unimplemented("simulated"))
    }

    async fn redeem(
        &self,
        request: Request<v1::RedeemRequest>,
    ) -> Result<Response<Self::RedeemStream>, Status> {
        let worker = worker_of(&request);
        let sealed = request.into_inner().ticket.unwrap_or_default();
        let unknown = || Status::invalid_argument("the ticket is unknown");
        let key = self.shared.keys.lock().get(&worker).cloned().ok_or_else(unknown)?;
        let ticket: v1::RedirectTicket = key.open(Kind::RedirectTicket, &sealed).ok_or_else(unknown)?;
        self.shared.redeemed.fetch_add(1, Ordering::Relaxed);
        let chunks: Vec<_> = self.shared.frame(worker, ticket.request.unwrap_or_default()).collect();
        let header = chunks.iter().find_map(|chunk| match &chunk.body {
            Some(Body::Header(header)) => Some(header.clone()),
            _ => None,
        });
        let receipt = key.seal(Kind::Receipt, &v1::Receipt { serial: ticket.serial, header });
        let bodies = chunks.into_iter().map(Redeemed::Chunk).chain([Redeemed::Receipt(receipt)]);
        let answers = bodies.map(|body| Ok(v1::RedeemResponse { body: Some(body) }));
        Ok(Response::new(stream::iter(answers).boxed()))
    }

    async fn session(
        &self,
        _request: Request<Streaming<v1::SessionRequest>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        Err(Status::unimplemented("simulated"))
    }
}

/// Joins as worker `number` and reports until it is aborted, which breaks its stream. It claims to hold every sample
/// of its assignments, so that views go to all workers alike.
pub(super) async fn join(
    shared: Arc<PeerState>,
    coordinator: String,
    worker: usize,
    port: u16,
) -> Result<()> {
    let channel = Endpoint::from_shared(coordinator)?.tcp_nodelay(true).connect().await?;
    let (reports, receiver) = mpsc::channel(4);
    let hello = v1::Hello {
        protocol_version: PROTOCOL_VERSION,
        worker_id: format!("peer-{worker:05}"),
        pid: 0,
        address: format!("http://{}", address(worker, port)),
        public_address: format!("http://{}", address(worker, port)),
        device: "simulated".to_owned(),
        cores: 1,
        scene_hash: Default::default(),
    };
    let hello = v1::worker_report::Body::Hello(hello);
    reports.send(v1::WorkerReport { body: Some(hello) }).await?;
    let answer = ClusterClient::new(channel).join(ReceiverStream::new(receiver)).await?;
    let mut assignments = answer.into_inner();
    let mut report = v1::Measurements { sample_ms: Some(20.0), view_ms: Some(2.0), ..Default::default() };
    let mut interval = tokio::time::interval(REPORT);
    loop {
        tokio::select! {
            assignment = assignments.message() => {
                let Some(assignment) = assignment? else { return Ok(()) };
                (report.applied, report.role) = (assignment.sequence, assignment.role);
                if let Some(key) = SealKey::from_bytes(&assignment.seal_key) {
                    shared.keys.lock().insert(worker, key);
                }
                let told = assignment.sources.into_iter().filter_map(|source| source.id);
                report.held.extend(told);
            }
            _ = interval.tick() => {}
        }
        if shared.hangs(worker) {
            std::future::pending::<()>().await;
        }
        let body = v1::worker_report::Body::Measurements(report.clone());
        if reports.send(v1::WorkerReport { body: Some(body) }).await.is_err() {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_ends_when_all_views_of_the_silent_worker_have_moved() {
        let shared = PeerState::new(Vec::new());
        let order = |worker, view: &str| shared.silence.lock().answers(worker, view);
        assert!(order(3, "before"));
        shared.silence_next();
        assert_eq!((order(5, "a"), order(5, "b"), shared.silent()), (false, false, Some(5)));
        assert!(order(4, "c"), "order 4 is answered");
        assert_eq!(shared.moved(), None, "of the views that wait, none has moved");
        assert!(order(4, "a") && shared.moved().is_none(), "one of two");
        let before = Instant::now();
        assert!(order(7, "b"));
        assert!(shared.moved().is_some_and(|at| at >= before));
        assert!(!shared.hangs(5));
        shared.hang();
        assert!(shared.hangs(5) && !shared.hangs(4));
        shared.end_silence();
        assert!(order(5, "d") && !shared.hangs(5));
    }
}
