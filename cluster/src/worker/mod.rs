//! The worker: joins a coordinator and renders what it is told to.
//!
//! `join` is its life with the coordinator, `views` and `samples` are the services it offers, `fetch` brings
//! the samples together that a view needs, `trace` the pixels that none of them saw, and `render` is the one thread that touches the two roles, fed by
//! `queue`. `store` holds the samples, `node` is what all of them share.

mod ahead;
mod claim;
mod config;
mod fetch;
mod join;
mod meter;
mod node;
mod queue;
mod render;
mod samples;
mod scene;
mod store;
mod trace;
mod views;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::FILE_DESCRIPTOR_SET;
use argus_proto::v1::samples_server::SamplesServer;
use argus_proto::v1::views_server::ViewsServer;
use argus_scene::RenderError;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;
use tonic::transport::server::TcpIncoming;
use tracing::{info, warn};

pub use config::{Config, RunError};

use self::meter::Meter;
use self::node::Node;
use self::queue::Queue;
use self::render::Renderer;
use self::store::Store;
use crate::core::Hello;
use crate::net;
use crate::{RoleFactory, SceneOpener};

/// Joins the coordinator and serves views and samples on `listener` until `shutdown` is cancelled, then says
/// that it leaves, finishes what it has, and returns. While the coordinator is away it keeps what it holds
/// and tries to join again.
///
/// # Errors
/// [`RunError::Unreachable`] if the coordinator does not answer within [`Config::join_timeout`] at the start;
/// [`RunError`] otherwise if the scene cannot be had or no role can be played on this machine.
pub async fn run(
    config: Config,
    listener: TcpListener,
    factory: Arc<dyn RoleFactory>,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let address = advertised(&config, listener.local_addr()?)?;
    let name =
        config.id.clone().unwrap_or_else(|| format!("w-{:08x}", SmallRng::from_os_rng().random::<u32>()));
    let queue = Arc::new(Queue::new(&config));
    let store = Arc::new(Store::new(config.held_bytes));
    let meter = Arc::new(Meter::default());
    let (device, rendering) = start_rendering(factory, queue.clone(), store.clone(), meter.clone()).await?;
    info!(worker = name, address, device, "worker starts");
    let hello = Hello {
        name,
        pid: std::process::id(),
        address,
        device,
        cores: std::thread::available_parallelism().map_or(1, |n| n.get() as u32),
    };
    let grace = config.grace;
    let node = Node::new(config, hello, queue, store, meter);
    // A child: what fails here must not stop what else the caller's token stops.
    let result = serve_and_stay(&node, listener, opener, shutdown.child_token()).await;
    // A process that exits while its driver still renders, or gives a device up, may crash on its way out.
    node.stop();
    rendering.ended(grace).await;
    info!(worker = node.hello.name, "worker stopped");
    result
}

/// Serves until the stay with the coordinator ends, and while what is in work finishes.
async fn serve_and_stay(
    node: &Arc<Node>,
    listener: TcpListener,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<ViewsServer<views::ViewsService>>().await;
    health.set_serving::<SamplesServer<samples::SamplesService>>().await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;
    let closing = CancellationToken::new();
    let server = net::server()
        .add_service(ViewsServer::new(views::ViewsService { node: node.clone() }))
        .add_service(SamplesServer::new(samples::SamplesService { node: node.clone() }))
        .add_service(health_service)
        .add_service(reflection)
        .serve_with_incoming_shutdown(
            TcpIncoming::from(listener).with_nodelay(Some(true)),
            closing.clone().cancelled_owned(),
        );
    // The stay outlives the shutdown's beginning by the time that what is in work takes: until then the
    // coordinator hears that the worker leaves instead of losing it.
    let gone = CancellationToken::new();
    let stay = join::stay(node.clone(), opener, gone.clone());
    let leave = async {
        shutdown.cancelled().await;
        info!("worker drains");
        health.set_service_status("", tonic_health::ServingStatus::NotServing).await;
        node.leave();
        let idle = async {
            // Orders that were sent before the coordinator heard of it are still on their way.
            tokio::time::sleep(Duration::from_millis(50)).await;
            while !node.is_idle() {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        // What takes longer than the grace is done elsewhere.
        let _ = tokio::time::timeout(node.config.grace, idle).await;
        gone.cancel();
    };
    tokio::pin!(server);
    let left = async {
        let (stayed, ()) = tokio::join!(
            async {
                let stayed = stay.await;
                // A stay that failed has nothing to wait for.
                if stayed.is_err() {
                    shutdown.cancel();
                }
                stayed
            },
            leave
        );
        stayed
    };
    let result = tokio::select! {
        left = left => left,
        served = &mut server => return served.map_err(RunError::from),
    };
    closing.cancel();
    // Connections that others keep open do not keep the process.
    let _ = tokio::time::timeout(Duration::from_secs(1), server).await;
    result
}

/// The render thread, and the news of its end.
struct Rendering {
    thread: std::thread::JoinHandle<()>,
    ended: oneshot::Receiver<()>,
}

impl Rendering {
    /// Waits until the thread has given its roles up, at most so long.
    async fn ended(self, at_most: Duration) {
        match tokio::time::timeout(at_most, self.ended).await {
            // It has nothing left to do but to end. A panic there was logged when it happened.
            Ok(_) => drop(self.thread.join()),
            Err(_) => warn!("the render thread does not end; the process goes without it"),
        }
    }
}

/// Starts the render thread; with the device's name once its compositor is made.
async fn start_rendering(
    factory: Arc<dyn RoleFactory>,
    queue: Arc<Queue>,
    store: Arc<Store>,
    meter: Arc<Meter>,
) -> Result<(String, Rendering), RunError> {
    let (made, device) = oneshot::channel();
    let (running, ended) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("render".to_owned()).spawn(move || {
        // Dropped last, after all that the thread owns.
        let _running = running;
        // Nobody waits for the answer any more if the worker was stopped meanwhile.
        match Renderer::new(factory, queue, store, meter) {
            Err(error) => drop(made.send(Err(error))),
            Ok((renderer, device)) => {
                if made.send(Ok(device)).is_ok() {
                    renderer.run();
                }
            }
        }
    })?;
    let died = |_| Err(RenderError::Internal("the render thread died".to_owned()));
    let device = device.await.unwrap_or_else(died)?;
    Ok((device, Rendering { thread, ended }))
}

/// Where others reach this worker.
fn advertised(config: &Config, local: SocketAddr) -> Result<String, RunError> {
    let Some(address) = &config.advertise else {
        if local.ip().is_unspecified() {
            let reason = format!("listening on {local} says nothing of where that is; give --advertise");
            return Err(RunError::Address { what: "the listener's address", reason });
        }
        return Ok(format!("http://{local}"));
    };
    match net::endpoint(address, config.connect_timeout) {
        Ok(_) => Ok(address.clone()),
        Err(reason) => Err(RunError::Address { what: "the advertised address", reason }),
    }
}
