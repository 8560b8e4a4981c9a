//! What processes talk over: the machine's network, or one that a test simulates.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use futures::FutureExt;
use futures::future::BoxFuture;
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tonic::transport::server::{Connected, TcpConnectInfo};
use tonic::transport::{Channel, Endpoint, Error, Uri};
use tower::service_fn;
use tracing::warn;

/// A connection: bytes both ways.
pub trait Duplex: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Duplex for T {}

/// Where connections come in.
pub trait Accept: Send + Sync + 'static {
    /// What it listens on.
    ///
    /// # Errors
    /// Whatever the network says.
    fn local_addr(&self) -> io::Result<SocketAddr>;

    /// The next connection, and between whom it is.
    fn accept(&self) -> BoxFuture<'_, io::Result<(Box<dyn Duplex>, TcpConnectInfo)>>;
}

impl Accept for TcpListener {
    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.local_addr()
    }

    fn accept(&self) -> BoxFuture<'_, io::Result<(Box<dyn Duplex>, TcpConnectInfo)>> {
        async {
            let (stream, _) = self.accept().await?;
            if let Err(error) = stream.set_nodelay(true) {
                warn!(%error, "a connection keeps its delays");
            }
            let between = stream.connect_info();
            Ok((Box::new(stream) as Box<dyn Duplex>, between))
        }
        .boxed()
    }
}

/// A network that stands in for the machine's.
pub trait Connect: Send + Sync {
    /// Connects to a port of a host.
    fn connect(&self, host: String, port: u16) -> BoxFuture<'static, io::Result<Box<dyn Duplex>>>;
}

/// How a process reaches others: over the machine's network, unless another one is given.
#[derive(Clone, Default)]
pub struct Network(Option<Arc<dyn Connect>>);

impl Network {
    /// Another network.
    pub fn simulated(network: Arc<dyn Connect>) -> Self {
        Self(Some(network))
    }

    /// A channel that connects when it is first used.
    pub(crate) fn channel(&self, endpoint: &Endpoint) -> Channel {
        match &self.0 {
            None => endpoint.connect_lazy(),
            Some(network) => {
                let network = network.clone();
                endpoint.connect_with_connector_lazy(service_fn(move |uri| through(network.clone(), uri)))
            }
        }
    }

    /// A channel that is connected.
    pub(crate) async fn connect(&self, endpoint: &Endpoint) -> Result<Channel, Error> {
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

impl PartialEq for Network {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (None, None) => true,
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            _ => false,
        }
    }
}
