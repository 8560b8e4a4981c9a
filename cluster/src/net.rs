//! How processes of a cluster talk: servers, and channels to others, one an address, connected when first used
//! and reconnected by themselves.

use std::collections::HashMap;
use std::time::Duration;

use argus_proto::Fault;
use argus_proto::transport::tuned;
use parking_lot::Mutex;
use tonic::transport::{Channel, Endpoint, Server};

/// Both ends probe an idle connection this often, so that a machine that vanished is noticed.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// Requests on one connection. A load balancer or a test client puts thousands on one; what is too many is the
/// core's decision, and it says so at once, while a request over this limit would silently wait in the client.
const MAX_STREAMS: u32 = 1 << 16;

/// Requests that were cancelled before they were looked at, on one connection: a client that gives up on all
/// of its views at once is no attack.
const MAX_RESETS: usize = 1 << 12;

/// Bytes that may be on their way to a server on one connection. Fixed and large: h2 (0.4.20) ends a
/// connection with ENHANCE_YOUR_CALM once small DATA frames that nobody has read yet take up half of it, and
/// an adaptive window begins at 64 KiB, where three hundred requests sent at once do.
const CONNECTION_WINDOW: u32 = 64 << 20;

/// How an address is connected to.
///
/// # Errors
/// What is wrong with the address, in one line.
pub(crate) fn endpoint(address: &str, connect_timeout: Duration) -> Result<Endpoint, String> {
    let endpoint =
        Endpoint::from_shared(address.to_owned()).map_err(|_| format!("{address} is not a URL"))?;
    if endpoint.uri().scheme_str() != Some("http") || endpoint.uri().authority().is_none() {
        return Err(format!("{address} is not of the form http://HOST:PORT"));
    }
    Ok(tuned(endpoint).connect_timeout(connect_timeout))
}

/// How both kinds of process serve.
pub(crate) fn server() -> Server {
    Server::builder()
        .initial_connection_window_size(CONNECTION_WINDOW)
        .http2_keepalive_interval(Some(KEEPALIVE))
        .max_concurrent_streams(Some(MAX_STREAMS))
        .http2_max_pending_accept_reset_streams(Some(MAX_RESETS))
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
