//! The network of a process: the machine's, or one that a test simulates.

use std::io;
use std::net::SocketAddr;

pub use argus_proto::network::{Connect, Duplex, Network};
use futures::FutureExt;
use futures::future::BoxFuture;
use tokio::net::TcpListener;
use tonic::transport::server::{Connected, TcpConnectInfo};
use tracing::warn;

/// A listener.
pub trait Accept: Send + Sync + 'static {
    /// The address that it listens on.
    ///
    /// # Errors
    /// The network's error.
    fn local_addr(&self) -> io::Result<SocketAddr>;

    /// The next connection, and its two addresses.
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
                warn!(%error, "cannot set TCP_NODELAY; small messages may be delayed");
            }
            let between = stream.connect_info();
            Ok((Box::new(stream) as Box<dyn Duplex>, between))
        }
        .boxed()
    }
}
