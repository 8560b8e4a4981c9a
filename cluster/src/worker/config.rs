//! What a worker can be told, and why it may stop.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::RenderError;
use serde::Serialize;

use crate::network::Network;
use crate::security::Security;

/// When a full worker may have room again: a few batches later.
pub(super) const RETRY: Duration = Duration::from_millis(250);

/// What a worker can be told; only [`Config::new`]'s argument has no default.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// Where the coordinator is, such as `http://127.0.0.1:7400`; several, with commas between them, of which one leads.
    pub coordinator: String,
    /// Where others reach this worker; `None`: `http://` (`https://` with security) and the listener's address or, where
    /// that is an unspecified one such as `0.0.0.0`, the one that this machine has on the way to the coordinator.
    pub advertise: Option<String>,
    /// Where clients reach this worker, whose sessions then fetch their frames here; `None`: they do not.
    pub public: Option<Public>,
    /// Its name; `None`: drawn at random. The same name joining again replaces the older process.
    pub id: Option<String>,
    /// How long the coordinator may take to answer.
    pub join_timeout: Duration,
    /// How long nobody may answer at the start before the process gives up; `None`: it goes on trying, since whoever
    /// starts processes in no order would start it again for nothing, and later each time.
    pub give_up_after: Option<Duration>,
    /// Longest pause between two attempts to join again.
    pub rejoin_pause: Duration,
    /// Views that may wait for the render thread; one more is turned away at once.
    pub max_queued_views: usize,
    /// Samples that may wait for the render thread.
    pub max_queued_samples: usize,
    /// Most views in one batch; beyond 64 a batch gains nothing and makes its first view wait for its last.
    pub max_batch: usize,
    /// Most direct views in one call: each is long, so few keep cancellation and other work prompt.
    pub max_direct_batch: usize,
    /// Texel bytes of samples that are kept before the least recently used one is forgotten. Samples in use
    /// are kept whatever they take.
    pub held_bytes: u64,
    /// How long a connection to another worker may take.
    pub connect_timeout: Duration,
    /// How long another worker may be silent while it sends a sample.
    pub fetch_timeout: Duration,
    /// How long another worker may take to trace the pixels of a view that no sample saw; then the next one is
    /// asked.
    pub trace_timeout: Duration,
    /// The largest scene bundle that is fetched, bytes.
    pub max_bundle_bytes: u64,
    /// How long views in work may take to finish after a shutdown began.
    pub grace: Duration,
    /// A render thread that has been at one piece of work for this long is wedged, and the process says that it
    /// should be started again. Long: a software driver may take minutes over the first sample of a large scene.
    pub wedged_after: Duration,
    /// Bytes of frames that are being made, packed or sent; further views wait. One that is larger is made alone.
    pub frame_bytes: u64,
    /// Bytes of depth that frames of sessions leave for the next ones, before the least recently used is forgotten; 0: none is
    /// kept.
    pub history_bytes: u64,
    /// A chunk of a frame, a MiB at most, is dropped with the rest of it if it is not read for so long.
    pub read_within: Duration,
    /// Resources that only one role needs are released after they were unused for this long.
    pub rest_after: Duration,
    /// Requests in work, those included that wait for samples: what the coordinator sends, and what other workers fetch.
    pub max_requests: usize,
    /// Connections that are open at the same time; further ones wait.
    pub max_connections: usize,
    /// By which the coordinator and other workers know this one; `None`: plaintext.
    #[serde(skip)]
    pub security: Option<Arc<Security>>,
    /// What it talks over.
    #[serde(skip)]
    pub network: Network,
}

/// Where clients reach a worker.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Public {
    /// Where other workers do.
    AsAdvertised,
    /// At an address of its own.
    At(String),
}

impl Config {
    /// The defaults, for a worker of that coordinator.
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
            read_within: Duration::from_secs(20),
            rest_after: Duration::from_secs(30),
            max_requests: 2048,
            max_connections: 4096,
            security: None,
            network: Network::default(),
        }
    }
}

/// Why a worker stopped.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No process answers at the coordinator's address.
    #[error(
        "no coordinator answers at {url} ({reason}); start one with `argus coordinator --scene SCENE`, \
         or give its address with --coordinator"
    )]
    Unreachable {
        /// Where it was looked for.
        url: String,
        /// What the last attempt said.
        reason: String,
    },
    /// Either side's certificate is not one that the other trusts.
    #[error(
        "the coordinator at {url} and this worker do not trust each other ({reason}): both need certificates of \
         the cluster's authority"
    )]
    Untrusted {
        /// Where it is.
        url: String,
        /// What the handshake said.
        reason: String,
    },
    /// The coordinator does not want this worker.
    #[error("the coordinator at {url} turned this worker away: {reason}")]
    TurnedAway {
        /// Where it is.
        url: String,
        /// What it said.
        reason: String,
    },
    /// An address that is none.
    #[error("{what} is not an address that others can reach: {reason}")]
    Address {
        /// Which setting.
        what: &'static str,
        /// Why.
        reason: String,
    },
    /// The scene could not be had.
    #[error("scene {name}: {reason}")]
    Scene {
        /// Which.
        name: String,
        /// Why.
        reason: String,
    },
    /// No role can be played on this machine.
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
