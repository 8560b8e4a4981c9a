//! Health checks of a process.

use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::connect::channel;
use crate::{ClientError, ConnectOptions};

/// The question of a health check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Health {
    /// Whether the process can answer a view.
    Ready,
    /// Whether the process still makes progress.
    Live,
}

/// Asks the coordinator or worker at `url` whether it is healthy.
///
/// # Errors
/// [`ClientError::Address`], [`ClientError::Unreachable`], or [`ClientError::Server`] if it has no health service.
pub async fn health(url: &str, what: Health, options: &ConnectOptions) -> Result<bool, ClientError> {
    let service = match what {
        Health::Ready => String::new(),
        Health::Live => "live".to_owned(),
    };
    let asked = async {
        let channel = channel(url, options).await?;
        let answer = HealthClient::new(channel).check(HealthCheckRequest { service }).await?;
        Ok(answer.into_inner().status() == ServingStatus::Serving)
    };
    let silent = |_| ClientError::Unreachable {
        url: url.to_owned(),
        reason: format!("nothing came within {} ms", options.timeout.as_millis()),
    };
    tokio::time::timeout(options.timeout, asked).await.map_err(silent)?
}
