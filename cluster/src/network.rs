//! What processes talk over: the machine's network, or one that a test simulates.

use std::io;
use std::net::SocketAddr;

pub use argus_proto::network::{Connect, Duplex, Network};
use futures::FutureExt;
use futures::future::BoxFuture;
use tokio::net::TcpListener;
use tonic::transport::server::{Connected, TcpConnectInfo};
use tracing::warn;

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
