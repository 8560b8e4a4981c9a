//! Configuration of a worker, and the errors that stop it.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::RenderError;
use serde::Serialize;

use crate::network::Network;
use crate::security::ReloadableSecurity;

/// Suggested time until a retry at a full worker: a few batches.
pub(super) const RETRY: Duration = Duration::from_millis(250);

/// Configuration of a worker. [`Config::new`] sets the defaults.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// URL of the coordinator, such as `http://127.0.0.1:7400`. With several coordinators: their URLs, separated by
    /// commas.
    pub coordinator: String,
    /// URL by which other processes reach this worker. `None`: the listener's address with `http://`, or `https://`
    /// with security. If the listener's address is unspecified, such as `0.0.0.0`, the address of the network
    /// interface that reaches the coordinator replaces it.
    pub advertise: Option<String>,
    /// Address by which clients reach this worker. Sessions then fetch their frames here. `None`: the coordinator
    /// relays the frames.
    pub public: Option<Public>,
    /// Name of the worker; `None`: random. A worker that joins under a used name replaces the older process.
    pub id: Option<String>,
    /// Time limit of the coordinator's answer to a join.
    pub join_timeout: Duration,
    /// Time without any coordinator's answer at the start after which the process gives up. `None`: it tries forever.
    /// A supervisor that starts processes in any order would only restart it, with growing delays.
    pub give_up_after: Option<Duration>,
    /// Longest pause between two attempts to join.
    pub rejoin_pause: Duration,
    /// Greatest number of queued views. Further ones are refused at once.
    pub max_queued_views: usize,
    /// Greatest number of queued samples.
    pub max_queued_samples: usize,
    /// Greatest number of views in a batch. Above 64, a batch saves nothing and delays its first view.
    pub max_batch: usize,
    /// Greatest number of direct views in a call. Direct views are long, so more of them delay cancellation and other
    /// work.
    pub max_direct_batch: usize,
    /// Texel bytes of held samples. Beyond this, the least recently used samples are dropped, except those in use.
    pub held_bytes: u64,
    /// Time limit of connecting to another worker.
    pub connect_timeout: Duration,
    /// Time limit of each chunk of a sample from another worker.
    pub fetch_timeout: Duration,
    /// Time limit of another worker for tracing the holes of a view. Then the next worker is asked.
    pub trace_timeout: Duration,
    /// Largest scene bundle that is fetched, bytes.
    pub max_bundle_bytes: u64,
    /// Time that views in progress get after a shutdown began.
    pub grace: Duration,
    /// Time at one piece of work after which the render thread counts as wedged. The liveness check then fails, so
    /// that a supervisor restarts the process. It is long because a software driver may need minutes for the first
    /// sample of a large scene.
    pub wedged_after: Duration,
    /// Bytes reserved for frames that are rendered, packed or sent. Further views wait. A larger frame is rendered
    /// alone.
    pub frame_bytes: u64,
    /// Bytes of depth of sessions' last frames, for reprojection. Beyond this, the least recently used one is
    /// dropped; 0: none is kept.
    pub history_bytes: u64,
    /// Bytes of recent direct frames, from which other views are warped. Beyond this, the least recently used one is
    /// dropped; 0: none is kept.
    pub source_bytes: u64,
    /// Time limit for reading a chunk of a frame, at most 1 MiB. A slower reader loses the frame.
    pub read_within: Duration,
    /// Resources of an unused role are released after this time.
    pub rest_after: Duration,
    /// Greatest number of requests in progress, from the coordinator and from other workers. Requests that wait for
    /// samples count.
    pub max_requests: usize,
    /// Greatest number of open connections. Further ones wait.
    pub max_connections: usize,
    /// TLS configuration for the coordinator and other workers; `None`: plaintext.
    #[serde(skip)]
    pub security: Option<Arc<ReloadableSecurity>>,
    /// The network: real, or simulated in tests.
    #[serde(skip)]
    pub network: Network,
}

/// Address of a worker for clients.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Public {
    /// The same address as for other workers.
    AsAdvertised,
    /// Another address.
    At(String),
}

impl Config {
    /// The defaults, for a worker of this coordinator.
    pub fn new(coordinator: impl Into<String>) -> Self {
        Self {
            coordinator: coordinator.into(),
            advertise: None,
            public: None,
            id: None,
            join_timeout: Duration::from_secs(10),
            give_up_after: None,
            rejoin_pause: Duration::from_secs(2),
            max_queued_views: 256,
            max_queued_samples: 4096,
            max_batch: 64,
            max_direct_batch: 4,
            held_bytes: 2 << 30,
            connect_timeout: Duration::from_secs(2),
            fetch_timeout: Duration::from_secs(60),
            trace_timeout: Duration::from_secs(20),
            max_bundle_bytes: 8 << 30,
            grace: Duration::from_secs(5),
            wedged_after: Duration::from_secs(300),
            frame_bytes: 2 << 30,
            history_bytes: 256 << 20,
            source_bytes: 256 << 20,
            read_within: Duration::from_secs(20),
            rest_after: Duration::from_secs(30),
            max_requests: 2048,
            max_connections: 4096,
            security: None,
            network: Network::default(),
        }
    }
}

/// The error that stopped a worker.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No process answers at the coordinator's address.
    #[error(
        "no coordinator answers at {url} ({reason}); start one with `argus coordinator --scene SCENE`, \
         or give its address with --coordinator"
    )]
    Unreachable {
        /// URL of the coordinator.
        url: String,
        /// Error of the last attempt.
        reason: String,
    },
    /// A certificate is not trusted.
    #[error(
        "the coordinator at {url} and this worker do not trust each other ({reason}); give both certificates of \
         the cluster's authority"
    )]
    Untrusted {
        /// URL of the coordinator.
        url: String,
        /// Error of the handshake.
        reason: String,
    },
    /// The coordinator refused this worker.
    #[error("the coordinator at {url} refused this worker: {reason}")]
    TurnedAway {
        /// URL of the coordinator.
        url: String,
        /// The coordinator's reason.
        reason: String,
    },
    /// An invalid address.
    #[error("{what} is not a usable address: {reason}")]
    Address {
        /// The setting.
        what: &'static str,
        /// The reason.
        reason: String,
    },
    /// The scene cannot be opened.
    #[error("scene {name}: {reason}")]
    Scene {
        /// Name of the scene.
        name: String,
        /// The reason.
        reason: String,
    },
    /// No role can be created on this machine.
    #[error("this machine cannot render: {0}")]
    Device(#[from] RenderError),
    /// The server failed.
    #[error("the worker's server failed: {0}")]
    Server(#[from] tonic::transport::Error),
    /// The descriptors for reflection are malformed.
    #[error("reflection: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
    /// The listener or a thread failed.
    #[error("the operating system: {0}")]
    System(#[from] std::io::Error),
}
