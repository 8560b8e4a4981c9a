//! Connections to a server.

use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use argus_proto::transport::tuned;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{Description, PROTOCOL_VERSION, v1};
use argus_scene::InvalidField;
use tonic::Code;
use tonic::transport::{Channel, Endpoint};

use crate::error::root_cause;
use crate::{ClientError, ClusterStatus};

/// How to connect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConnectOptions {
    /// HTTP/2 connections that requests take turns on, at least one. One carries any number of requests, but
    /// on one task and one congestion window, which is what limits a client of many large frames.
    pub connections: usize,
    /// For a connection to be made and the server to describe itself.
    pub timeout: Duration,
}

impl Default for ConnectOptions {
    fn default() -> Self {
        Self { connections: 1, timeout: Duration::from_secs(5) }
    }
}

/// A connected client. Cloning is cheap and shares the connections, which are made anew when they break.
#[derive(Debug, Clone)]
pub struct Client(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    channels: Vec<Channel>,
    turn: AtomicUsize,
    description: Description,
    /// Makes view ids unique among clients.
    identity: u64,
    views: AtomicU64,
}

impl Client {
    /// Connects to a server such as `http://127.0.0.1:7400` and checks that it speaks our version.
    ///
    /// # Errors
    /// [`ClientError::Address`], [`ClientError::NobodyListens`], [`ClientError::NotArgus`] or
    /// [`ClientError::Version`].
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
            let endpoint = endpoint(url, options.timeout)?;
            let mut channels = Vec::new();
            for _ in 0..options.connections.max(1) {
                channels.push(endpoint.connect().await.map_err(|error| nobody(root_cause(&error)))?);
            }
            let description = describe(&channels[0], url).await?;
            let (turn, views) = (AtomicUsize::new(0), AtomicU64::new(0));
            // The one source of randomness in the standard library.
            let identity = RandomState::new().hash_one(std::process::id());
            Ok(Self(Arc::new(Shared { channels, turn, description, identity, views })))
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
        describe(&self.channel(), "the server").await
    }

    /// Workers, their roles, and the balance between them.
    ///
    /// # Errors
    /// [`ClientError::Server`] if the server cannot be reached or is no coordinator.
    pub async fn status(&self) -> Result<ClusterStatus, ClientError> {
        let response = ClusterClient::new(self.channel()).status(v1::StatusRequest {}).await?;
        Ok(response.into_inner().into())
    }

    /// The service for rendering, on the connection whose turn it is.
    pub(crate) fn views(&self) -> ViewsClient<Channel> {
        ViewsClient::new(self.channel())
    }

    /// A view id that no other request of any client has.
    pub(crate) fn new_view_id(&self) -> String {
        format!("{:016x}-{}", self.0.identity, self.0.views.fetch_add(1, Ordering::Relaxed))
    }

    fn channel(&self) -> Channel {
        let turn = self.0.turn.fetch_add(1, Ordering::Relaxed);
        self.0.channels[turn % self.0.channels.len()].clone()
    }
}

fn endpoint(url: &str, timeout: Duration) -> Result<Endpoint, ClientError> {
    let address = |reason: &str| ClientError::Address { url: url.to_owned(), reason: reason.to_owned() };
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|error| address(&root_cause(&error)))?;
    match endpoint.uri().scheme_str() {
        Some("http") => {}
        Some(scheme) => return Err(address(&format!("{scheme}:// is not supported"))),
        None => return Err(address("http:// is missing")),
    }
    Ok(tuned(endpoint.connect_timeout(timeout)))
}

async fn describe(channel: &Channel, url: &str) -> Result<Description, ClientError> {
    let not_argus = |reason: String| ClientError::NotArgus { url: url.to_owned(), reason };
    let request = v1::DescribeRequest { protocol_version: PROTOCOL_VERSION };
    let response = match ViewsClient::new(channel.clone()).describe(request).await {
        Ok(response) => response.into_inner(),
        Err(status) if status.code() == Code::Unimplemented => {
            return Err(not_argus("it has no service argus.v1.Views".to_owned()));
        }
        // A connection that opens and then breaks at the first request speaks something else than HTTP/2.
        Err(status) => match ClientError::from(status) {
            ClientError::Server { broken: true, message, .. } => return Err(not_argus(message)),
            error => return Err(error),
        },
    };
    if response.protocol_version != PROTOCOL_VERSION {
        return Err(ClientError::Version { url: url.to_owned(), theirs: response.protocol_version });
    }
    response.try_into().map_err(|error: InvalidField| not_argus(error.to_string()))
}
