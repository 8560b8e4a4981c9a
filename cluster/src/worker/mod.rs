//! The worker: joins a coordinator, and renders what the coordinator orders.
//!
//! `join` holds the connection to the coordinator. `views` and `samples` are the gRPC services. `fetch` gets the
//! samples of a view, and `trace` the pixels that no sample saw. `render` is the render thread, which alone calls the
//! two roles; `queue` feeds it in the order of [`policy`]. `store` holds samples, `sources` direct frames that
//! other views are warped from; `purchase` renders those that are ordered. `node` is the state that all of these share.

mod cells;
mod claim;
mod config;
mod effect_meter;
mod fetch;
mod fetches;
mod frame_memory;
mod from_sources;
mod health;
mod histories;
mod join;
mod measured_error;
mod meter;
mod node;
mod order;
mod packed;
pub mod policy;
mod prefetch;
mod prefetches;
mod probe;
mod probes;
mod purchase;
mod purchases;
mod queue;
mod render;
mod samples;
mod scene;
mod slices;
mod sources;
mod store;
mod trace;
mod transforms;
mod view_costs;
mod views;
mod warm;
mod watch;

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use argus_proto::FILE_DESCRIPTOR_SET;
use argus_proto::v1::samples_server::SamplesServer;
use argus_proto::v1::views_server::ViewsServer;
use argus_scene::RenderError;
use prometheus_client::registry::Registry;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;
use tonic::codegen::http::Uri;
use tonic::server::NamedService;
use tonic::service::Routes;
use tracing::{info, warn};

pub use config::{Config, Public, RunError};
#[cfg(feature = "fuzzing")]
pub(crate) use join::checked_assignment;

use self::health::Health;
use self::meter::Meter;
use self::node::Node;
use self::queue::Queue;
use self::render::Renderer;
use self::store::Store;
use crate::core::Hello;
use crate::incoming::incoming;
use crate::net;
use crate::network::Accept;
use crate::observe::{PREFIX, keep_health, with_pages};
use crate::security::guard::Guarded;
use crate::security::handshake::secured;
use crate::{RoleFactory, SceneOpener};

/// How long an order of the coordinator may be in flight when the worker leaves.
const ORDERS_ON_THE_WAY: Duration = Duration::from_millis(50);
/// How long a client may take to redeem a ticket when the worker leaves.
const TICKETS_ON_THE_WAY: Duration = Duration::from_millis(500);

/// Largest request for a view, bytes. An order lists samples and their addresses.
const MOST_ORDER_BYTES: usize = 2 << 20;

/// Joins the coordinator, and serves views and samples on `listener`, until `shutdown` is cancelled. Then it tells
/// the coordinator that it leaves, finishes its requests, and returns. If it loses the coordinator, it keeps its
/// samples and tries to join again.
///
/// # Errors
/// [`RunError::Unreachable`] if no coordinator answers within [`Config::give_up_after`] of the start; [`RunError`] if
/// the scene cannot be opened or no role can be created on this machine.
pub async fn run(
    config: Config,
    listener: impl Accept,
    factory: Arc<dyn RoleFactory>,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let address = advertised(&config, listener.local_addr()?).await?;
    if let Some(Public::At(public)) = &config.public {
        check_address("the public address", public, &config)?;
    }
    let name =
        config.id.clone().unwrap_or_else(|| format!("w-{:08x}", SmallRng::from_os_rng().random::<u32>()));
    let queue = Arc::new(Queue::new(&config));
    let store = Arc::new(Store::new(config.held_bytes));
    let meter = Arc::new(Meter::default());
    let health = Arc::new(Health::default());
    let rest_after = config.rest_after;
    let made = {
        let (queue, store, meter, health) = (queue.clone(), store.clone(), meter.clone(), health.clone());
        move || Renderer::new(factory, queue, store, meter, health, rest_after)
    };
    let (device, rendering) = start_rendering(made).await?;
    info!(worker = name, address, device, "worker starts");
    let public_address = config.public.as_ref().map(|public| match public {
        Public::AsAdvertised => address.clone(),
        Public::At(address) => address.clone(),
    });
    let hello = Hello {
        name,
        pid: std::process::id(),
        address,
        public_address,
        device,
        cores: std::thread::available_parallelism().map_or(1, |n| n.get() as u32),
    };
    let grace = config.grace;
    let node = Node::new(config, hello, queue, store, meter, health);
    // A child token: a failure here must not stop the caller's other tasks.
    let result = serve_and_stay(&node, listener, opener, shutdown.child_token()).await;
    // A process may crash if it exits while the driver renders or frees a device.
    node.render_thread.stop();
    rendering.ended(grace).await;
    info!(worker = node.hello.name, "worker stopped");
    result
}

/// Serves until the worker has left its coordinator and finished its requests.
async fn serve_and_stay(
    node: &Arc<Node>,
    listener: impl Accept,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let (health, health_service) = tonic_health::server::health_reporter();
    let watch = Arc::new(watch::Watch(node.clone()));
    let offered = [ViewsServer::<views::ViewsService>::NAME, SamplesServer::<samples::SamplesService>::NAME];
    let kept = keep_health(watch.clone(), health, &offered).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;
    let closing = CancellationToken::new();
    let views = ViewsServer::new(views::ViewsService { node: node.clone() });
    let services = Routes::new(views.max_decoding_message_size(MOST_ORDER_BYTES))
        .add_service(SamplesServer::new(samples::SamplesService { node: node.clone() }))
        .add_service(health_service.max_decoding_message_size(net::MOST_QUESTION_BYTES))
        .add_service(reflection.max_decoding_message_size(net::MOST_QUESTION_BYTES));
    let security = &node.config.security;
    let connections = secured(incoming(listener, node.config.max_connections), security.clone());
    let server = net::server(Guarded::Worker, security.as_ref())
        .add_routes(with_pages(services, watch, Registry::with_prefix(PREFIX)))
        .serve_with_incoming_shutdown(connections, closing.clone().cancelled_owned());
    // The connection to the coordinator outlives the shutdown's start by the time that the requests take. So the
    // coordinator hears that the worker leaves, instead of losing it.
    let gone = CancellationToken::new();
    let stay = join::stay(node.clone(), opener, gone.clone());
    let leave = async {
        shutdown.cancelled().await;
        info!("worker drains");
        node.status.leave();
        let idle = async {
            // Orders may be in flight that were sent before the coordinator knew. Redirected clients take longer.
            let on_the_way =
                if node.redirects.are_accepted() { TICKETS_ON_THE_WAY } else { ORDERS_ON_THE_WAY };
            tokio::time::sleep(on_the_way).await;
            while node.requests() > 0 {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        // Other workers answer the requests that exceed the grace.
        let _ = tokio::time::timeout(node.config.grace, idle).await;
        gone.cancel();
    };
    tokio::pin!(server);
    let left = async {
        let (stayed, ()) = tokio::join!(
            async {
                let stayed = stay.await;
                // A failed connection ends the wait for a shutdown.
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
        // The health task never ends.
        () = kept => Ok(()),
    };
    closing.cancel();
    // Open connections of other processes do not keep this one alive.
    let _ = tokio::time::timeout(Duration::from_secs(1), server).await;
    result
}

/// The render thread, and a channel that closes when it ends.
struct Rendering {
    thread: std::thread::JoinHandle<()>,
    ended: oneshot::Receiver<()>,
}

impl Rendering {
    /// Waits until the thread has dropped its roles, at most this long.
    async fn ended(self, at_most: Duration) {
        match tokio::time::timeout(at_most, self.ended).await {
            // The thread only has to return. If it panicked, that was logged.
            Ok(_) => drop(self.thread.join()),
            Err(_) => warn!("the render thread has not ended in time; the process exits without it"),
        }
    }
}

/// Starts the render thread. Returns the device's name once the compositor is made.
async fn start_rendering(
    make: impl FnOnce() -> Result<(Renderer, String), RenderError> + Send + 'static,
) -> Result<(String, Rendering), RunError> {
    let (made, device) = oneshot::channel();
    let (running, ended) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("render".to_owned()).spawn(move || {
        // Dropped last, after everything that the thread owns.
        let _running = running;
        // The receiver is gone if the worker was stopped meanwhile.
        match make() {
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

/// This machine's address on the network interface that reaches a coordinator. Other processes on that network reach
/// the worker by it.
async fn outgoing(coordinator: &str) -> Result<IpAddr, RunError> {
    let address = |reason: String| {
        let reason =
            format!("{reason}; set --advertise to the address by which other processes reach this worker");
        RunError::Address { what: "an unspecified address", reason }
    };
    let uri: Uri = coordinator.parse().map_err(|_| address(format!("{coordinator} is not a URL")))?;
    let host = uri.host().unwrap_or_default().trim_matches(['[', ']']);
    let port = uri.port_u16().unwrap_or(80);
    let found = tokio::net::lookup_host((host, port)).await;
    let found = found.map_err(|error| address(format!("{host} cannot be resolved ({error})")))?;
    // Connecting a UDP socket sends nothing: the operating system only chooses the interface.
    let chosen = found.map(|remote| {
        let any: IpAddr = match remote {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = UdpSocket::bind((any, 0))?;
        socket.connect(remote)?;
        socket.local_addr()
    });
    let chosen = chosen.reduce(|first, other| first.or(other));
    match chosen {
        Some(Ok(address)) => Ok(address.ip()),
        Some(Err(error)) => Err(address(format!("there is no route to {host} ({error})"))),
        None => Err(address(format!("{host} has no address"))),
    }
}

/// This machine's address on the interface that reaches a coordinator: the first reachable one of a list, separated
/// by commas.
async fn outgoing_to_any(coordinators: &str) -> Result<IpAddr, RunError> {
    let mut found = None;
    for url in coordinators.split(',') {
        match outgoing(url.trim()).await {
            Ok(address) => return Ok(address),
            error => found = found.or(Some(error)),
        }
    }
    found.unwrap_or_else(|| {
        Err(RunError::Address { what: "the coordinator", reason: "none is given".to_owned() })
    })
}

/// The address by which other processes reach this worker.
async fn advertised(config: &Config, local: SocketAddr) -> Result<String, RunError> {
    let Some(address) = &config.advertise else {
        let local = match local.ip().is_unspecified() {
            true => SocketAddr::new(outgoing_to_any(&config.coordinator).await?, local.port()),
            false => local,
        };
        return Ok(format!("{}://{local}", net::scheme(config.security.as_deref())));
    };
    check_address("the advertised address", address, config)?;
    Ok(address.clone())
}

/// Checks that an address is a valid URL.
fn check_address(what: &'static str, address: &str, config: &Config) -> Result<(), RunError> {
    let security = config.security.as_ref().map(|security| security.current());
    let endpoint = net::endpoint(address, config.connect_timeout, security.as_deref());
    endpoint.map(drop).map_err(|reason| RunError::Address { what, reason })
}
