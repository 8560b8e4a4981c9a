//! What a coordinator can be told, and why it may not start.

use std::time::Duration;

use argus_scene::{InvalidField, RigKnobs};
use serde::Serialize;

use crate::core;

/// What a coordinator can be told; `Config::default()` serves any scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Config {
    /// How it decides.
    pub core: core::Config,
    /// Where sample cameras stand; what is left open follows from the scene.
    pub rig: RigKnobs,
    /// Seconds that an animated scene moves on in a second; 0 holds it still.
    pub time_scale: f64,
    /// What calibration measured; those that speak of another scene or rig are passed over.
    pub models: Vec<core::quality::Model>,
    /// Its term of leadership; `None`: milliseconds since 1970, so that a coordinator that is started again
    /// has a higher one.
    pub term: Option<u64>,
    /// How long requests in work may take to finish after a shutdown began.
    pub grace: Duration,
    /// How long a connection to a worker may take.
    pub connect_timeout: Duration,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            core: core::Config::default(),
            rig: RigKnobs::default(),
            time_scale: 1.0,
            models: Vec::new(),
            term: None,
            grace: Duration::from_secs(5),
            connect_timeout: Duration::from_secs(2),
        }
    }
}

/// Why a coordinator does not serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// No rig can be placed around the scene.
    #[error("no sample camera can be placed: {0}")]
    Rig(#[from] InvalidField),
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
