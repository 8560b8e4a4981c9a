//! TLS handshakes of accepted connections, each with the certificate of its time.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use futures::{Stream, StreamExt as _};
use rustls_pki_types::CertificateDer;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::task::JoinSet;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tonic::transport::server::Connected;

use super::ReloadableSecurity;
use crate::incoming::{Connection, ConnectionInfo};

/// Timeout of a TLS handshake at a listener, so that silent connections are closed.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Shakes hands on connections if the process uses TLS, many at a time. Each connection that is shaking hands has a slot
/// of the listener, so their number is bounded. Connections whose handshake fails are closed.
pub(crate) fn secured(
    connections: impl Stream<Item = io::Result<Connection>>,
    security: Option<Arc<ReloadableSecurity>>,
) -> impl Stream<Item = io::Result<MaybeTls>> {
    enum Next {
        Accepted(Option<io::Result<Connection>>),
        Shaken(Option<MaybeTls>),
    }
    async_stream::stream! {
        let mut shaking = JoinSet::new();
        let mut connections = std::pin::pin!(connections);
        loop {
            let next = tokio::select! {
                accepted = connections.next() => Next::Accepted(accepted),
                Some(shaken) = shaking.join_next() => Next::Shaken(shaken.ok().flatten()),
            };
            match (next, &security) {
                (Next::Accepted(None), _) => return,
                (Next::Accepted(Some(Err(error))), _) => yield Err(error),
                (Next::Accepted(Some(Ok(connection))), None) => yield Ok(MaybeTls::Plain(connection)),
                (Next::Accepted(Some(Ok(connection))), Some(security)) => {
                    let acceptor = TlsAcceptor::from(security.current().of_listener());
                    shaking.spawn(async move {
                        let shaken = timeout(HANDSHAKE, acceptor.accept(connection)).await;
                        match shaken {
                            Ok(Ok(stream)) => Some(MaybeTls::Tls(Box::new(stream))),
                            Ok(Err(error)) => {
                                tracing::debug!(%error, "a TLS handshake failed");
                                None
                            }
                            Err(_) => None,
                        }
                    });
                }
                (Next::Shaken(Some(stream)), _) => yield Ok(stream),
                (Next::Shaken(None), _) => {}
            }
        }
    }
}

/// A connection in plaintext or by TLS.
pub(crate) enum MaybeTls {
    Plain(Connection),
    Tls(Box<TlsStream<Connection>>),
}

/// The other end of a connection, in the extensions of its requests.
#[derive(Clone)]
pub(crate) struct PeerInfo {
    pub(crate) connection: ConnectionInfo,
    /// The certificate that it presented. The handshake checked that the authority signed it.
    pub(crate) certificate: Option<Arc<CertificateDer<'static>>>,
}

impl Connected for MaybeTls {
    type ConnectInfo = PeerInfo;

    fn connect_info(&self) -> PeerInfo {
        match self {
            Self::Plain(connection) => PeerInfo { connection: connection.connect_info(), certificate: None },
            Self::Tls(stream) => {
                let (connection, tls) = stream.get_ref();
                let certificate = tls.peer_certificates().and_then(|chain| chain.first());
                let certificate = certificate.map(|certificate| Arc::new(certificate.clone().into_owned()));
                PeerInfo { connection: connection.connect_info(), certificate }
            }
        }
    }
}

/// Calls a method of the stream that it is.
macro_rules! of_stream {
    ($self:ident, $method:ident ( $($argument:expr),* )) => {
        match $self.get_mut() {
            Self::Plain(stream) => Pin::new(stream).$method($($argument),*),
            Self::Tls(stream) => Pin::new(stream).$method($($argument),*),
        }
    };
}

impl AsyncRead for MaybeTls {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        of_stream!(self, poll_read(cx, buf))
    }
}

impl AsyncWrite for MaybeTls {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        of_stream!(self, poll_write(cx, bytes))
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        of_stream!(self, poll_flush(cx))
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        of_stream!(self, poll_shutdown(cx))
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        of_stream!(self, poll_write_vectored(cx, parts))
    }

    fn is_write_vectored(&self) -> bool {
        match self {
            Self::Plain(stream) => stream.is_write_vectored(),
            Self::Tls(stream) => stream.is_write_vectored(),
        }
    }
}
