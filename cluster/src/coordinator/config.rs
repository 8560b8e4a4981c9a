//! What a coordinator can be told, and why it may not start.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::{Indirect, InvalidField, Reflections, RigKnobs, Sampling, Specification};
use serde::Serialize;

use crate::core;
use crate::network::Network;
use crate::security::Security;

/// What a coordinator can be told; `Config::default()` serves any scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// How it decides.
    pub core: core::Config,
    /// Where sample cameras stand; what is left open follows from the scene.
    pub rig: RigKnobs,
    /// What samples are rendered from, for which the rig must have the cameras.
    pub sampling: Sampling,
    /// Sub-samples of each texel of a sample: 1, 4 or 16.
    pub sub_samples: u32,
    /// Light from surface to surface, and glowing particles.
    pub indirect: Indirect,
    /// What the maps are like that glossy and transparent surfaces look up, of a scene that has some; `None`: there are none.
    pub reflections: Option<Reflections>,
    /// Seconds that an animated scene moves on in a second; 0 holds it still.
    pub time_scale: f64,
    /// What calibration measured; those that speak of another scene or rig are passed over.
    pub models: Vec<core::quality::Model>,
    /// Where others reach it, told to whoever asks another one that stands by; `None`: where it listens.
    pub advertise: Option<String>,
    /// How long requests in work may take to finish after a shutdown began.
    pub grace: Duration,
    /// How long a connection to a worker may take.
    pub connect_timeout: Duration,
    /// Bytes of a client's request. The largest one that means anything, a view with a pinned plan, is some hundred.
    pub max_request_bytes: usize,
    /// A client that does not read a chunk of a frame, a MiB at most, for so long loses that frame, or its session. Until
    /// then its worker holds the frame, and this process what is on its way of it: that chunk and a window of a MiB, for
    /// which the connection to the worker has room beside those of all other views.
    pub read_within: Duration,
    /// Connections that are open at the same time; further ones wait.
    pub max_connections: usize,
    /// Who may ask and join; `None`: plaintext, and everybody.
    #[serde(skip)]
    pub security: Option<Arc<Security>>,
    /// What it talks over.
    #[serde(skip)]
    pub network: Network,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            core: core::Config::default(),
            rig: RigKnobs::default(),
            sampling: Sampling::default(),
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            indirect: Indirect::Off,
            reflections: None,
            time_scale: 1.0,
            models: Vec::new(),
            advertise: None,
            grace: Duration::from_secs(5),
            connect_timeout: Duration::from_secs(2),
            max_request_bytes: 256 << 10,
            read_within: Duration::from_secs(20),
            max_connections: 16384,
            security: None,
            network: Network::default(),
        }
    }
}

/// Why a coordinator does not serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// No rig can be placed around the scene.
    #[error("no sample camera can be placed: {0}")]
    Rig(#[from] InvalidField),
    /// Samples cannot be taken like this.
    #[error("samples cannot be taken: {0}")]
    Sampling(InvalidField),
    /// Time cannot pass like this.
    #[error("the scene cannot move: {0}")]
    Time(InvalidField),
    /// The server failed.
    #[error("the coordinator's server failed: {0}")]
    Server(#[from] tonic::transport::Error),
    /// The descriptors for reflection are malformed.
    #[error("reflection: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
    /// The listener has no address.
    #[error("the listener: {0}")]
    Listener(#[from] std::io::Error),
}
