//! Connections to a server.

use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use argus_proto::network::Network;
use argus_proto::transport::{replaceable, tuned};
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{CLUSTER_NAME, Description, PROTOCOL_VERSION, v1};
use argus_scene::InvalidField;
use tonic::Code;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};

use crate::credentials::{Bearer, Credentials};
use crate::error::root_cause;
use crate::{ClientError, ClusterStatus};

/// How long a connection to a worker may take, and as long again a handshake: the server relays what cannot be fetched, and
/// no frame shall be more than three seconds late for that.
const WORKER_TIMEOUT: Duration = Duration::from_millis(1200);

/// Connections to workers that are kept; beyond, all are made anew.
const MOST_WORKERS: usize = 1024;

/// How to connect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConnectOptions {
    /// HTTP/2 connections that requests take turns on, at least one. One carries any number of requests, but
    /// on one task and one congestion window, which is what limits a client of many large frames.
    pub connections: usize,
    /// For a connection to be made and the server to describe itself.
    pub timeout: Duration,
    /// For `https://`.
    pub credentials: Credentials,
    /// The machine's, or one that a test simulates.
    pub network: Network,
}

impl Default for ConnectOptions {
    fn default() -> Self {
        let (credentials, network) = (Credentials::default(), Network::default());
        Self { connections: 1, timeout: Duration::from_secs(5), credentials, network }
    }
}

/// Whom a connection is made to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Peer {
    /// A server that is alone.
    Only,
    /// One of several servers.
    OneOfSeveral,
    /// A worker, by the cluster's own name.
    Worker,
}

/// A connected client. Cloning is cheap and shares the connections, which are made anew when they break.
#[derive(Debug, Clone)]
pub struct Client(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    /// Of each server, the connections to it.
    servers: Vec<Vec<Channel>>,
    /// The server that is asked.
    server: AtomicUsize,
    bearer: Bearer,
    turn: AtomicUsize,
    description: Description,
    options: ConnectOptions,
    /// Whether the servers have shown certificates.
    secured: bool,
    /// Connections to workers that sessions were sent to, by address.
    workers: Mutex<HashMap<String, Channel>>,
    /// Makes view ids unique among clients.
    identity: u64,
    views: AtomicU64,
}

impl Client {
    /// Connects to a server such as `http://127.0.0.1:7400` and checks that it speaks our version. Of several, with
    /// commas between them, one leads: requests that another turns away go to the next.
    ///
    /// # Errors
    /// [`ClientError::Address`], [`ClientError::NobodyListens`], [`ClientError::Untrusted`],
    /// [`ClientError::Refused`], [`ClientError::NotArgus`] or [`ClientError::Version`].
    pub async fn connect(url: &str) -> Result<Self, ClientError> {
        Self::connect_with(url, &ConnectOptions::default()).await
    }

    /// [`Client::connect`] with several connections or another timeout.
    ///
    /// # Errors
    /// As [`Client::connect`].
    pub async fn connect_with(url: &str, options: &ConnectOptions) -> Result<Self, ClientError> {
        let nobody = |reason: String| ClientError::NobodyListens { url: url.to_owned(), reason };
        let connecting = async {
            let urls: Vec<&str> = url.split(',').map(str::trim).collect();
            let peer = if urls.len() > 1 { Peer::OneOfSeveral } else { Peer::Only };
            let endpoints = urls.iter().map(|url| endpoint(url, options, peer));
            let endpoints = endpoints.collect::<Result<Vec<Endpoint>, _>>()?;
            let bearer = Bearer(options.credentials.token.clone());
            // The first that answers will do for a description; the others are connected to when they are needed.
            let mut first = None;
            for (at, (endpoint, url)) in endpoints.iter().zip(&urls).enumerate() {
                let described =
                    async { describe(&connected(endpoint, url, options).await?, &bearer, url).await };
                // One that says nothing leaves time for the others.
                let share = options.timeout / urls.len() as u32;
                let late = || nobody(format!("nothing came within {} ms", share.as_millis()));
                match tokio::time::timeout(share, described).await.unwrap_or_else(|_| Err(late())) {
                    Ok(description) => {
                        first = Some(Ok((at, description)));
                        break;
                    }
                    Err(error) => first = first.or(Some(Err(error))),
                }
            }
            let (server, description) =
                first.unwrap_or_else(|| Err(nobody("no address is given".to_owned())))?;
            let lazily = |endpoint: &Endpoint| {
                (0..options.connections.max(1)).map(|_| options.network.channel(endpoint)).collect()
            };
            let servers = endpoints.iter().map(lazily).collect();
            let (server, turn, views) = (AtomicUsize::new(server), AtomicUsize::new(0), AtomicU64::new(0));
            // The one source of randomness in the standard library.
            let identity = RandomState::new().hash_one(std::process::id());
            let (options, workers) = (options.clone(), Mutex::default());
            let secured = urls.iter().any(|url| is_secured(url));
            Ok(Self(Arc::new(Shared {
                servers,
                server,
                bearer,
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
            Err(_) => Err(nobody(format!("nothing came within {} ms", options.timeout.as_millis()))),
        }
    }

    /// What the server said of itself when this client connected.
    pub fn description(&self) -> &Description {
        &self.0.description
    }

    /// What the server says of itself now.
    ///
    /// # Errors
    /// [`ClientError::Server`] if it cannot be reached, [`ClientError::Version`] if it has been replaced.
    pub async fn describe(&self) -> Result<Description, ClientError> {
        describe(&self.channel(), &self.0.bearer, "the server").await
    }

    /// Workers, their roles, and the balance between them.
    ///
    /// # Errors
    /// [`ClientError::Refused`] if this client's token has not the role admin, [`ClientError::Server`] if the server
    /// cannot be reached or is no coordinator.
    pub async fn status(&self) -> Result<ClusterStatus, ClientError> {
        let mut cluster = ClusterClient::with_interceptor(self.channel(), self.0.bearer.clone());
        let response = cluster.status(v1::StatusRequest {}).await?;
        Ok(response.into_inner().into())
    }

    /// The service for rendering, on the connection whose turn it is.
    pub(crate) fn views(&self) -> ViewsClient<InterceptedService<Channel, Bearer>> {
        ViewsClient::with_interceptor(self.channel(), self.0.bearer.clone())
    }

    /// The service for rendering at a worker that the server sent this client to. No token goes there: a ticket is shown.
    ///
    /// # Errors
    /// [`ClientError::Address`] where that is none, or one without TLS though the server has it.
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
                let options = ConnectOptions { connections: 1, timeout, credentials, network };
                let channel = options.network.channel(&endpoint(address, &options, Peer::Worker)?);
                if workers.len() >= MOST_WORKERS {
                    workers.clear();
                }
                workers.entry(address.to_owned()).or_insert(channel).clone()
            }
        };
        Ok(ViewsClient::new(channel))
    }

    /// A view id that no other request of any client has.
    pub(crate) fn new_view_id(&self) -> String {
        format!("{:016x}-{}", self.0.identity, self.0.views.fetch_add(1, Ordering::Relaxed))
    }

    /// A number from 0 to 1, another one each time.
    pub(crate) fn random(&self) -> f64 {
        f64::from((RandomState::new().hash_one(self.0.identity) >> 32) as u32) / f64::from(u32::MAX)
    }

    fn channel(&self) -> Channel {
        let channels = &self.0.servers[self.0.server.load(Ordering::Relaxed) % self.0.servers.len()];
        let turn = self.0.turn.fetch_add(1, Ordering::Relaxed);
        channels[turn % channels.len()].clone()
    }

    /// Which server is asked now, to be said to [`Client::try_another`] if it does not answer.
    pub(crate) fn server(&self) -> usize {
        self.0.server.load(Ordering::Relaxed)
    }

    /// Asks the next server from now on, unless that happened since `tried` was asked.
    pub(crate) fn try_another(&self, tried: usize) {
        let (next, order) = (tried.wrapping_add(1), Ordering::Relaxed);
        // Whoever was first has done it for all.
        let _ = self.0.server.compare_exchange(tried, next, order, order);
    }
}

/// Whether an address is one by TLS; schemes have no case.
fn is_secured(url: &str) -> bool {
    url.get(..8).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https://"))
}

/// A connection to whatever listens there.
pub(crate) async fn channel(url: &str, options: &ConnectOptions) -> Result<Channel, ClientError> {
    connected(&endpoint(url, options, Peer::Only)?, url, options).await
}

async fn connected(endpoint: &Endpoint, url: &str, options: &ConnectOptions) -> Result<Channel, ClientError> {
    let connected = options.network.connect(endpoint).await;
    connected.map_err(|error| unconnected(url, root_cause(&error)))
}

fn endpoint(url: &str, options: &ConnectOptions, peer: Peer) -> Result<Endpoint, ClientError> {
    let ConnectOptions { timeout, credentials, .. } = options;
    // What hangs is left for another one the sooner where there is one.
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
            // Workers come and go at addresses that nobody could list in their certificates. Each has the cluster's name
            // instead, and that is enough: which worker makes a frame is the coordinator's choice, whose word for the
            // address came over a connection that was checked by its host's name; every member may make every frame, so
            // that one in another's place gains nothing; clients' certificates lack the name; and what is shown there is
            // a ticket and never a token.
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

/// Why there is no connection: the transport keeps nothing but words.
fn unconnected(url: &str, reason: String) -> ClientError {
    let url = url.to_owned();
    match ["certificate", "fatal alert", "corrupt message"].iter().any(|word| reason.contains(word)) {
        true => ClientError::Untrusted { url, reason },
        false => ClientError::NobodyListens { url, reason },
    }
}

async fn describe(channel: &Channel, bearer: &Bearer, url: &str) -> Result<Description, ClientError> {
    let not_argus = |reason: String| ClientError::NotArgus { url: url.to_owned(), reason };
    let request = v1::DescribeRequest { protocol_version: PROTOCOL_VERSION };
    let response =
        match ViewsClient::with_interceptor(channel.clone(), bearer.clone()).describe(request).await {
            Ok(response) => response.into_inner(),
            Err(status) if status.code() == Code::Unimplemented => {
                return Err(not_argus("it has no service argus.v1.Views".to_owned()));
            }
            // A connection that opens and then breaks at the first request speaks something else than HTTP/2.
            Err(status) => match ClientError::from(status) {
                ClientError::Server { broken: true, message, .. } => {
                    // A server that wants this client's certificate says so after the handshake, and what it says may be
                    // lost with the connection. By then it has shown a certificate itself, so that it is no stranger.
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
