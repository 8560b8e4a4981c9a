//! Channels to other processes: one an address, connected when first used, reconnected by themselves.

use std::collections::HashMap;
use std::time::Duration;

use argus_proto::Fault;
use parking_lot::Mutex;
use tonic::transport::{Channel, Endpoint};

/// Both ends probe an idle connection this often, so that a machine that vanished is noticed.
pub(crate) const KEEPALIVE: Duration = Duration::from_secs(10);

/// How an address is connected to. Frames and samples come in megabytes, so windows adapt.
///
/// # Errors
/// [`Fault::Invalid`]-free text: what is wrong with the address.
pub(crate) fn endpoint(address: &str, connect_timeout: Duration) -> Result<Endpoint, String> {
    let endpoint =
        Endpoint::from_shared(address.to_owned()).map_err(|_| format!("{address} is not a URL"))?;
    if endpoint.uri().scheme_str() != Some("http") || endpoint.uri().authority().is_none() {
        return Err(format!("{address} is not of the form http://HOST:PORT"));
    }
    Ok(endpoint
        .connect_timeout(connect_timeout)
        .tcp_nodelay(true)
        .http2_adaptive_window(true)
        .http2_keep_alive_interval(KEEPALIVE)
        .keep_alive_while_idle(true))
}

/// The channels of a process.
#[derive(Debug)]
pub(crate) struct Channels {
    connect_timeout: Duration,
    by_address: Mutex<HashMap<String, Channel>>,
}

impl Channels {
    pub(crate) fn new(connect_timeout: Duration) -> Self {
        Self { connect_timeout, by_address: Mutex::default() }
    }

    /// The channel to an address.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if the address is none.
    pub(crate) fn to(&self, address: &str) -> Result<Channel, Fault> {
        if let Some(channel) = self.by_address.lock().get(address) {
            return Ok(channel.clone());
        }
        let endpoint = endpoint(address, self.connect_timeout).map_err(Fault::Unavailable)?;
        let mut channels = self.by_address.lock();
        Ok(channels.entry(address.to_owned()).or_insert_with(|| endpoint.connect_lazy()).clone())
    }

    /// Closes the channel to an address once nobody uses it.
    pub(crate) fn forget(&self, address: &str) {
        self.by_address.lock().remove(address);
    }
}
