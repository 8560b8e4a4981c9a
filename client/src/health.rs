//! Whether a process is well, as probes ask.

use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::connect::channel;
use crate::{ClientError, ConnectOptions};

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Health {
    /// Can it answer a view?
    Ready,
    /// Does it still get on with its work?
    Live,
}

/// Asks the coordinator or the worker at `url` whether it is well.
///
/// # Errors
/// [`ClientError::Address`], [`ClientError::NobodyListens`], or [`ClientError::Server`] for one that does not answer
/// such questions.
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
    let silent = |_| ClientError::NobodyListens {
        url: url.to_owned(),
        reason: format!("nothing came within {} ms", options.timeout.as_millis()),
    };
    tokio::time::timeout(options.timeout, asked).await.map_err(silent)?
}
