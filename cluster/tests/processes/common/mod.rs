//! A whole cluster in one process, on port 0, with roles that compute pixels without a GPU.

// Each test binary uses its own part of this.
#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used)]

pub mod leader;
pub mod roles;
pub mod session;

use std::future::Future;
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use argus_cluster::leadership::{LocalRegistry, Registry};
use argus_cluster::{SceneFile, SceneOpener, SceneRef, SceneSource, coordinator, core, worker};
use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::v1::{self};
use argus_scene::animation::{Node, Parts, Rest};
use argus_scene::scene::RigKind;
use argus_scene::{Camera, Frame, Instance, Limits, Mesh, PlanRequest, Provenance, Scene, SceneHash, View};
use glam::{DAffine3, DVec3, Vec3};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_util::sync::CancellationToken;
use tonic::Status;
use tonic::transport::Channel;

use roles::{Factory, Settings};

/// A test that waits this long hangs.
pub const LIMIT: Duration = Duration::from_secs(30);

/// Reports why a test is skipped, also where the output of passed tests is captured. If this variable is 1, skipping
/// is a failure.
pub fn skip(required_by: &str, why: &str) {
    let required = std::env::var(required_by).is_ok_and(|value| value == "1");
    assert!(!required, "{required_by}=1, yet {why}");
    let _ = writeln!(std::io::stderr(), "SKIPPED, LOUDLY: {why}");
}

/// One triangle, and a hash that follows from the name.
pub fn scene(name: &str) -> Arc<Scene> {
    let mesh = Mesh {
        positions: vec![Vec3::new(-10.0, 0.0, -10.0), Vec3::new(10.0, 0.0, -10.0), Vec3::new(0.0, 4.0, 10.0)],
        normals: vec![Vec3::Y; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let mut hash = [0; 32];
    for (place, byte) in name.bytes().enumerate() {
        hash[place % 32] ^= byte;
    }
    Arc::new(Scene {
        name: name.to_owned(),
        hash: SceneHash(hash),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, node: None, world_from_mesh: DAffine3::IDENTITY }],
        nodes: [("box", None), ("lid", Some(0)), ("twin", None), ("twin", None)].map(node).into(),
        rig: RigKind::TileCorners,
        ..Scene::default()
    })
}

/// A node of that name and parent, which nothing hangs from.
fn node((name, parent): (&str, Option<u32>)) -> Node {
    Node { name: name.to_owned(), parent, rest: Rest::Parts(Parts::default()), lights: Vec::new() }
}

/// Serves a generated scene, or one of two files.
pub struct Source {
    pub scene: Arc<Scene>,
    pub files: Vec<(String, PathBuf)>,
}

impl SceneSource for Source {
    fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    fn procedural(&self) -> Option<String> {
        self.files.is_empty().then(|| self.scene.name.clone())
    }

    fn files(&self) -> Result<Vec<(String, PathBuf)>, String> {
        Ok(self.files.clone())
    }
}

/// Opens the scene locally, or counts fetches.
#[derive(Default)]
pub struct Opener {
    pub has_nothing: bool,
    pub generated: AtomicUsize,
    pub fetched: parking_lot::Mutex<Vec<SceneFile>>,
}

impl SceneOpener for Opener {
    fn open_local(&self, reference: &SceneRef) -> Result<Option<Arc<Scene>>, String> {
        Ok((!self.has_nothing).then(|| scene(&reference.name)))
    }

    fn open_procedural(&self, spec: &str) -> Result<Arc<Scene>, String> {
        self.generated.fetch_add(1, Ordering::SeqCst);
        Ok(scene(spec))
    }

    fn open_bundle(&self, reference: &SceneRef, files: Vec<SceneFile>) -> Result<Arc<Scene>, String> {
        *self.fetched.lock() = files;
        Ok(scene(&reference.name))
    }
}

/// A process of the cluster, in its own runtime, so that it can be killed at any moment.
pub struct Process<E> {
    pub address: SocketAddr,
    shutdown: CancellationToken,
    runtime: Option<Runtime>,
    ended: Option<tokio::sync::oneshot::Receiver<Result<(), E>>>,
}

/// A process that hangs.
pub struct Hung(Arc<AtomicBool>);

impl Drop for Hung {
    fn drop(&mut self) {
        self.0.store(false, Ordering::SeqCst);
    }
}

impl<E: Send + 'static> Process<E> {
    pub fn start<F, Run>(address: Option<SocketAddr>, run: Run) -> Self
    where
        F: Future<Output = Result<(), E>> + Send + 'static,
        Run: FnOnce(TcpListener, CancellationToken) -> F,
    {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let address = address.unwrap_or_else(|| "127.0.0.1:0".parse().unwrap());
        let listener = std::net::TcpListener::bind(address).unwrap();
        listener.set_nonblocking(true).unwrap();
        let entered = runtime.enter();
        let listener = TcpListener::from_std(listener).unwrap();
        drop(entered);
        let address = listener.local_addr().unwrap();
        let shutdown = CancellationToken::new();
        let (done, ended) = tokio::sync::oneshot::channel();
        let running = run(listener, shutdown.clone());
        runtime.spawn(async move { done.send(running.await) });
        Self { address, shutdown, runtime: Some(runtime), ended: Some(ended) }
    }

    /// Kills it, like a crash: its connections break.
    pub fn kill(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }

    /// Stops it, like SIGSTOP, until the returned guard is dropped: its connections stay open, and the system accepts
    /// new ones.
    pub fn hang(&mut self) -> Hung {
        let hung = Hung(Arc::new(AtomicBool::new(true)));
        let still = hung.0.clone();
        // It has one thread.
        self.runtime.as_ref().unwrap().spawn(async move {
            while still.load(Ordering::SeqCst) {
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        hung
    }

    /// Asks it to end, and waits for its result.
    pub async fn stop(&mut self) -> Result<(), E> {
        self.shutdown.cancel();
        self.ended().await
    }

    /// Waits for its result.
    pub async fn ended(&mut self) -> Result<(), E> {
        let ended = self.ended.take().unwrap();
        tokio::time::timeout(LIMIT, ended).await.expect("it must end").unwrap()
    }

    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }
}

impl<E> Drop for Process<E> {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

pub type Worker = Process<worker::RunError>;
pub type Coordinator = Process<coordinator::ServeError>;

/// Ticks of 100 ms, so that demand is known and roles change within a second.
pub fn quick() -> coordinator::Config {
    coordinator::Config {
        core: core::Config {
            tick: Duration::from_millis(100),
            dwell: Duration::from_millis(300),
            report_interval: Duration::from_millis(25),
            lease: Duration::from_secs(3),
            ..core::Config::default()
        },
        ..coordinator::Config::default()
    }
}

pub fn start_coordinator(config: coordinator::Config) -> Coordinator {
    start_coordinator_at(config, None, Source { scene: scene("test"), files: Vec::new() })
}

pub fn start_coordinator_at(
    config: coordinator::Config,
    address: Option<SocketAddr>,
    source: Source,
) -> Coordinator {
    start_coordinator_of(config, address, source, Arc::new(LocalRegistry::alone()))
}

pub fn start_coordinator_of(
    config: coordinator::Config,
    address: Option<SocketAddr>,
    source: Source,
    registry: Arc<dyn Registry>,
) -> Coordinator {
    Process::start(address, |listener, shutdown| {
        coordinator::serve(config, listener, Arc::new(source), registry, shutdown)
    })
}

pub fn start_worker(coordinator: &str, settings: &Arc<Settings>) -> Worker {
    start_worker_with(worker::Config::new(coordinator), settings, Arc::new(Opener::default()))
}

pub fn start_worker_with(config: worker::Config, settings: &Arc<Settings>, opener: Arc<Opener>) -> Worker {
    start_worker_at(None, config, settings, opener)
}

pub fn start_worker_at(
    address: Option<SocketAddr>,
    config: worker::Config,
    settings: &Arc<Settings>,
    opener: Arc<Opener>,
) -> Worker {
    let factory = Arc::new(Factory { settings: settings.clone() });
    Process::start(address, |listener, shutdown| worker::run(config, listener, factory, opener, shutdown))
}

/// One coordinator and its workers.
pub struct Cluster {
    pub coordinator: Coordinator,
    pub workers: Vec<Worker>,
    pub settings: Arc<Settings>,
    pub channel: Channel,
}

impl Cluster {
    pub async fn start(workers: usize) -> Self {
        Self::start_with(quick(), workers).await
    }

    pub async fn start_with(config: coordinator::Config, count: usize) -> Self {
        let settings = Arc::new(Settings::default());
        let coordinator = start_coordinator(config);
        let workers = (0..count).map(|_| start_worker(&coordinator.url(), &settings)).collect();
        let channel = channel(&coordinator.url());
        let cluster = Self { coordinator, workers, settings, channel };
        cluster.wait_for(|status| status.processes as usize == count).await;
        cluster
    }

    /// Waits until every worker has measured what its views cost. From then on none measures.
    pub async fn priced(&self) {
        self.wait_for(|status| {
            status.workers.iter().all(|w| w.direct_cost.is_some() && w.warp_cost.is_some())
        })
        .await;
    }

    pub fn views(&self) -> ViewsClient<Channel> {
        ViewsClient::new(self.channel.clone())
    }

    pub async fn status(&self) -> v1::StatusResponse {
        let mut client = ClusterClient::new(self.channel.clone());
        client.status(v1::StatusRequest {}).await.unwrap().into_inner()
    }

    /// Waits until the cluster is in a state.
    pub async fn wait_for(&self, state: impl Fn(&v1::StatusResponse) -> bool) -> v1::StatusResponse {
        let reached = async {
            loop {
                let status = self.status().await;
                if state(&status) {
                    return status;
                }
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        match tokio::time::timeout(LIMIT, reached).await {
            Ok(status) => status,
            Err(_) => panic!("the state was never reached: {:#?}", self.status().await),
        }
    }

    pub async fn render(&self, view: &View) -> Result<(Frame, FrameMeta), Status> {
        render(self.views(), view, 0).await
    }

    /// The worker with that id.
    pub fn worker_at(&mut self, address: &str) -> &mut Worker {
        self.workers.iter_mut().find(|w| w.url() == address).unwrap()
    }
}

pub fn channel(url: &str) -> Channel {
    tonic::transport::Endpoint::from_shared(url.to_owned()).unwrap().tcp_nodelay(true).connect_lazy()
}

pub fn request(view: &View, deadline_ms: u32) -> v1::RenderRequest {
    v1::RenderRequest {
        view_id: "a view".to_owned(),
        view: Some(view.into()),
        deadline_ms,
        encoding: v1::Encoding::Raw as i32,
        order: None,
    }
}

pub async fn render(
    client: ViewsClient<Channel>,
    view: &View,
    deadline_ms: u32,
) -> Result<(Frame, FrameMeta), Status> {
    answer_to(client, request(view, deadline_ms)).await
}

/// The frame that answers a request.
pub async fn answer_to(
    mut client: ViewsClient<Channel>,
    request: v1::RenderRequest,
) -> Result<(Frame, FrameMeta), Status> {
    let answer = async {
        let mut chunks = client.render(request).await?.into_inner();
        let mut assembler = FrameAssembler::new(Limits::default());
        let mut frame = None;
        while let Some(chunk) = chunks.message().await? {
            if let Some(complete) = assembler.push(chunk).unwrap() {
                assert!(frame.replace(complete).is_none(), "two frames for one view");
            }
        }
        frame.ok_or_else(|| Status::data_loss("no frame"))
    };
    tokio::time::timeout(LIMIT, answer).await.expect("a view must be answered")
}

/// One of many viewpoints around the scene.
pub fn view(i: usize) -> View {
    let angle = i as f64 * 0.37;
    let eye = DVec3::new(20.0 * angle.cos(), 15.0, 20.0 * angle.sin());
    View::new(Camera::look_at(eye, DVec3::ZERO), [32, 24], PlanRequest::from_samples())
}

pub fn direct(i: usize) -> View {
    View { plan: PlanRequest { direct: true, ..PlanRequest::default() }, ..view(i) }
}

pub fn pinned(i: usize, pin: Provenance) -> View {
    View { pin: Some(pin), ..view(i) }
}

/// An authority like that of `argus certs`, which signs certificates.
pub struct Authority(rcgen::CertifiedIssuer<'static, rcgen::KeyPair>);

impl Authority {
    pub fn new() -> Self {
        let mut params = rcgen::CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Constrained(0));
        Self(rcgen::CertifiedIssuer::self_signed(params, rcgen::KeyPair::generate().unwrap()).unwrap())
    }

    pub fn pem(&self) -> String {
        self.0.pem()
    }

    /// Signs a certificate; returns it and its key.
    pub fn certify(&self, names: &[&str]) -> [String; 2] {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let pair = rcgen::KeyPair::generate().unwrap();
        let signed = rcgen::CertificateParams::new(names).unwrap().signed_by(&pair, &self.0).unwrap();
        [signed.pem(), pair.serialize_pem()]
    }
}
