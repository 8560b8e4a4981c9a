//! The coordinator's configuration, and the errors of starting it.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::{
    Effects, Exposure, Indirect, InvalidField, LightRequest, ReflectionRequest, RigSettings, Sampling,
    Specification,
};
use serde::Serialize;

use crate::core;
use crate::network::Network;
use crate::security::ReloadableSecurity;

/// The coordinator's configuration. `Config::default()` can serve any scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// Configuration of the core.
    pub core: core::Config,
    /// Placement of sample cameras. Open settings are derived from the scene.
    pub rig: RigSettings,
    /// What samples are rendered from. The rig must have suitable cameras.
    pub sampling: Sampling,
    /// Sub-samples of each texel of a sample: 1, 4 or 16.
    pub sub_samples: u32,
    /// Light that the scene is to be opened in.
    pub light: LightRequest,
    /// Effects of direct light that samples have, as far as the scene calls for them.
    pub effects: Effects,
    /// Indirect light, and particles that emit light; `None`: by paths, if `effects` are automatic or all and the scene
    /// calls for it.
    pub indirect: Option<Indirect>,
    /// Exposure of all views.
    pub exposure: Exposure,
    /// Whether glossy and transparent surfaces reflect the scene, if it has such surfaces, and how that is found.
    pub reflections: ReflectionRequest,
    /// Scene seconds per second of an animated scene; 0 holds it still.
    pub time_scale: f64,
    /// Calibrated models. Models of other scenes or rigs are ignored.
    pub models: Vec<core::quality::Model>,
    /// The address at which other processes reach this coordinator, which standby coordinators tell to clients and
    /// workers; `None`: the listener's address.
    pub advertise: Option<String>,
    /// Time for requests in flight to finish after shutdown began.
    pub grace: Duration,
    /// Timeout of connecting to a worker.
    pub connect_timeout: Duration,
    /// Largest request of a client, bytes. The largest useful request, a view with a pinned plan, has some hundred.
    pub max_request_bytes: usize,
    /// Send timeout: a client that does not read a chunk within this time loses its frame or session. A chunk has at
    /// most 1 MiB. Until then the worker holds the frame. This process buffers one chunk and a window of 1 MiB, for
    /// which the connection to the worker has room beside all other views.
    pub read_within: Duration,
    /// Most open connections; further ones wait.
    pub max_connections: usize,
    /// TLS and tokens; `None`: plaintext without authentication.
    #[serde(skip)]
    pub security: Option<Arc<ReloadableSecurity>>,
    /// The network, which tests may simulate.
    #[serde(skip)]
    pub network: Network,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            core: core::Config::default(),
            rig: RigSettings::default(),
            sampling: Sampling::default(),
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            light: LightRequest::Auto,
            effects: Effects::None,
            indirect: Some(Indirect::Off),
            exposure: Exposure::Stops(0.0),
            reflections: ReflectionRequest::Off,
            time_scale: 1.0,
            models: Vec::new(),
            advertise: None,
            grace: Duration::from_secs(5),
            connect_timeout: Duration::from_secs(2),
            max_request_bytes: 1 << 20,
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
    /// No rig fits the scene.
    #[error("no sample camera can be placed: {0}")]
    Rig(#[from] InvalidField),
    /// There is no scene, or one has a name that cannot be.
    #[error("{0}")]
    Scene(InvalidField),
    /// The sampling options are invalid.
    #[error("samples cannot be taken: {0}")]
    Sampling(InvalidField),
    /// The time options are invalid.
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
