//! The network of connections: the machine's, or one that a test simulates.

use std::fmt;
use std::io;
use std::sync::Arc;

use futures::future::BoxFuture;
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncRead, AsyncWrite};
use tonic::transport::{Channel, Endpoint, Error, Uri};
use tower::service_fn;

/// A bidirectional byte stream.
pub trait Duplex: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Duplex for T {}

/// A simulated network.
pub trait Connect: Send + Sync {
    /// Connects to a port of a host.
    fn connect(&self, host: String, port: u16) -> BoxFuture<'static, io::Result<Box<dyn Duplex>>>;
}

/// The network of a process: the machine's, or a simulated one.
#[derive(Clone, Default)]
pub struct Network(Option<Arc<dyn Connect>>);

impl Network {
    /// A simulated network.
    pub fn simulated(network: Arc<dyn Connect>) -> Self {
        Self(Some(network))
    }

    /// A channel that connects when it is first used.
    pub fn channel(&self, endpoint: &Endpoint) -> Channel {
        match &self.0 {
            None => endpoint.connect_lazy(),
            Some(network) => {
                let network = network.clone();
                endpoint.connect_with_connector_lazy(service_fn(move |uri| through(network.clone(), uri)))
            }
        }
    }

    /// A connected channel.
    ///
    /// # Errors
    /// The network's error.
    pub async fn connect(&self, endpoint: &Endpoint) -> Result<Channel, Error> {
        match &self.0 {
            None => endpoint.connect().await,
            Some(network) => {
                let network = network.clone();
                endpoint.connect_with_connector(service_fn(move |uri| through(network.clone(), uri))).await
            }
        }
    }
}

async fn through(network: Arc<dyn Connect>, uri: Uri) -> io::Result<TokioIo<Box<dyn Duplex>>> {
    let host = uri.host().unwrap_or_default().to_owned();
    network.connect(host, uri.port_u16().unwrap_or(80)).await.map(TokioIo::new)
}

impl fmt::Debug for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Network(simulated)" } else { "Network(the machine's)" })
    }
}

impl Eq for Network {}

impl PartialEq for Network {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (None, None) => true,
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            _ => false,
        }
    }
}
