//! Connections to servers and workers.

use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use argus_proto::convert::WireEnum as _;
use argus_proto::network::Network;
use argus_proto::transport::{replaceable, tuned};
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{CLUSTER_NAME, Description, PROTOCOL_VERSION, v1};
use argus_scene::{InvalidField, Output};
use tonic::Code;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};

use crate::ClientError;
use crate::credentials::{Credentials, RequestMetadata};
use crate::error::root_cause;

/// Time limit for a connection to a worker, and again for its handshake. The server relays frames that cannot be
/// fetched, and this may delay a frame by no more than three seconds.
const WORKER_TIMEOUT: Duration = Duration::from_millis(1200);

/// Connections to workers that are kept. When there are more, all are dropped and made anew.
const MOST_WORKERS: usize = 1024;

/// Options of a connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConnectOptions {
    /// HTTP/2 connections that requests use in turn, at least one. More connections help a client with many large
    /// frames: a single connection is limited by its one task and one congestion window.
    pub connections: usize,
    /// Time limit to connect and receive the server's description.
    pub timeout: Duration,
    /// Credentials for `https://`.
    pub credentials: Credentials,
    /// Name of the scene, of a service with several ([`Description::scenes`]); `None`: its first one.
    pub scene: Option<String>,
    /// The machine's network, or a simulated one.
    pub network: Network,
}

impl Default for ConnectOptions {
    fn default() -> Self {
        let (credentials, network) = (Credentials::default(), Network::default());
        Self { connections: 1, timeout: Duration::from_secs(5), credentials, scene: None, network }
    }
}

/// The kind of server to connect to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Peer {
    /// A single server.
    Only,
    /// One of several servers.
    OneOfSeveral,
    /// A worker, verified by the cluster's own name.
    Worker,
}

/// A connected client. Clones share its connections, which are restored when they break.
#[derive(Debug, Clone)]
pub struct Client(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    /// The connections to each server.
    servers: Vec<Vec<Channel>>,
    /// Index of the server in use.
    server: AtomicUsize,
    metadata: RequestMetadata,
    turn: AtomicUsize,
    description: Description,
    options: ConnectOptions,
    /// Whether the servers use TLS.
    secured: bool,
    /// Connections to workers of redirected sessions, by address.
    workers: Mutex<HashMap<String, Channel>>,
    /// Random number that makes this client's view ids unique.
    identity: u64,
    views: AtomicU64,
}

impl Client {
    /// Connects to a server such as `http://127.0.0.1:7400` and checks its protocol version. `url` may list several
    /// servers separated by commas: one of them leads, and requests that another rejects go to the next.
    ///
    /// # Errors
    /// [`ClientError::Address`], [`ClientError::Unreachable`], [`ClientError::Untrusted`],
    /// [`ClientError::Refused`], [`ClientError::NotArgus`] or [`ClientError::Version`].
    pub async fn connect(url: &str) -> Result<Self, ClientError> {
        Self::connect_with(url, &ConnectOptions::default()).await
    }

    /// Connects like [`Client::connect`], with options.
    ///
    /// # Errors
    /// Any error of [`Client::connect`]; [`ClientError::Invalid`] of the field `scene` if the service has no scene of that name.
    pub async fn connect_with(url: &str, options: &ConnectOptions) -> Result<Self, ClientError> {
        let unreachable = |reason: String| ClientError::Unreachable { url: url.to_owned(), reason };
        let connecting = async {
            let urls: Vec<&str> = url.split(',').map(str::trim).collect();
            let peer = if urls.len() > 1 { Peer::OneOfSeveral } else { Peer::Only };
            let endpoints = urls.iter().map(|url| endpoint(url, options, peer));
            let endpoints = endpoints.collect::<Result<Vec<Endpoint>, _>>()?;
            let metadata = metadata(&options.credentials, options.scene.as_deref())?;
            // The first server that answers gives the description. The rest are connected when needed.
            let mut first = None;
            for (at, (endpoint, url)) in endpoints.iter().zip(&urls).enumerate() {
                let described =
                    async { describe(&connected(endpoint, url, options).await?, &metadata, url).await };
                // A silent server leaves time for the next one.
                let share = options.timeout / urls.len() as u32;
                let late = || unreachable(format!("nothing came within {} ms", share.as_millis()));
                match tokio::time::timeout(share, described).await.unwrap_or_else(|_| Err(late())) {
                    Ok(description) => {
                        first = Some(Ok((at, description)));
                        break;
                    }
                    Err(error) => first = first.or(Some(Err(error))),
                }
            }
            let (server, description) =
                first.unwrap_or_else(|| Err(unreachable("no address is given".to_owned())))?;
            let lazily = |endpoint: &Endpoint| {
                (0..options.connections.max(1)).map(|_| options.network.channel(endpoint)).collect()
            };
            let servers = endpoints.iter().map(lazily).collect();
            let (server, turn, views) = (AtomicUsize::new(server), AtomicUsize::new(0), AtomicU64::new(0));
            // The standard library's only source of randomness.
            let identity = RandomState::new().hash_one(std::process::id());
            let (options, workers) = (options.clone(), Mutex::default());
            let secured = urls.iter().any(|url| is_secured(url));
            Ok(Self(Arc::new(Inner {
                servers,
                server,
                metadata,
                turn,
                description,
                options,
                secured,
                workers,
                identity,
                views,
            })))
        };
        match tokio::time::timeout(options.timeout, connecting).await {
            Ok(outcome) => outcome,
            Err(_) => Err(unreachable(format!("nothing came within {} ms", options.timeout.as_millis()))),
        }
    }

    /// A client for another scene of the same server ([`Description::scenes`]), over the same connections.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] of the field `scene` if the server has no scene of that name; else the errors of [`Client::describe`].
    pub async fn of_scene(&self, scene: &str) -> Result<Self, ClientError> {
        let inner = &self.0;
        let metadata = metadata(&inner.options.credentials, Some(scene))?;
        let description = describe(&self.channel(), &metadata, "the server").await?;
        Ok(Self(Arc::new(Inner {
            servers: inner.servers.clone(),
            server: AtomicUsize::new(self.server()),
            metadata,
            turn: AtomicUsize::new(0),
            description,
            options: ConnectOptions { scene: Some(scene.to_owned()), ..inner.options.clone() },
            secured: inner.secured,
            workers: Mutex::default(),
            identity: RandomState::new().hash_one(std::process::id()),
            views: AtomicU64::new(0),
        })))
    }

    /// The name of this client's scene; `None`: the server's first one.
    pub fn scene(&self) -> Option<&str> {
        self.0.options.scene.as_deref()
    }

    /// The server's description when this client connected.
    pub fn description(&self) -> &Description {
        &self.0.description
    }

    /// Requests the server's current description.
    ///
    /// # Errors
    /// [`ClientError::Server`] if it cannot be reached, [`ClientError::Version`] if another release replaced it.
    pub async fn describe(&self) -> Result<Description, ClientError> {
        describe(&self.channel(), &self.0.metadata, "the server").await
    }

    /// Requests the names of the scene's instances ([`Output::Instance`]) or materials ([`Output::Material`]), in the order of
    /// their ids.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] for another output; else the errors of [`Client::describe`].
    pub async fn names(&self, output: Output) -> Result<Vec<String>, ClientError> {
        let (mut names, mut views) = (Vec::new(), self.views());
        loop {
            let first = u32::try_from(names.len()).unwrap_or(u32::MAX);
            let part = views
                .names(v1::NamesRequest { output: output.number(), first, nodes: false })
                .await?
                .into_inner();
            let is_last = part.names.is_empty();
            names.extend(part.names);
            if is_last || names.len() >= part.total as usize {
                return Ok(names);
            }
        }
    }

    /// Requests the workers, their roles, and the balance between them.
    ///
    /// # Errors
    /// [`ClientError::Refused`] if this client's token lacks the role admin. [`ClientError::Server`] if the
    /// server cannot be
    /// reached or is not a coordinator.
    pub async fn status(&self) -> Result<v1::StatusResponse, ClientError> {
        let mut cluster = ClusterClient::with_interceptor(self.channel(), self.0.metadata.clone());
        let response = cluster.status(v1::StatusRequest {}).await?;
        Ok(response.into_inner())
    }

    /// The `Views` service, on the next connection in turn.
    pub(crate) fn views(&self) -> ViewsClient<InterceptedService<Channel, RequestMetadata>> {
        ViewsClient::with_interceptor(self.channel(), self.0.metadata.clone())
    }

    /// The `Views` service of a worker to which the server redirected this client. It is sent a ticket but no token.
    ///
    /// # Errors
    /// [`ClientError::Address`] if it is not an address, or lacks TLS while the server uses it.
    pub(crate) fn worker(&self, address: &str) -> Result<ViewsClient<Channel>, ClientError> {
        if self.0.secured && !is_secured(address) {
            let reason = "a server by https:// sent this client there".to_owned();
            return Err(ClientError::Address { url: address.to_owned(), reason });
        }
        let mut workers = self.0.workers.lock().unwrap_or_else(PoisonError::into_inner);
        let channel = match workers.get(address) {
            Some(channel) => channel.clone(),
            None => {
                let credentials = Credentials { token: None, ..self.0.options.credentials.clone() };
                let timeout = self.0.options.timeout.min(WORKER_TIMEOUT);
                let network = self.0.options.network.clone();
                let options = ConnectOptions { connections: 1, timeout, credentials, scene: None, network };
                let channel = options.network.channel(&endpoint(address, &options, Peer::Worker)?);
                if workers.len() >= MOST_WORKERS {
                    workers.clear();
                }
                workers.entry(address.to_owned()).or_insert(channel).clone()
            }
        };
        Ok(ViewsClient::new(channel))
    }

    /// A view id that is unique among all clients.
    pub(crate) fn new_view_id(&self) -> String {
        format!("{:016x}-{}", self.0.identity, self.0.views.fetch_add(1, Ordering::Relaxed))
    }

    /// A new random number in 0–1.
    pub(crate) fn random(&self) -> f64 {
        f64::from((RandomState::new().hash_one(self.0.identity) >> 32) as u32) / f64::from(u32::MAX)
    }

    fn channel(&self) -> Channel {
        let channels = &self.0.servers[self.0.server.load(Ordering::Relaxed) % self.0.servers.len()];
        let turn = self.0.turn.fetch_add(1, Ordering::Relaxed);
        channels[turn % channels.len()].clone()
    }

    /// Index of the server in use; pass it to [`Client::try_another`] if it does not answer.
    pub(crate) fn server(&self) -> usize {
        self.0.server.load(Ordering::Relaxed)
    }

    /// Switches to the next server, unless another request has already switched away from `tried`.
    pub(crate) fn try_another(&self, tried: usize) {
        let (next, order) = (tried.wrapping_add(1), Ordering::Relaxed);
        // If another request was first, there is nothing to do.
        let _ = self.0.server.compare_exchange(tried, next, order, order);
    }
}

/// The metadata of requests with these credentials, of this scene.
fn metadata(credentials: &Credentials, scene: Option<&str>) -> Result<RequestMetadata, ClientError> {
    let metadata = RequestMetadata::new(credentials.token.clone(), scene);
    metadata.map_err(|at| ClientError::Invalid { field: at.field.to_owned(), reason: at.reason })
}

/// Whether an address uses TLS. The scheme's case does not matter.
fn is_secured(url: &str) -> bool {
    url.get(..8).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https://"))
}

/// Connects to a server.
pub(crate) async fn channel(url: &str, options: &ConnectOptions) -> Result<Channel, ClientError> {
    connected(&endpoint(url, options, Peer::Only)?, url, options).await
}

async fn connected(endpoint: &Endpoint, url: &str, options: &ConnectOptions) -> Result<Channel, ClientError> {
    let connected = options.network.connect(endpoint).await;
    connected.map_err(|error| unconnected(url, root_cause(&error)))
}

fn endpoint(url: &str, options: &ConnectOptions, peer: Peer) -> Result<Endpoint, ClientError> {
    let ConnectOptions { timeout, credentials, .. } = options;
    // If the server can be replaced, a hung connection is detected sooner.
    let tuned = if peer == Peer::Only { tuned } else { replaceable };
    let address = |reason: &str| ClientError::Address { url: url.to_owned(), reason: reason.to_owned() };
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|error| address(&root_cause(&error)))?;
    match endpoint.uri().scheme_str() {
        Some("http") if credentials.token.is_some() => {
            return Err(address("a token is sent over https:// only"));
        }
        Some("http") => {}
        Some("https") if credentials.ca.is_none() => {
            return Err(address(
                "https:// needs the authority that signed the server's certificate, by --ca",
            ));
        }
        Some("https") => {
            let tls = credentials.tls(*timeout);
            // Workers' addresses change and cannot be listed in certificates, so workers are verified by the
            // cluster's name. That is enough: the coordinator, whose host name was verified, sent the worker's
            // address. Every worker may render every frame, clients' certificates lack the name, and a worker
            // receives a ticket but never a token.
            let tls = if peer == Peer::Worker { tls.domain_name(CLUSTER_NAME) } else { tls };
            return match endpoint.tls_config(tls) {
                Ok(endpoint) => Ok(tuned(endpoint.connect_timeout(*timeout))),
                Err(error) => Err(address(&format!("its certificates: {}", root_cause(&error)))),
            };
        }
        Some(scheme) => return Err(address(&format!("{scheme}:// is not supported"))),
        None => return Err(address("http:// is missing")),
    }
    Ok(tuned(endpoint.connect_timeout(*timeout)))
}

/// Why there is no connection: a failed handshake or no answer. The transport reports the reason as text only.
fn unconnected(url: &str, reason: String) -> ClientError {
    let url = url.to_owned();
    match ["certificate", "fatal alert", "corrupt message"].iter().any(|word| reason.contains(word)) {
        true => ClientError::Untrusted { url, reason },
        false => ClientError::Unreachable { url, reason },
    }
}

async fn describe(
    channel: &Channel,
    metadata: &RequestMetadata,
    url: &str,
) -> Result<Description, ClientError> {
    let not_argus = |reason: String| ClientError::NotArgus { url: url.to_owned(), reason };
    let request = v1::DescribeRequest { protocol_version: PROTOCOL_VERSION };
    let response =
        match ViewsClient::with_interceptor(channel.clone(), metadata.clone()).describe(request).await {
            Ok(response) => response.into_inner(),
            Err(status) if status.code() == Code::Unimplemented => {
                return Err(not_argus("it has no service argus.v1.Views".to_owned()));
            }
            // The connection opened and then broke at the first request: the server does not speak HTTP/2.
            Err(status) => match ClientError::from(status) {
                ClientError::Server { broken: true, message, .. } => {
                    // A server that requires a client certificate reports it after the handshake, and the report may
                    // be lost with the connection. It has then shown a certificate itself, so it is not an unknown
                    // server.
                    return Err(match unconnected(url, message.clone()) {
                        untrusted @ ClientError::Untrusted { .. } => untrusted,
                        _ if url.starts_with("https://") => {
                            ClientError::Untrusted { url: url.to_owned(), reason: message }
                        }
                        _ => not_argus(message),
                    });
                }
                error => return Err(error),
            },
        };
    if response.protocol_version != PROTOCOL_VERSION {
        return Err(ClientError::Version { url: url.to_owned(), theirs: response.protocol_version });
    }
    response.try_into().map_err(|error: InvalidField| not_argus(error.to_string()))
}
